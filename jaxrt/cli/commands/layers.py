"""The outputs that `jaxrt render` draws besides the picture."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from jaxrt.cli.errors import UsageError, refusing
from jaxrt.hands import painter
from jaxrt.render import numbers_of
from jaxrt.scene import Scene, drawn
from jaxrt.transport.film import Plan, Run
from jaxrt.views import Asked, answers, asked_for


def layers_asked(scene: Scene, names: Sequence[str], sums: bool) -> Asked | None:
    """Return what has to be drawn besides the picture; None for nothing.

    sums: whether sums are to be written, which hold radiance alone. Raises UsageError for that, and for unknown names.
    """
    if not names:
        return None
    if sums:
        raise UsageError("argument --outputs: sums of samples hold the picture alone: draw the whole into an .exr")
    # What can be laid over another picture is without the sky
    main = "foreground" if "alpha" in names else "radiance"
    with refusing():
        return asked_for(scene, (main, *names))


def draw_layers(
    asked: Asked, scene: Scene, picture: NDArray[np.float32], run: Run, plan: Plan, folder: Path | None, cores: int
) -> dict[str, NDArray[Any]]:
    """Return all outputs by name. picture: the radiance; run: of all samples."""
    others = numbers = None
    plain = drawn(scene)
    if asked.outputs:
        own = plan._replace(max_depth=1, outputs=tuple(asked.outputs.values()))
        draw = painter(folder, plain, run._replace(end=run.first), own, cores)
        parts = draw(run).astype(float).sum(-1)
        others = jnp.asarray((parts / int(run.end - run.first)).astype(np.float32))
    if asked.numbers:
        numbers = numbers_of(plain, run, plan)
    found = answers(scene, asked, jnp.asarray(picture), others, numbers)
    return {name: np.asarray(layer) for name, layer in found.items()}
