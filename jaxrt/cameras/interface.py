"""What a camera answers, and where it sees a point of the scene.

Image points are columns and rows in pixels, (0, 0) the upper left corner of a picture of width × height pixels. A
camera answers

    ray(image, u) -> the Ray through an image point; u: two numbers in [0, 1), for a place on a lens

and one whose rays all start at its `position` is central, and answers

    project(point) -> (image point, () bool: whether the point is in view), finite for any point

so that moving outlines and shadow edges are known. It may also answer `frame()`, with what the rays of a whole render
share: a `View` of its own.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from jaxrt.core import sampling
from jaxrt.core.maths import dot, normalize, safe_sqrt
from jaxrt.core.pytree import pytree
from jaxrt.core.records import Ray

Pair = tuple[Array, Array]


class View:
    """A camera as the path and the edges read it; what follows from `ray` and `project` is here."""

    position: Any  # (3,) the eye of a central camera
    width: Any
    height: Any

    def ray(self, image: Pair, u: Pair) -> Ray:
        """Return the ray through an image point."""
        raise NotImplementedError

    def project(self, point: Array) -> tuple[Pair, Array]:
        """Return the image point at which a point is seen, and whether it is in view."""
        raise NotImplementedError

    def toward(self, image: Pair) -> Array:
        """Return the direction (3,) to what an image point shows, of any length."""
        nowhere = jnp.zeros_like(image[0])
        return self.ray(image, (nowhere, nowhere)).direction

    def depth(self, point: Array) -> Array:
        """Return how many times `toward` it is from the eye to a point."""
        away = point - self.position
        return safe_sqrt(dot(away, away))

    def density(self, point: Array) -> Array:
        """Return the pixels per steradian at a point's image, by the Jacobian of `project`."""
        away = point - self.position
        (a, b), (c, d) = (self._moved(point, side) for side in sampling.frame(normalize(away)))
        return jnp.abs(a * d - b * c) * dot(away, away)

    def _moved(self, point: Array, change: Array) -> Pair:
        """Return how the image point moves with a point."""
        return jax.jvp(lambda p: self.project(p)[0], (point,), (change,))[1]


@pytree
class Plain(View):
    """A camera that prepares nothing."""

    camera: Any

    position = property(lambda self: self.camera.position)
    width = property(lambda self: self.camera.width)
    height = property(lambda self: self.camera.height)

    def ray(self, image: Pair, u: Pair) -> Ray:
        """Return the ray through an image point."""
        return self.camera.ray(image, u)

    def project(self, point: Array) -> tuple[Pair, Array]:
        """Return the image point at which a point is seen, and whether it is in view."""
        return self.camera.project(point)


def view_of(camera: Any) -> View:
    """Return what answers for a camera along a render: computed once, differentiable in the camera."""
    return camera.frame() if hasattr(camera, "frame") else Plain(camera)


@pytree
class Projection:
    """A point's image."""

    image: Array  # (2,) column and row in pixels
    pixel: Array  # () int32 row · width + column
    inside: Array  # () bool: in front of the camera and within the picture
    depth: Array  # () in lengths of `toward`
    density: Array  # () pixels per steradian


def projection(view: View, point: Array) -> Projection:
    """Return the image of a point in a central camera's view; finite, but meaningless, where it is not `inside`."""
    (x, y), ahead = view.project(point)
    inside = ahead & (x > 0) & (x < view.width) & (y > 0) & (y < view.height)
    x, y = jnp.where(inside, x, 0), jnp.where(inside, y, 0)
    column = jnp.minimum(x.astype(jnp.int32), view.width - 1)
    row = jnp.minimum(y.astype(jnp.int32), view.height - 1)
    density = jnp.where(ahead, view.density(point), 0)
    return Projection(jnp.stack([x, y]), row * view.width + column, inside, view.depth(point), density)
