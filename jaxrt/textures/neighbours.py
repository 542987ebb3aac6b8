"""Which texels of a picture lie beside each other."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from jaxrt.textures import SORTS, Textures


def neighbours(textures: Textures, name: str) -> NDArray[np.intp]:
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
