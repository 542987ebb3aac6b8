"""Pinhole camera."""

import jax.numpy as jnp
from jax import Array

from jaxrt.cameras.interface import Pair, View
from jaxrt.core.maths import cross, dot, normalize, safe_divide, safe_sqrt
from jaxrt.core.pytree import pytree, static
from jaxrt.core.records import Ray


@pytree
class Pinhole:
    """A pinhole camera and the size of its picture."""

    position: Array  # (3,) scene units
    target: Array  # (3,) the point at the picture's centre
    up: Array  # (3,) any length, not parallel to the view
    fov: Array  # () vertical, degrees
    width: int = static()
    height: int = static()
    is_central = True

    def frame(self) -> "PinholeFrame":
        """Return the axes of the picture; row 0 is the top, fov is the vertical angle in degrees."""
        forward = normalize(self.target - self.position)
        right = normalize(cross(forward, normalize(self.up)))
        up = cross(right, forward)
        pixel = 2 * jnp.tan(jnp.radians(self.fov) / 2) / self.height
        return PinholeFrame(self.position, pixel * right, pixel * up, forward, self.width, self.height)

    def ray(self, image: Pair, u: Pair) -> Ray:
        """Return the ray through an image point."""
        return self.frame().ray(image, u)

    def project(self, point: Array) -> tuple[Pair, Array]:
        """Return the image point, and whether the point is in front of the camera."""
        return self.frame().project(point)


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
