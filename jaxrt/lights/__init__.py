"""Point and spherical lights: one record, one formula; radius 0 is a point.

A sphere light of intensity I has radiance I/(πr²). Sampling the cap seen from a point at distance d by solid angle
gives the irradiance I · 2/(d² (1 + √(1 − s²))), s = r/d: finite at r = 0, where it is I/d², and free of the
cancellation in 1 − cosθ_max that breaks small lights.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxrt.core.maths import dot, normalize, safe_divide, safe_sqrt, unit_roundoff
from jaxrt.core.pytree import pytree
from jaxrt.core.records import LightSample
from jaxrt.core.sampling import cone_of_sphere, pdf_visible_cap, sample_cone, sample_visible_cap
from jaxrt.kernels.gather import take


@pytree
class Lights:
    """All lights of a scene. `radius` is None when every light is a point."""

    position: Array  # (n, 3) scene units
    intensity: Array  # (n, 3) W·sr⁻¹
    radius: Array | None  # (n,) scene units, >= 0


@pytree
class LightTable:
    """Lights as the path reads them."""

    lights: Lights
    pick: Array | None  # (n,) cumulative probability of each light, by power; None when there is one light


def light_table(lights: Lights) -> LightTable:
    """Return the lights with the probabilities to pick them: by power, equal where all are dark. No derivative."""
    n = lights.intensity.shape[0]
    if n == 1:
        return LightTable(lights, None)
    power = lax.stop_gradient(jnp.sum(lights.intensity, -1))
    power = jnp.where(jnp.sum(power) > 0, power, 1)
    # A light of no power keeps a small chance, so that its intensity has a derivative
    share = 0.99 * power / jnp.sum(power) + 0.01 / n
    return LightTable(lights, jnp.cumsum(share).at[-1].set(1))


def _pick_light(table: LightTable, u: Array) -> tuple[Array, Array, Array]:
    """Return (light, its probability, the number u made uniform again)."""
    if table.pick is None:
        return jnp.int32(0), jnp.ones_like(u), u
    cumulative = table.pick.astype(u.dtype)
    light = jnp.minimum(jnp.sum(u >= cumulative).astype(jnp.int32), cumulative.shape[0] - 1)
    below = jnp.where(light > 0, cumulative[jnp.maximum(light - 1, 0)], 0)
    share = cumulative[light] - below
    return light, share, jnp.clip((u - below) / share, 0, 1 - 2 * unit_roundoff(u))


def sample_light(table: LightTable, point: Array, u: tuple[Array, Array]) -> LightSample:
    """Return a light sample for a point: one light, and for a sphere one direction uniform in the cone it fills.

    A point inside a sphere light gets nothing from it. The irradiance is divided by the light's probability.
    """
    lights = table.lights
    light, share, u0 = _pick_light(table, u[0])
    position, intensity = take(lights.position, light), take(lights.intensity, light)
    toward = position - point
    squared = dot(toward, toward)
    distance = safe_sqrt(squared)
    axis = normalize(toward)
    rounding = 8 * unit_roundoff(point) * (jnp.sum(jnp.abs(position)) + distance)
    if lights.radius is None:
        return LightSample(axis, distance - rounding, intensity * safe_divide(1 / share, squared), light)
    s = safe_divide(take(lights.radius, light), distance)
    s2 = jnp.minimum(s * s, 1)
    outside = s < 1
    x = cone_of_sphere(s2)
    direction = sample_cone(axis, x, (u0, u[1]))
    # Where the direction meets the light: d (cosα − √(s² − sin²α)), with 1 − cosα as the variable
    one_minus_cos = x * u[1]
    gap = safe_sqrt(s2 - one_minus_cos * (2 - one_minus_cos))
    near = distance * (1 - one_minus_cos - gap)
    root = safe_sqrt(1 - s2)
    irradiance = intensity * jnp.where(outside, safe_divide(2 / share, squared * (1 + root)), 0)
    return LightSample(direction, near - rounding, irradiance, light)


def sample_light_attached(table: LightTable, point: Array, u: tuple[Array, Array]) -> LightSample:
    """Return a light sample for a point whose derivatives hold its place on the light fixed: c + r ω, ω constant.

    ω is uniform over the disk that the visible cap fills. The irradiance is that of the area around ω over the density
    of ω, I/π · cosθ_y / (|x − y|² pdf): finite at r = 0. Sampled from the cone instead, derivatives would either hold
    other things fixed than the moving edges do, or have infinite variance.
    """
    lights = table.lights
    if lights.radius is None:
        return sample_light(table, point, u)
    light, share, u0 = _pick_light(table, u[0])
    center, intensity, radius = (take(field, light) for field in (lights.position, lights.intensity, lights.radius))
    # Choose the place without derivative
    away = lax.stop_gradient(point - center)
    s = safe_divide(lax.stop_gradient(radius), safe_sqrt(dot(away, away)))
    axis = normalize(away)
    omega = sample_visible_cap(axis, jnp.minimum(s, 1), (u0, u[1]))
    pdf = pdf_visible_cap(dot(axis, omega), jnp.minimum(s, 1))
    # Look at it from the point
    direction, distance, facing = _view(center + radius * omega - point, omega)
    weight = jnp.where((s < 1) & (pdf > 0), safe_divide(jnp.ones_like(pdf), jnp.pi * pdf * share), 0)
    rounding = 8 * unit_roundoff(point) * (jnp.sum(jnp.abs(center)) + radius + distance)
    return LightSample(direction, distance - rounding, intensity * (facing * weight), light)


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


def emitted_radiance(lights: Lights, light: Array, eye: Array) -> Array:
    """Return the radiance (3,) W·sr⁻¹·m⁻² that a point `eye` sees of sphere light number `light`: 0 from inside."""
    assert lights.radius is not None
    r, away = take(lights.radius, light), eye - take(lights.position, light)
    outside = dot(away, away) > r * r
    return jnp.where(outside, take(lights.intensity, light) * safe_divide(jnp.ones_like(r), jnp.pi * r * r), 0)
