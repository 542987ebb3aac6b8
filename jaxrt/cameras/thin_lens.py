"""Thin lens."""

from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array
from pydantic import Field, ValidationInfo, field_validator

from jaxrt.cameras.interface import Pair, View
from jaxrt.cameras.looking import Looking, axes_of
from jaxrt.core.maths import dot, normalize, safe_divide, safe_sqrt
from jaxrt.core.pytree import pytree, static
from jaxrt.core.records import Ray
from jaxrt.core.sampling import sincos_2pi
from jaxrt.description.fields import Angle, Positive
from jaxrt.description.kinds import camera
from jaxrt.description.values import Count


@camera
class ThinLens(Looking):
    """A pinhole camera with a round lens, which is sharp in one plane: a point beside it is seen as a disk.

    What is at depth z is a disk of diameter aperture · |z − focus| / z in the plane in focus.
    """

    fov: Angle = 60.0  # () vertical, degrees
    focus: Positive = Field(default=None, validate_default=True)  # () depth of the plane in focus, scene units
    aperture: Positive = 0.1  # () diameter of the lens, scene units
    width: Count = 512
    height: Count = 512
    is_central = True  # at each place of the lens

    class Table(Looking.Table):
        """Its table, further checked."""

        @field_validator("focus", mode="before", check_fields=False)
        @classmethod
        def _see_target_sharp(cls, value: Any, info: ValidationInfo) -> Any:
            known = {"position", "target"} <= info.data.keys()
            away = np.subtract(info.data["target"], info.data["position"]) if known else np.ones(1)
            return float(np.linalg.norm(away)) if value is None else value

    def frame(self) -> "LensFrame":
        """Return the axes of the picture, and the lens."""
        right, up, forward = axes_of(self)
        pixel = 2 * jnp.tan(jnp.radians(self.fov) / 2) / self.height
        middle = jnp.zeros_like(right[:2])
        return LensFrame(
            self.position, right, up, forward, pixel, self.focus, self.aperture / 2, middle, self.width, self.height
        )


@pytree
class LensFrame(View):
    """The camera as the path reads it, through one place of its lens."""

    middle: Array  # (3,) of the lens
    right: Array  # (3,) unit vectors
    up: Array
    forward: Array
    pixel: Array  # () width of a pixel at distance 1
    focus: Array  # ()
    radius: Array  # () of the lens
    place: Array  # (2,) numbers of the place: its turn, and its share of the area within
    width: int = static()
    height: int = static()

    lens = property(lambda self: self.place)

    @property
    def position(self) -> Array:
        """The eye (3,)."""
        across, rise = self._place()
        return self.middle + across * self.right + rise * self.up

    def through(self, u: Pair) -> "LensFrame":
        """Return the view through one place of the lens."""
        return replace(self, place=jnp.stack(u))

    def toward(self, image: Pair) -> Array:
        """Return the direction (3,) to what an image point shows, 1 along the camera's axis."""
        across, rise = self._place()
        x = self.pixel * (image[0] - self.width / 2) - across / self.focus
        y = self.pixel * (self.height / 2 - image[1]) - rise / self.focus
        return x * self.right + y * self.up + self.forward

    def ray(self, image: Pair, u: Pair) -> Ray:
        """Return the ray through an image point, from a place on the lens."""
        here = self.through(u)
        return Ray(here.position, normalize(here.toward(image)))

    def project(self, point: Array) -> tuple[Pair, Array]:
        """Return the image point, and whether the point is in front of the camera."""
        away, depth, (across, rise) = point - self.position, self.depth(point), self._place()
        ahead = depth > 0
        safe = jnp.where(ahead, depth, 1)
        x = dot(away, self.right) / safe + across / self.focus
        y = dot(away, self.up) / safe + rise / self.focus
        return (self.width / 2 + safe_divide(x, self.pixel), self.height / 2 - safe_divide(y, self.pixel)), ahead

    def depth(self, point: Array) -> Array:
        """Return how far along the camera's axis a point is."""
        return dot(point - self.middle, self.forward)

    def density(self, point: Array) -> Array:
        """Return the pixels per steradian, as seen from the place on the lens."""
        away, depth = point - self.position, self.depth(point)
        slant = safe_divide(safe_sqrt(dot(away, away)), jnp.where(depth > 0, depth, 1))
        return safe_divide(slant * slant * slant, self.pixel * self.pixel)

    def _place(self) -> Pair:
        """Return the place on the lens, to the right and up, in scene units."""
        cos, sin = sincos_2pi(self.place[0])
        radius = self.radius * safe_sqrt(self.place[1])
        return radius * cos, radius * sin
