"""Looks at the picture: what a ray of the camera meets up to what scatters it, and how two of them differ."""

from functools import partial

import jax
import jax.numpy as jnp
from jax import Array, lax
from jax.typing import DTypeLike

from jaxrt.boundary.lines.between import distances, may_cross
from jaxrt.boundary.lines.chains import MISSED, Chain, Lamp, Numbers, blocker, chain_from, part_by_light
from jaxrt.boundary.shadows import Plan
from jaxrt.boundary.trail import central_ray
from jaxrt.cameras import View
from jaxrt.core.maths import FAR
from jaxrt.core.pytree import pytree
from jaxrt.core.records import Ray
from jaxrt.core.samplers import Stream, independent
from jaxrt.kernels.native import once
from jaxrt.lights import casters_of
from jaxrt.materials import Materials
from jaxrt.transport.path import Tables

FAINT = 0.02  # weight of a difference that another sampler has, in all likelihood


@pytree
class Line:
    """A line of one pixel's length in the picture."""

    start: Array  # (2,) image point
    along: Array  # (2,) one of the picture's axes


@pytree
class Look:
    """What is seen at a place of a line."""

    place: Array  # () on the line, in [0, 1]
    chain: Chain
    lit: Array  # () bool: the light's point is seen from its end


def length_of(plan: Plan, tables: Tables) -> int:
    """Return how many events a chain may have: after the last one, lights and skies are seen."""
    return plan.max_depth + 1 if goes_on(plan, tables.materials) else 1


def goes_on(plan: Plan, materials: Materials) -> bool:
    """Return whether chains go on from what the camera's rays meet first."""
    return materials.are_delta and not plan.outputs


def has_shadows(plan: Plan, tables: Tables) -> bool:
    """Return whether lights of a place cast shadows at the end of chains."""
    if tables.lights is None or not (goes_on(plan, tables.materials) and tables.materials.are_lit):
        return False
    return casters_of(tables.lights.lights)[0].shape[0] > 0


def numbers_of(stream: Stream, dtype: DTypeLike) -> Numbers:
    """Return the random numbers of a chain's events, by which it goes on."""

    def numbers(k: int | Array) -> tuple[Array, Array, Array, Array]:
        a, b, c, d = (x.astype(dtype) for x in independent(stream, k))
        return a, b, c, d

    return numbers


def look_at(plan: Plan, tables: Tables, line: Line, place: Array, stream: Stream, lamp: Lamp | None) -> Look:
    """Return what is seen at a place of a line."""
    ray = once(ray_at)(tables.camera, line, place)
    chain = chain_from(tables, ray, numbers_of(stream, place.dtype), length_of(plan, tables))
    return Look(place, chain, is_lit(plan, tables, chain, lamp))


def is_lit(plan: Plan, tables: Tables, chain: Chain, lamp: Lamp | None) -> Array:
    """Return whether a light's point, if there is one, is seen from a chain's end."""
    return jnp.ones((), bool) if lamp is None else blocker(tables, chain, lamp, plan.max_depth)[2] == MISSED


def differs(a: Look, b: Look) -> Array:
    """Return whether two looks do not see the same."""
    return jnp.any(a.chain.met != b.chain.met) | (a.lit != b.lit)


def interest(plan: Plan, tables: Tables, line: Line, looks: tuple[Look, Look]) -> Array:
    """Return 0 where two looks are alike, 1 where they differ by what is sampled here, FAINT where hardly so."""
    a, b = looks
    pair = jnp.stack([a.chain.met[0], b.chain.met[0]])
    rays = jax.vmap(partial(ray_at, tables.camera, line))(jnp.stack([a.place, b.place]))
    near, beyond = lax.map(lambda ray: distances(tables.geometry, ray, pair)[0], rays)
    # Do they meet in between if they go on as they are?
    meet = (near[0] < near[1]) & (near[1] < FAR) & (beyond[1] < beyond[0]) & (beyond[0] < FAR)
    others = (pair[0] != pair[1]) & ~(meet & may_cross(tables.geometry, pair))
    if not plan.geometry_moves:
        others = others | ~part_by_light(tables, a.chain, b.chain)
    return jnp.where(differs(a, b), jnp.where(others, FAINT, 1), 0).astype(line.start.dtype)


def line_at(start: Array, across: Array) -> Line:
    """Return the line from an image point to the right, if it goes across, else down."""
    one, nothing = jnp.ones_like(start[0]), jnp.zeros_like(start[0])
    return Line(start, jnp.where(across, jnp.stack([one, nothing]), jnp.stack([nothing, one])))


def ray_at(camera: View, line: Line, s: Array) -> Ray:
    """Return the camera's ray through a place of a line."""
    image = line.start + s * line.along
    return central_ray(camera, image[0], image[1])
