"""Orthographic camera."""

from jax import Array

from jaxrt.cameras.interface import Pair, View
from jaxrt.cameras.looking import Looking, axes_of
from jaxrt.core.maths import dot, safe_divide
from jaxrt.core.pytree import pytree, static
from jaxrt.core.records import Ray
from jaxrt.description.fields import Positive
from jaxrt.description.kinds import camera
from jaxrt.description.values import Count


@camera
class Orthographic(Looking):
    """Looks along parallel rays, which start on the plane through `position`."""

    tall: Positive = 10.0  # () height of what the picture shows, scene units
    width: Count = 512
    height: Count = 512
    is_parallel = True

    def frame(self) -> "OrthographicFrame":
        """Return the axes of the picture."""
        right, up, forward = axes_of(self)
        pixel = self.tall / self.height
        return OrthographicFrame(self.position, pixel * right, pixel * up, forward, self.width, self.height)


@pytree
class OrthographicFrame(View):
    """The camera as the path reads it."""

    position: Array  # (3,)
    right: Array  # (3,) one pixel to the right
    up: Array  # (3,) one pixel up
    forward: Array  # (3,) unit vector
    width: int = static()
    height: int = static()

    heading = property(lambda self: self.forward)

    def start(self, image: Pair) -> Array:
        """Return where (3,) the ray through an image point starts."""
        across, down = image[0] - self.width / 2, image[1] - self.height / 2
        return self.position + across * self.right - down * self.up

    def eye(self, point: Array) -> Array:
        """Return where (3,) the ray that shows a point starts."""
        return point - self.depth(point) * self.forward

    def toward(self, image: Pair) -> Array:
        """Return the direction (3,) of all rays."""
        return self.forward

    def ray(self, image: Pair, u: Pair) -> Ray:
        """Return the ray through an image point."""
        return Ray(self.start(image), self.forward)

    def project(self, point: Array) -> tuple[Pair, Array]:
        """Return the image point, and whether the point is in front of the camera."""
        away, area = point - self.position, dot(self.right, self.right)
        across = safe_divide(dot(away, self.right), area)
        rise = safe_divide(dot(away, self.up), area)
        return (across + self.width / 2, self.height / 2 - rise), self.depth(point) > 0

    def depth(self, point: Array) -> Array:
        """Return how far along the camera's axis a point is."""
        return dot(point - self.position, self.forward)

    def density(self, point: Array) -> Array:
        """Return the pixels per steradian as seen from where the ray starts."""
        depth = self.depth(point)
        return safe_divide(depth * depth, dot(self.right, self.right))
