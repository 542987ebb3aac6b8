"""Pinhole camera."""

from collections.abc import Iterator, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxrt.cameras.interface import Pair, View
from jaxrt.cameras.looking import Looking, axes_of
from jaxrt.core.maths import dot, normalize, safe_divide, safe_sqrt
from jaxrt.core.pytree import pytree, static
from jaxrt.core.records import Ray
from jaxrt.description.fields import Angle
from jaxrt.description.kinds import camera
from jaxrt.description.values import Count

RADIANS = 0.1, np.pi  # what a fov would be in radians; below it is a probe that somebody means
SPECK = 0.1  # of what is looked at: a view that is narrower than that hardly is meant
STRETCHED = 150  # degrees, from where on an eighth of the picture's height is a third of the view


@camera
class Pinhole(Looking):
    """A pinhole camera; `fov` is vertical, in degrees."""

    fov: Angle = 60.0  # () vertical, degrees
    width: Count = 512
    height: Count = 512
    is_central = True

    class Table(Looking.Table):
        """Its table, further checked."""

        def doubts(self: Any, sizes: Sequence[float]) -> Iterator[str]:
            """Tell of a view that is hardly meant. sizes: the angles under which it sees things."""
            fov = self.fov
            if fov > STRETCHED:
                yield f"camera: fov {fov:g} degrees stretches the picture's edges beyond recognition: use 20 to 100"
            if RADIANS[0] <= fov < RADIANS[1] and sizes and np.radians(fov) < SPECK * float(np.median(sizes)):
                meant = f"use {np.degrees(fov):.3g} if it is meant in radians"
                yield f"camera: fov {fov:g} degrees shows a speck of the scene: {meant}"

    def frame(self) -> "PinholeFrame":
        """Return the axes of the picture; row 0 is the top, fov is the vertical angle in degrees."""
        right, up, forward = axes_of(self)
        pixel = 2 * jnp.tan(jnp.radians(self.fov) / 2) / self.height
        return PinholeFrame(self.position, pixel * right, pixel * up, forward, self.width, self.height)


@pytree
class PinholeFrame(View):
    """The camera as the path reads it: its ray through image point (x, y) is right·x + up·y + forward."""

    position: Array  # (3,)
    right: Array  # (3,) one pixel to the right, at distance 1
    up: Array  # (3,) one pixel up
    forward: Array  # (3,) unit vector
    width: int = static()
    height: int = static()

    def toward(self, image: Pair) -> Array:
        """Return the direction (3,) to what an image point shows, 1 along the camera's axis."""
        across, down = image[0] - self.width / 2, image[1] - self.height / 2
        return across * self.right - down * self.up + self.forward

    def ray(self, image: Pair, u: Pair) -> Ray:
        """Return the ray through an image point."""
        return Ray(self.position, normalize(self.toward(image)))

    def project(self, point: Array) -> tuple[Pair, Array]:
        """Return the image point, and whether the point is in front of the camera."""
        away, depth = point - self.position, self.depth(point)
        ahead = depth > 0
        area = dot(self.right, self.right)  # of a pixel at distance 1
        across = safe_divide(dot(away, self.right), area * jnp.where(ahead, depth, 1))
        rise = safe_divide(dot(away, self.up), area * jnp.where(ahead, depth, 1))
        return (across + self.width / 2, self.height / 2 - rise), ahead

    def depth(self, point: Array) -> Array:
        """Return how far along the camera's axis a point is."""
        return dot(point - self.position, self.forward)

    def density(self, point: Array) -> Array:
        """Return the pixels per steradian: one pixel spans area · cos³θ."""
        away, depth = point - self.position, self.depth(point)
        slant = safe_divide(safe_sqrt(dot(away, away)), jnp.where(depth > 0, depth, 1))
        return safe_divide(slant * slant * slant, dot(self.right, self.right))
