"""A camera as calibrations give it: a pinhole by its matrix K, with the distortion of Brown and Conrady."""

from collections.abc import Iterator, Sequence
from typing import Annotated, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from pydantic import BeforeValidator, Field, ValidationInfo, field_validator

from jaxrt.cameras.interface import Pair
from jaxrt.cameras.looking import Looking
from jaxrt.core.maths import safe_divide
from jaxrt.description.fields import Coefficient, Positive, Real
from jaxrt.description.kinds import camera
from jaxrt.description.values import Count, complaint, plain, show

STEPS = 8  # of Newton's method
SIDE = 8.0  # tangent of the widest angle to the axis, 83 degrees: whatever a step is, it stays within
SAME = 1e-3  # of a tangent: as near to a place its image's ray must pass, for the place to be in view


def _two(value: Any) -> tuple[Any, ...]:
    value = plain(value)
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise complaint(f"{show(value)} is no pair: write two whole numbers in brackets")
    return tuple(value)


Size = Annotated[tuple[Count, Count], BeforeValidator(_two)]


class Distortion(NamedTuple):
    """Coefficients in OpenCV's order; what is absent is 0."""

    k1: Array | float
    k2: Array | float
    p1: Array | float
    p2: Array | float
    k3: Array | float

    def __call__(self, x: Array, y: Array) -> Pair:
        """Return the place at distance 1 to which a place is moved (Brown 1966)."""
        squared = x * x + y * y
        radial = 1 + squared * (self.k1 + squared * (self.k2 + squared * self.k3))
        twice = 2 * x * y
        return (
            x * radial + self.p1 * twice + self.p2 * (squared + 2 * x * x),
            y * radial + self.p1 * (squared + 2 * y * y) + self.p2 * twice,
        )

    def nearer(self, x: Array, y: Array, goal: Pair) -> Pair:
        """Return the place (x, y) after a step of Newton's method towards the one that is moved to `goal`."""
        squared = x * x + y * y
        radial = 1 + squared * (self.k1 + squared * (self.k2 + squared * self.k3))
        slope = 2 * (self.k1 + squared * (2 * self.k2 + squared * 3 * self.k3))
        xx = radial + x * x * slope + 2 * self.p1 * y + 6 * self.p2 * x
        yy = radial + y * y * slope + 6 * self.p1 * y + 2 * self.p2 * x
        xy = x * y * slope + 2 * self.p1 * x + 2 * self.p2 * y
        off_x, off_y = (moved - wanted for moved, wanted in zip(self(x, y), goal, strict=True))
        area = xx * yy - xy * xy
        x = x - safe_divide(yy * off_x - xy * off_y, area)
        y = y - safe_divide(xx * off_y - xy * off_x, area)
        return jnp.clip(x, -SIDE, SIDE), jnp.clip(y, -SIDE, SIDE)


@jax.custom_jvp
def undone(distortion: Distortion, goal: Pair) -> Pair:
    """Return the place that is moved to `goal`, by Newton's method: a loop, for each ray of each edge is found so."""

    def step(_: Array, place: Pair) -> Pair:
        return distortion.nearer(place[0], place[1], goal)

    place: Pair = lax.fori_loop(0, STEPS, step, goal)
    return place


@undone.defjvp
def _undone_jvp(primals: tuple[Distortion, Pair], tangents: tuple[Distortion, Pair]) -> tuple[Pair, Pair]:
    """Return it with its change, which is that of a step from there."""
    place = undone(*primals)
    _, change = jax.jvp(lambda distortion, goal: distortion.nearer(*place, goal), primals, tangents)
    return place, change


@camera
class Calibrated(Looking):
    """A pinhole camera of focal lengths and a principal point in pixels, (0, 0) being the picture's upper left corner.

    The numbers are told for a picture of `size`: one of more or fewer pixels shows the same.
    """

    fx: Positive  # () focal lengths, in pixels
    fy: Positive
    width: Count = 512
    height: Count = 512
    size: Size = Field(default=None, validate_default=True)  # columns and rows; by default width and height
    cx: Real = Field(default=None, validate_default=True)  # () where the axis goes; by default through the middle
    cy: Real = Field(default=None, validate_default=True)
    k1: Coefficient | None = None  # () radial; None: no code
    k2: Coefficient | None = None
    p1: Coefficient | None = None  # () tangential
    p2: Coefficient | None = None
    k3: Coefficient | None = None
    is_central = True

    class Table(Looking.Table):
        """Its table, further checked."""

        @field_validator("size", mode="before", check_fields=False)
        @classmethod
        def _of_the_picture(cls, value: Any, info: ValidationInfo) -> Any:
            return (info.data.get("width", 1), info.data.get("height", 1)) if value is None else value

        @field_validator("cx", "cy", mode="before", check_fields=False)
        @classmethod
        def _in_the_middle(cls, value: Any, info: ValidationInfo) -> Any:
            size = info.data.get("size", (1, 1))
            return size[0 if info.field_name == "cx" else 1] / 2 if value is None else value

        def doubts(self: Any, sizes: Sequence[float]) -> Iterator[str]:
            """Tell of corners that have no rays. sizes: of no matter."""
            coefficients = Distortion(*(getattr(self, name) or 0.0 for name in Distortion._fields))
            x, y = np.meshgrid(*(np.array([0, n]) for n in self.size))
            wanted = np.hypot((x - self.cx) / self.fx, (y - self.cy) / self.fy).max()
            radii = np.linspace(0, SIDE, 8001)
            moved = radii * (
                1 + radii**2 * (coefficients.k1 + radii**2 * (coefficients.k2 + radii**2 * coefficients.k3))
            )
            folds = np.flatnonzero(np.diff(moved) <= 0)
            if len(folds) and moved[folds[0]] < wanted:
                yield (
                    f"camera: distortion folds back {moved[folds[0]]:.2g} focal lengths from the axis, but the picture "
                    f"goes {wanted:.2g} far: its corners show nothing that is there, check k1, k2 and k3"
                )

    def direction(self, image: Pair) -> tuple[Array, Array, Array]:
        """Return the direction that an image point shows."""
        column, row = image[0] * (self.size[0] / self.width), image[1] * (self.size[1] / self.height)
        place = (column - self.cx) / self.fx, (row - self.cy) / self.fy
        distortion = self._distortion()
        x, y = place if distortion is None else undone(distortion, place)
        return x, y, jnp.ones_like(x)

    def image_of(self, seen: tuple[Array, Array, Array]) -> tuple[Pair, Array]:
        """Return the image point of a place, and whether it is in view: a fold of the distortion shows nothing."""
        x, y, z = seen
        ahead = z > 0
        x, y = (side / jnp.where(ahead, z, 1) for side in (x, y))
        distortion = self._distortion()
        if distortion is not None:
            ahead = ahead & (jnp.maximum(jnp.abs(x), jnp.abs(y)) < SIDE)
            x, y = (jnp.clip(side, -SIDE, SIDE) for side in (x, y))
            moved = distortion(x, y)
            back = undone(*lax.stop_gradient((distortion, moved)))
            ahead = ahead & (jnp.abs(back[0] - x) + jnp.abs(back[1] - y) < SAME)
            x, y = moved
        column, row = self.fx * x + self.cx, self.fy * y + self.cy
        return (column * (self.width / self.size[0]), row * (self.height / self.size[1])), ahead

    def _distortion(self) -> Distortion | None:
        given = [getattr(self, name) for name in Distortion._fields]
        return None if all(x is None for x in given) else Distortion(*(0.0 if x is None else x for x in given))
