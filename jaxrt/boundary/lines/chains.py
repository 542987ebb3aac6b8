"""Chains: what the camera's ray meets on its way over mirrors and through glass, up to the surface that scatters it.

The path's numbers are held fixed, so that a chain depends on the image point alone. Two chains that meet the same
surfaces in the same order are alike; where neighbours are not, something ends in between that the camera sees.
"""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
from jax import Array, lax

from jaxrt.boundary.clearance import Turn
from jaxrt.boundary.shadows import towards
from jaxrt.core.maths import dot, normalize, safe_divide, safe_sqrt
from jaxrt.core.pytree import pytree
from jaxrt.core.records import Hit, Ray, SurfacePoint
from jaxrt.kernels.few import where_any
from jaxrt.kernels.native import in_stages, once
from jaxrt.lights import casters_of, intensity_toward, pick
from jaxrt.materials import Scattering, evaluate, scatter
from jaxrt.shapes import Geometry, distance_to, find, leave, surface_point
from jaxrt.transport.medium import medium_at
from jaxrt.transport.path import Tables, meets_light

ENDED, MISSED = -2, -1  # in place of a primitive
AWAY = 1e18  # where rays start that are not wanted: they meet nothing, in no time
BEYOND = 1e-3  # share of the distance to a light by which what blocks it is nearer

Numbers = Callable[[int | Array], tuple[Array, Array, Array, Array]]


@pytree
class Chain:
    """A chain of up to c events."""

    turns: Turn  # (c,)
    met: Array  # (c,) int32 primitive, MISSED or ENDED
    through: Array  # (c,) bool: the ray went on through the surface
    last: Array  # () int32 number of the last event, from 0
    weight: Array  # (3,) throughput up to there
    absorption: Array | None  # (3,) per unit of length, of what its last ray comes through; None where nothing absorbs


@pytree
class Lamp:
    """A point of a light."""

    light: Array  # () int32
    position: Array  # (3,)
    omega: Array  # (3,) unit; 0 for a light without size
    shine: Array  # (3,) intensity over the density of the choice; of a sphere, to be multiplied by cosine/π


def chain_from(tables: Tables, ray: Ray, numbers: Numbers, length: int) -> Chain:
    """Return the chain of a camera ray. numbers: of each event, from 1, as for `radiance`."""

    Power = tuple[Array, Array | None]  # throughput, and absorption of what the ray goes through
    Carry = tuple[Ray, Array, Power]

    def event(carry: Carry, k: Array) -> tuple[Carry, tuple[Turn, Array, Array]]:
        ray, going, power = carry
        _, _, *u = numbers(k + 1)

        def meet(
            tables: Tables, ray: Ray, going: Array, power: Power, u: tuple[Array, Array]
        ) -> tuple[Ray, Array, Power, Hit, Array]:
            weight, absorption = power
            start = jnp.where(going, ray.origin, AWAY) if length > 1 else ray.origin
            hit = once(find)(tables.geometry, Ray(start, ray.direction))
            point = once(surface_point)(tables.geometry, ray, hit)
            scattering = in_stages(scatter)(tables.materials, point, -ray.direction, u)
            on = going & hit.valid & scattering.specular
            if absorption is not None:
                medium = medium_at(tables.materials, absorption, point, -ray.direction)
                weight = jnp.where(going & hit.valid, weight * medium.passed(), weight)
                absorption = jnp.where(on, medium.beyond(scattering.direction), absorption)
            weight = jnp.where(on, weight * scattering.weight, weight)
            side = dot(point.shading, ray.direction) * dot(point.shading, scattering.direction)
            onward = once(leave)(point, scattering.direction)
            return onward, on, (weight, absorption), hit, on & (side > 0)

        def skip(tables: Tables, ray: Ray, going: Array, power: Power, _: Any) -> tuple[Ray, Array, Power, Hit, Array]:
            return ray, going, power, _miss(tables.geometry, ray), going

        onward, on, power, hit, through = where_any(going, meet, skip, tables, ray, going, power, (u[0], u[1]))
        met = jnp.where(going, jnp.where(hit.valid, hit.index, MISSED), ENDED)
        return (onward, on, power), (Turn(ray, hit.index, (u[0], u[1])), met, through)

    ones = jnp.ones_like(ray.origin)
    start = ray, jnp.ones((), bool), (ones, jnp.zeros_like(ones) if tables.materials.absorb else None)
    (_, _, power), (turns, met, through) = lax.scan(event, start, jnp.arange(length, dtype=jnp.int32))
    last = jnp.sum(jnp.where(met != ENDED, 1, 0)).astype(jnp.int32) - 1
    return Chain(turns, met, through, last, *power)


def is_light(tables: Tables, met: Array) -> Array:
    """Return which of the primitives that chains have met are sphere lights, bool of their shape."""
    return meets_light(tables, Hit(met, met >= 0))


def part_by_light(tables: Tables, a: Chain, b: Chain) -> Array:
    """Return whether the first that two chains meet apart from each other is a sphere light, or they are alike."""
    same, lights = jnp.ones((), bool), jnp.zeros((), bool)
    for one, other in zip(a.met, b.met, strict=True):
        lights = jnp.where(same, is_light(tables, one) | is_light(tables, other), lights)
        same = same & (one == other)
    return same | lights


