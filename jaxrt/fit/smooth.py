"""Smooth textures: differences of neighbouring texels, as further residuals of a fit.

What no picture shows then goes on from around it, and what pictures show by a fraction of a pixel leans on its
neighbours. Where pictures tell, they outweigh it.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from jaxrt.description import show
from jaxrt.fit.targets import FitError
from jaxrt.fit.unknowns import Unknowns
from jaxrt.scene import Scene
from jaxrt.scene.measures import TEXTURES
from jaxrt.textures import SORTS, Textures

Floats = NDArray[np.float64]


def differences(scene: Scene, unknowns: Unknowns, smoothness: float | None) -> Floats | None:
    """Return the matrix (n, k) from the unknowns' vector to weighted differences of neighbouring texels.

    The sum of their squares is the square of `smoothness` where they are 1 on average: a picture that is off by that
    share of its own size costs as much. None without smoothness. Raises FitError for what is no such number, and where
    no picture is among the unknowns.
    """
    if smoothness is None:
        return None
    if isinstance(smoothness, bool) or not isinstance(smoothness, int | float) or not 0 < smoothness < math.inf:
        raise FitError(f"fit: smoothness is {show(smoothness)}: pass a number above 0, as 0.01, or none")
    found, textures = [np.zeros((0, sum(row.size for row in unknowns.rows)))], scene.materials.textures
    for row in unknowns.rows:
        if row.selector.name.startswith(TEXTURES) and textures is not None:
            pairs = _pairs(textures, row.selector.name.removeprefix(TEXTURES))
            places = row.first + 3 * pairs[..., None] + np.arange(3)
            own = np.zeros((places[:, 0].size, found[0].shape[1]))
            first, second = (places[:, i].ravel() for i in (0, 1))
            own[np.arange(len(own)), first], own[np.arange(len(own)), second] = 1, -1
            found.append(own)
    matrix = np.concatenate(found)
    if not len(matrix):
        raise FitError("fit: smoothness is of the texels of pictures, and none are sought: leave it out")
    return matrix * (smoothness / len(matrix) ** 0.5)


def _pairs(textures: Textures, name: str) -> NDArray[np.intp]:
    """Return the numbers (n, 2) of texels that lie beside each other, across the border too where the picture repeats.

    There are none of what is no picture.
    """
    i = textures.names.index(name)
    if SORTS[int(textures.layout.sort[i])] != "image":
        return np.zeros((0, 2), int)
    numbers = np.arange(math.prod(textures.shapes[i])).reshape(textures.shapes[i])
    found: Sequence[NDArray[np.intp]] = [
        np.stack([numbers, np.roll(numbers, -1, axis)], -1).swapaxes(0, axis)[: _steps(numbers, axis, textures, i)]
        for axis in (0, 1)
    ]
    return np.concatenate([pairs.reshape(-1, 2) for pairs in found])


def _steps(numbers: NDArray[np.intp], axis: int, textures: Textures, i: int) -> int:
    """Return how many texels of a line have one after them."""
    count = numbers.shape[axis]
    return count if count > 2 and not textures.layout.clamp[i] else count - 1
