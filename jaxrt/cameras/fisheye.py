"""Equidistant fisheye."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array
from pydantic import model_validator

from jaxrt.cameras.interface import Pair
from jaxrt.cameras.looking import Looking
from jaxrt.core.maths import safe_divide, safe_sqrt
from jaxrt.description.fields import FullAngle
from jaxrt.description.kinds import camera
from jaxrt.description.values import Count, complaint


@camera
class Fisheye(Looking):
    """A fisheye whose angle to the axis grows as the distance from the picture's middle."""

    angle: FullAngle = 180.0  # () from the picture's top to its bottom, degrees
    width: Count = 512
    height: Count = 512
    is_central = True

    class Table(Looking.Table):
        """Its table, further checked."""

        @model_validator(mode="after")
        def _check_corners(self: Any) -> Any:
            most = 360 / np.hypot(1, self.width / self.height)
            if self.angle > most:
                past = "the corners would look past what is straight behind"
                raise complaint(f"{self.angle:g}: {past}: use {np.floor(most):g} or less", "angle")
            return self

    def direction(self, image: Pair) -> tuple[Array, Array, Array]:
        """Return the direction that an image point shows."""
        across, down = image[0] - self.width / 2, image[1] - self.height / 2
        distance = safe_sqrt(across * across + down * down)
        # Nothing is farther round than straight behind
        angle = jnp.minimum(distance * self._per_pixel(), jnp.pi)
        share = jnp.where(distance > 0, safe_divide(jnp.sin(angle), distance), self._per_pixel())
        return share * across, share * down, jnp.cos(angle)

    def image_of(self, seen: tuple[Array, Array, Array]) -> tuple[Pair, Array]:
        """Return the image point of a place, and whether there is one."""
        x, y, z = seen
        aside = safe_sqrt(x * x + y * y)
        angle = jnp.arctan2(aside, jnp.where((aside > 0) | (z != 0), z, 1))
        share = safe_divide(
            jnp.where(aside > 0, safe_divide(angle, aside), safe_divide(jnp.ones_like(z), z)), self._per_pixel()
        )
        return (self.width / 2 + share * x, self.height / 2 + share * y), (aside > 0) | (z > 0)

    def _per_pixel(self) -> Array:
        return jnp.radians(self.angle) / self.height
