"""Colours at vertices, as mesh files have them: display values, of 8 bits or in [0, 1]."""

import numpy as np

from jaxrt.description.mesh_facts import Floats
from jaxrt.io.color import srgb_decode


def vertex_colors(values: Floats, largest: float | None = None) -> tuple[Floats | None, list[str]]:
    """Return linear colours (v, 3) of display values (v, 3), and what is wrong with them.

    largest: what stands for white; None: 1, or 255 where there are larger values.
    """
    if not len(values):
        return None, []
    largest = largest or (255.0 if values.max() > 1 else 1.0)
    if not (np.isfinite(values).all() and values.min() >= 0 and values.max() <= largest):
        return None, ["vertex colours are neither in [0, 1] nor in [0, 255]: they are not read"]
    return np.asarray(srgb_decode(values / largest), np.float64), []
