"""What our own cameras share: they stand at a place, look at a target, and may be turned."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array
from pydantic import Field, ValidationInfo, field_validator, model_validator

from jaxrt.cameras.interface import Pair, View
from jaxrt.core.maths import cross, dot, normalize, turn_less_one, turned_by
from jaxrt.core.pytree import pytree
from jaxrt.core.records import Ray
from jaxrt.description import values
from jaxrt.description.fields import Place, Turn, Turns, Up
from jaxrt.description.values import SHORTEST, complaint, show

PARALLEL = 1e-6  # sine of the angle between up and view below which the camera's frame is noise in float32

Axes = tuple[Array, Array, Array]


class Looking:
    """A camera's place and turn; `roll` and `rotate` are about its own axes, which are right, up and backwards."""

    position: Place  # (3,) scene units
    target: Place = Field(default=None, validate_default=True)  # (3,) the point that it looks at
    up: Up = (0.0, 1.0, 0.0)  # (3,) any length, not parallel to the view
    roll: Turn | None = None  # () degrees about its view, which turn what it shows clockwise; None: no code
    rotate: Turns | None = None  # (3,) rotation vector in degrees, after the roll; None: no code

    class Table(values.Table):
        """Its table, further checked."""

        @field_validator("target", mode="before", check_fields=False)
        @classmethod
        def _look_along_minus_z(cls, value: Any, info: ValidationInfo) -> Any:
            x, y, z = info.data.get("position", (0.0, 0.0, 0.0))
            return (x, y, z - 1) if value is None else value

        @model_validator(mode="after")
        def _check_frame(self: Any) -> Any:
            up = self.up
            view = np.subtract(self.target, self.position)
            length, up_length = np.linalg.norm(view), np.linalg.norm(up)
            if length < SHORTEST:
                raise complaint("is the camera's position: nothing to look along, move one of them", "target")
            if up_length < SHORTEST:
                raise complaint(f"{show(up)} is zero: use a direction such as [0, 1, 0]", "up")
            if np.linalg.norm(np.cross(view, up)) <= PARALLEL * length * up_length:
                raise complaint(f"{show(up)} is parallel to the view: choose another direction", "up")
            return self

    def frame(self) -> View:
        """Return the camera with its axes: of one that answers in these, see `OwnAxes`."""
        return OwnAxes(self, *axes_of(self))

    def ray(self, image: Pair, u: Pair) -> Ray:
        """Return the ray through an image point."""
        return self.frame().ray(image, u)

    def project(self, point: Array) -> tuple[Pair, Array]:
        """Return the image point, and whether the point is in view."""
        return self.frame().project(point)


def axes_of(camera: Any) -> Axes:
    """Return the unit vectors (3,) to the right, up, and along the view."""
    forward = normalize(camera.target - camera.position)
    right = normalize(cross(forward, normalize(camera.up)))
    axes = right, cross(right, forward), forward
    if camera.roll is not None:
        axes = _turned(axes, camera.roll * jnp.zeros_like(forward).at[2].set(1))
    return axes if camera.rotate is None else _turned(axes, camera.rotate)


def _turned(axes: Axes, degrees: Array) -> Axes:
    """Return axes turned about a vector (3,) of their own coordinates, by its length in degrees."""
    right, up, forward = axes
    turn = jnp.radians(degrees)
    more = turn_less_one(turn[0] * right + turn[1] * up - turn[2] * forward)
    right, up, forward = (axis + turned_by(more, axis) for axis in axes)
    return right, up, forward


@pytree
class OwnAxes(View):
    """A central camera by what it does in its own axes: x to the right, y down and z ahead, as OpenCV has them.

    It answers `direction(image) -> (x, y, z)` of any length, and `image_of((x, y, z)) -> (image point, in view)`.
    """

    camera: Any
    right: Array  # (3,) unit vectors
    up: Array
    forward: Array

    position = property(lambda self: self.camera.position)
    width = property(lambda self: self.camera.width)
    height = property(lambda self: self.camera.height)

    def toward(self, image: Pair) -> Array:
        """Return the unit direction (3,) to what an image point shows."""
        x, y, z = self.camera.direction(image)
        return normalize(x * self.right - y * self.up + z * self.forward)

    def ray(self, image: Pair, u: Pair) -> Ray:
        """Return the ray through an image point."""
        return Ray(self.position, self.toward(image))

    def project(self, point: Array) -> tuple[Pair, Array]:
        """Return the image point, and whether the point is in view."""
        away = point - self.position
        seen: tuple[Pair, Array] = self.camera.image_of(
            (dot(away, self.right), -dot(away, self.up), dot(away, self.forward))
        )
        return seen
