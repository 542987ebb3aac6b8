"""A camera whose picture goes on beyond its borders: what filters wider than a pixel see there."""

from typing import Any

from jax import Array

from jaxrt.cameras.interface import Pair, View, view_of
from jaxrt.core.pytree import pytree, static
from jaxrt.core.records import Ray


@pytree
class Padded:
    """A camera with so many pixels more on each side."""

    camera: Any
    margin: int = static()

    is_central = property(lambda self: self.camera.is_central)
    is_parallel = property(lambda self: self.camera.is_parallel)
    width = property(lambda self: self.camera.width + 2 * self.margin)
    height = property(lambda self: self.camera.height + 2 * self.margin)

    def frame(self) -> "PaddedView":
        """Return the view of the camera, with the margin."""
        return PaddedView(view_of(self.camera), self.margin)


@pytree
class PaddedView(View):
    """A view by image points that are counted from the corner of the margin."""

    view: Any
    margin: int = static()

    position = property(lambda self: self.view.position)
    heading = property(lambda self: self.view.heading)
    lens = property(lambda self: self.view.lens)
    radius = property(lambda self: self.view.radius)
    width = property(lambda self: self.view.width + 2 * self.margin)
    height = property(lambda self: self.view.height + 2 * self.margin)

    def through(self, u: Pair) -> "PaddedView":
        """Return the view through one place of the lens."""
        return PaddedView(self.view.through(u), self.margin)

    def start(self, image: Pair) -> Array:
        """Return where (3,) the ray through an image point starts."""
        start: Array = self.view.start(self._own(image))
        return start

    def eye(self, point: Array) -> Array:
        """Return where (3,) the ray that shows a point starts."""
        eye: Array = self.view.eye(point)
        return eye

    def toward(self, image: Pair) -> Array:
        """Return the direction (3,) to what an image point shows, of any length."""
        toward: Array = self.view.toward(self._own(image))
        return toward

    def ray(self, image: Pair, u: Pair) -> Ray:
        """Return the ray through an image point."""
        ray: Ray = self.view.ray(self._own(image), u)
        return ray

    def project(self, point: Array) -> tuple[Pair, Array]:
        """Return the image point at which a point is seen, and whether it is in view."""
        (x, y), seen = self.view.project(point)
        return (x + self.margin, y + self.margin), seen

    def depth(self, point: Array) -> Array:
        """Return how many times `toward` it is from where its ray starts to a point."""
        depth: Array = self.view.depth(point)
        return depth

    def density(self, point: Array) -> Array:
        """Return the pixels per steradian at a point's image."""
        density: Array = self.view.density(point)
        return density

    def _own(self, image: Pair) -> Pair:
        return image[0] - self.margin, image[1] - self.margin
