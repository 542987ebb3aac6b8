"""Signed pictures in colour: blue below zero, white at zero, red above."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from jaxrt.gradcheck.functionals import LUMINANCE
from jaxrt.gradcheck.report import Component

Image = NDArray[np.float32]

BLUE, WHITE, RED = np.array([0.13, 0.29, 0.63]), np.array([0.97, 0.97, 0.97]), np.array([0.70, 0.09, 0.13])
SHORT_SIDE = 240  # panels are enlarged by a whole factor to at least this, in pixels
GAP = 8
SATURATED = 99.5  # percentile of the finite difference that has the full colour


def heatmap(components: Sequence[Component], gamma: float = 2.2) -> Image:
    """Return a linear picture of derivatives of luminance: a row for each component, in one scale a row.

    Columns: finite differences, interior only, with edges. Display values are raised to `gamma`, for writers that
    undo it.
    """
    rows = [_row([component.finite, component.interior, component.total]) for component in components]
    return (np.concatenate(rows, axis=0)[:-GAP] ** gamma).astype(np.float32)


def _row(pictures: Sequence[Image]) -> NDArray[np.float64]:
    bright = [picture.astype(np.float64) @ LUMINANCE for picture in pictures]
    full = np.percentile(np.abs(bright[0]), SATURATED) or np.abs(bright).max() or 1.0
    factor = -(-SHORT_SIDE // min(bright[0].shape))
    panels = []
    for values in bright:
        panel = np.kron(_colours(values / full), np.ones((factor, factor, 1)))
        panels += [panel, np.ones((panel.shape[0], GAP, 3))]
    row = np.concatenate(panels[:-1], axis=1)
    return np.concatenate([row, np.ones((GAP, row.shape[1], 3))], axis=0)


def _colours(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return colours (…, 3) of values from −1 to 1."""
    share = np.clip(values, -1, 1)[..., None]
    return np.where(share < 0, WHITE + share * (WHITE - BLUE), WHITE - share * (WHITE - RED))