def end_of(tables: Tables, chain: Chain) -> tuple[SurfacePoint, Ray, Array]:
    """Return the surface that ends a chain, the ray that arrives there, and whether there is one that is lit."""
    ray = Ray(chain.turns.ray.origin[chain.last], chain.turns.ray.direction[chain.last])
    index = chain.met[chain.last]
    point = once(surface_point)(tables.geometry, ray, Hit(jnp.maximum(index, 0), index >= 0))
    ends = tables.materials.ends
    lit = (point.material < ends[0]) | ((point.material >= ends[1]) & (point.material < ends[2]))
    return point, ray, (index >= 0) & lit


def lamp_for(tables: Tables, point: Array, u: tuple[Array, Array, Array, Array]) -> Lamp:
    """Return a point of a light, likelier on the side that faces a point; of a light that has no place, a dark one."""
    assert tables.lights is not None
    lights = tables.lights.lights
    places, radii, _ = casters_of(lights)
    light, share, _ = pick(tables.lights.pick, u[1])
    row = jnp.minimum(light, places.shape[0] - 1)
    center = places[row]
    spheres = 0 if lights.position is None else lights.position.shape[0]
    intensity = jnp.zeros_like(center) if lights.position is None else lights.intensity[jnp.minimum(row, spheres - 1)]
    if lights.others:
        intensity = jnp.where(row < spheres, intensity, intensity_toward(lights, row, point))
    shine = jnp.where(light < places.shape[0], intensity / share, 0)
    if radii is None:
        return Lamp(row, center, jnp.zeros_like(center), shine)
    omega, pdf = towards(point - center, (u[2], u[3]))
    size = radii[row]
    has_size = size > 0
    omega = jnp.where(has_size, omega, 0)
    return Lamp(row, center + size * omega, omega, shine / jnp.where(has_size, pdf, 1))


def lamp_middle(tables: Tables, u: tuple[Array, Array, Array, Array]) -> Lamp:
    """Return the middle of a light, as if it were a point."""
    assert tables.lights is not None
    places, _, _ = casters_of(tables.lights.lights)
    row = jnp.minimum(pick(tables.lights.pick, u[1])[0], places.shape[0] - 1)
    return Lamp(row, places[row], jnp.zeros_like(places[row]), jnp.ones_like(places[row]))


def blocker(tables: Tables, chain: Chain, lamp: Lamp, max_depth: int) -> tuple[Ray, Array, Array]:
    """Return the ray from a chain's end to a light's point, its length, and what blocks it: a primitive or MISSED.

    Nothing does where a chain is too short to have this shadow to itself, ends at nothing that the light faces, or
    only where nothing is lit any more.
    """
    point, arriving, lit = end_of(tables, chain)
    away = lamp.position - point.position
    length = safe_sqrt(dot(away, away))
    ray = leave(point, normalize(away))
    behind = (chain.last > 0) & (chain.last < max_depth)
    wanted = lit & behind & (_sent(tables, chain, point, arriving, lamp, ray.direction, length) > 0).any()
    start = jnp.where(wanted, ray.origin, AWAY)
    hit = where_any(wanted, once(find), _miss, tables.geometry, Ray(start, ray.direction))
    nearer = distance_to(tables.geometry, ray, hit.index) < length * (1 - BEYOND)
    own = tables.lights is not None and tables.lights.lights.have_size
    other = hit.index != tables.first_light + lamp.light if own else True
    return ray, length, jnp.where(wanted & hit.valid & nearer & other, hit.index, MISSED)


def _miss(geometry: Geometry, ray: Ray) -> Hit:
    return Hit(jnp.zeros((), jnp.int32), jnp.zeros((), bool))


def sent_by(tables: Tables, chain: Chain, lamp: Lamp) -> Array:
    """Return the light (3,) that a light's point sends along a chain to the camera, if nothing blocks it."""
    point, arriving, lit = end_of(tables, chain)
    away = lamp.position - point.position
    length = safe_sqrt(dot(away, away))
    sent = _sent(tables, chain, point, arriving, lamp, normalize(away), length)
    return jnp.where(lit, chain.weight * sent, 0)


def _sent(
    tables: Tables, chain: Chain, point: SurfacePoint, arriving: Ray, lamp: Lamp, direction: Array, length: Array
) -> Array:
    """Return what a light's point sends from a chain's end along its last ray, by a ray so long."""
    wo = -arriving.direction
    scattering: Scattering = scatter(tables.materials, point, wo, (jnp.zeros_like(length), jnp.zeros_like(length)))
    sphere = dot(lamp.omega, lamp.omega) > 0
    faced = jnp.where(sphere, jnp.maximum(-dot(lamp.omega, direction), 0) / jnp.pi, 1)
    irradiance = lamp.shine * safe_divide(faced, length * length)
    value = jnp.zeros_like(wo)
    if scattering.albedo is not None:
        value = scattering.albedo * (jnp.maximum(dot(point.facing(wo), direction), 0) / jnp.pi)
    if scattering.glossy is not None:
        shiny = in_stages(evaluate)(tables.materials, point, wo, direction)[0]
        value = jnp.where(scattering.glossy, shiny, value)
    if chain.absorption is not None:
        medium = medium_at(tables.materials, chain.absorption, point, wo)
        value = value * jnp.exp(-medium.beyond(direction) * length)
    return irradiance * value
