"""Pictures as sums of pictures of halved sizes: Laplacian pyramids (Burt and Adelson 1983).

A descent in the levels, in place of the texels, moves large areas and single texels in steps of the same size: it is
sooner there, and what no picture shows goes on from what is around it.
"""

from collections.abc import Sequence

import jax
from jax import Array


def parted(picture: Array, coarsest: int = 4) -> list[Array]:
    """Return the levels of a picture (h, w, c), that of its own size first, each of half the size of the one before.

    coarsest: rows or columns of which the last level has at most so many. `joined` has them add up to the picture.
    """
    height, width, channels = picture.shape
    if min(height, width) <= max(coarsest, 1):
        return [picture]
    small = jax.image.resize(picture, (-(-height // 2), -(-width // 2), channels), "linear")
    return [picture - jax.image.resize(small, picture.shape, "linear"), *parted(small, coarsest)]


def joined(levels: Sequence[Array]) -> Array:
    """Return the picture (h, w, c) that levels, the finest first, add up to, each enlarged bilinearly to the next."""
    total = levels[-1]
    for level in levels[-2::-1]:
        total = level + jax.image.resize(total, level.shape, "linear")
    return total
