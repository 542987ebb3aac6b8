"""What a camera answers, and where it sees a point of the scene.

Image points are columns and rows in pixels, (0, 0) the upper left corner of a picture of width × height pixels. A
camera answers

    ray(image, u) -> the Ray through an image point; u: two numbers in [0, 1), for a place on a lens

and one whose rays all start at its `position` is central, one whose rays all go the same way is parallel, and both
answer

    project(point) -> (image point, () bool: whether the point is in view), finite for any point

so that moving outlines and shadow edges are known. It may also answer `frame()`, with what the rays of a whole render
share: a `View` of its own. A lens is many eyes: the `View` through each place of it is that of a central camera.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from jaxrt.core import sampling
from jaxrt.core.maths import dot, normalize, safe_sqrt
from jaxrt.core.pytree import dtype_of, pytree
from jaxrt.core.records import Ray

Pair = tuple[Array, Array]


class View:
    """A camera as the path and the edges read it; what follows from `ray` and `project` is here."""

    position: Any  # (3,) the eye of a central camera
    heading: Array | None = None  # (3,) unit direction of all rays of a parallel camera; None for a central one
    lens: Array | None = None  # (2,) numbers of the place on the lens that it is seen through; None without a lens
    radius: Any  # () of the lens, in scene units, if there is one
    width: Any
    height: Any

    def ray(self, image: Pair, u: Pair) -> Ray:
        """Return the ray through an image point."""
        raise NotImplementedError

    def project(self, point: Array) -> tuple[Pair, Array]:
        """Return the image point at which a point is seen, and whether it is in view."""
        raise NotImplementedError

    def through(self, u: Pair) -> "View":
        """Return the view through one place of the lens."""
        return self

    def at(self, lens: Array | None) -> "View":
        """Return the view through the place of numbers `lens` (2,); itself for None, without a lens."""
        return self if lens is None else self.through((lens[0], lens[1]))

    def start(self, image: Pair) -> Array:
        """Return where (3,) the ray through an image point starts."""
        return self.position

    def eye(self, point: Array) -> Array:
        """Return where (3,) the ray that shows a point starts."""
        return self.position if self.heading is None else self.start(self.project(point)[0])

    def toward(self, image: Pair) -> Array:
        """Return the direction (3,) to what an image point shows, of any length."""
        nowhere = jnp.zeros_like(image[0])
        return self.ray(image, (nowhere, nowhere)).direction

    def depth(self, point: Array) -> Array:
        """Return how many times `toward` it is from where its ray starts to a point."""
        away = point - self.eye(point)
        return safe_sqrt(dot(away, away))

    def density(self, point: Array) -> Array:
        """Return the pixels per steradian at a point's image, as seen from its eye, by the Jacobian of `project`."""
        away = point - self.eye(point)
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
    heading = property(lambda self: self.toward(_origin(self)) if self.camera.is_parallel else None)
    width = property(lambda self: self.camera.width)
    height = property(lambda self: self.camera.height)

    def start(self, image: Pair) -> Array:
        """Return where (3,) the ray through an image point starts."""
        return self.camera.ray(image, _origin(self)).origin if self.camera.is_parallel else self.position

    def ray(self, image: Pair, u: Pair) -> Ray:
        """Return the ray through an image point."""
        return self.camera.ray(image, u)

    def project(self, point: Array) -> tuple[Pair, Array]:
        """Return the image point at which a point is seen, and whether it is in view."""
        return self.camera.project(point)


def _origin(tree: Any) -> Pair:
    nothing = jnp.zeros((), dtype_of(tree))
    return nothing, nothing


def edges_known(camera: Any) -> bool:
    """Return whether the edges that a camera sees are known: whether its rays start at one place or go one way."""
    return bool(camera.is_central or camera.is_parallel)


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
    """Return the image of a point in a camera's view; finite, but meaningless, where it is not `inside`."""
    (x, y), ahead = view.project(point)
    inside = ahead & (x > 0) & (x < view.width) & (y > 0) & (y < view.height)
    x, y = jnp.where(inside, x, 0), jnp.where(inside, y, 0)
    column = jnp.minimum(x.astype(jnp.int32), view.width - 1)
    row = jnp.minimum(y.astype(jnp.int32), view.height - 1)
    density = jnp.where(ahead, view.density(point), 0)
    return Projection(jnp.stack([x, y]), row * view.width + column, inside, view.depth(point), density)
