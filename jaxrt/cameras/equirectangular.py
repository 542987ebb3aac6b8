"""Equirectangular panorama."""

import math

import jax.numpy as jnp
from jax import Array

from jaxrt.cameras.interface import Pair
from jaxrt.cameras.looking import Looking
from jaxrt.core.maths import safe_sqrt
from jaxrt.description.kinds import camera
from jaxrt.description.values import Count


@camera
class Equirectangular(Looking):
    """All round: longitude along the picture's width, 0 in its middle, latitude along its height."""

    width: Count = 1024
    height: Count = 512
    is_central = True

    def direction(self, image: Pair) -> tuple[Array, Array, Array]:
        """Return the direction that an image point shows."""
        longitude = (image[0] / self.width - 0.5) * (2 * math.pi)
        below = (image[1] / self.height - 0.5) * math.pi
        level = jnp.cos(below)
        return level * jnp.sin(longitude), jnp.sin(below), level * jnp.cos(longitude)

    def image_of(self, seen: tuple[Array, Array, Array]) -> tuple[Pair, Array]:
        """Return the image point of a place, and whether there is one."""
        x, y, z = seen
        level = safe_sqrt(x * x + z * z)
        beside = level > 0  # straight above and below there is no longitude
        longitude = jnp.arctan2(jnp.where(beside, x, 0), jnp.where(beside, z, 1))
        below = jnp.arctan2(y, jnp.where(beside | (y != 0), level, 1))
        column, row = longitude / (2 * math.pi) + 0.5, below / math.pi + 0.5
        return (column * self.width, row * self.height), beside
