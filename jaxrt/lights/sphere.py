"""Point and spherical lights: one kind, one formula; radius 0 is a point.

A sphere light of intensity I has radiance I/(πr²). Sampling the cap seen from a point at distance d by solid angle
gives the irradiance I · 2/(d² (1 + √(1 − s²))), s = r/d: finite at r = 0, where it is I/d², and free of the
cancellation in 1 − cosθ_max that breaks small lights.
"""

import math
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array, lax
from pydantic import model_validator

from jaxrt.core.maths import dot, normalize, safe_divide, safe_sqrt, unit_roundoff
from jaxrt.core.sampling import cone_of_sphere, pdf_visible_cap, sample_cone, sample_visible_cap
from jaxrt.description import values
from jaxrt.description.fields import LightRadius, Place, Rgb
from jaxrt.description.kinds import light
from jaxrt.lights.interface import Pair, Sample


@light
class Sphere:
    """A point light (radius 0) or a spherical light; intensity in W/sr."""

    position: Place  # (3,) scene units
    intensity: Rgb  # (3,) W·sr⁻¹
    radius: LightRadius = 0.0  # () scene units, >= 0; None where every light is a point

    class Table(values.Table):
        """Its table, further checked."""

        @model_validator(mode="after")
        def _check_radiance(self: Any) -> Any:
            if self.radius and max(self.intensity) / (math.pi * self.radius**2) > values.BRIGHTEST_SURFACE:
                raise values.complaint(f"{self.radius} makes the radiance too large for float32: use 0", "radius")
            return self

    @property
    def is_delta(self) -> bool:
        """Whether no ray can hit it."""
        return self.radius is None

    def power(self) -> Array:
        """Sum of the channels."""
        return jnp.sum(self.intensity, -1)

    def sample(self, point: Array, u: Pair) -> Sample:
        """Return direction, distance and irradiance of the light, as seen from a point."""
        return self.picked(point, u, jnp.ones_like(u[0]))

    def picked(self, point: Array, u: Pair, share: Array) -> Sample:
        """Return one direction, for a sphere uniform in the cone it fills. A point inside gets nothing from it."""
        toward = self.position - point
        squared = dot(toward, toward)
        distance = safe_sqrt(squared)
        axis = normalize(toward)
        rounding = 8 * unit_roundoff(point) * (jnp.sum(jnp.abs(self.position)) + distance)
        if self.radius is None:
            return axis, distance - rounding, self.intensity * safe_divide(1 / share, squared)
        s = safe_divide(self.radius, distance)
        s2 = jnp.minimum(s * s, 1)
        outside = s < 1
        x = cone_of_sphere(s2)
        direction = sample_cone(axis, x, u)
        # Where the direction meets the light: d (cosα − √(s² − sin²α)), with 1 − cosα as the variable
        one_minus_cos = x * u[1]
        gap = safe_sqrt(s2 - one_minus_cos * (2 - one_minus_cos))
        near = distance * (1 - one_minus_cos - gap)
        root = safe_sqrt(1 - s2)
        irradiance = self.intensity * jnp.where(outside, safe_divide(2 / share, squared * (1 + root)), 0)
        return direction, near - rounding, irradiance

    def attached(self, point: Array, u: Pair, share: Array) -> Sample:
        """Return a sample whose derivatives hold its place on the light fixed: c + r ω, ω constant.

        ω is uniform over the disk that the visible cap fills. The irradiance is that of the area around ω over the
        density of ω, I/π · cosθ_y / (|x − y|² pdf): finite at r = 0. Sampled from the cone instead, derivatives would
        either hold other things fixed than the moving edges do, or have infinite variance.
        """
        if self.radius is None:
            return self.picked(point, u, share)
        # Choose the place without derivative
        away = lax.stop_gradient(point - self.position)
        s = safe_divide(lax.stop_gradient(self.radius), safe_sqrt(dot(away, away)))
        axis = normalize(away)
        omega = sample_visible_cap(axis, jnp.minimum(s, 1), u)
        pdf = pdf_visible_cap(dot(axis, omega), jnp.minimum(s, 1))
        # Look at it from the point
        direction, distance, facing = _view(self.position + self.radius * omega - point, omega)
        weight = jnp.where((s < 1) & (pdf > 0), safe_divide(jnp.ones_like(pdf), jnp.pi * pdf * share), 0)
        rounding = 8 * unit_roundoff(point) * (jnp.sum(jnp.abs(self.position)) + self.radius + distance)
        return direction, distance - rounding, self.intensity * (facing * weight)

    def radiance(self, eye: Array) -> Array:
        """Return the radiance (3,) W·sr⁻¹·m⁻² that an eye sees of a sphere light: 0 from inside."""
        assert self.radius is not None
        r, away = self.radius, eye - self.position
        outside = dot(away, away) > r * r
        return jnp.where(outside, self.intensity * safe_divide(jnp.ones_like(r), jnp.pi * r * r), 0)


@jax.custom_jvp
def _view(v: Array, omega: Array) -> tuple[Array, Array, Array]:
    """Return direction and length of v, and max(−cos∠(v, ω), 0)/|v|²: how a piece of surface looks from v away.

    omega: the unit normal there, held fixed. The derivatives are written out: backwards, they need to remember little.
    """
    squared = dot(v, v)
    direction = normalize(v)
    return direction, safe_sqrt(squared), safe_divide(jnp.maximum(-dot(direction, omega), 0), squared)


@_view.defjvp
def _view_jvp(primals: tuple[Array, Array], tangents: tuple[Array, Array]) -> tuple[Any, Any]:
    (v, omega), dv = primals, tangents[0]
    direction, distance, facing = view = _view(v, omega)
    inverse = safe_divide(jnp.ones_like(distance), distance)
    slope = jnp.where(facing > 0, inverse * inverse * inverse, 0) * (3 * dot(omega, direction) * direction - omega)
    along = dot(direction, dv)
    return view, ((dv - along * direction) * inverse, along, dot(slope, dv))
