"""Looks at the picture: what a ray of the camera meets up to what scatters it, and how two of them differ."""

from functools import partial

import jax
import jax.numpy as jnp
from jax import Array, lax
from jax.typing import DTypeLike

from jaxrt.boundary.lines.between import distances, may_cross
from jaxrt.boundary.lines.chains import MISSED, Chain, Lamp, Numbers, blocker, chain_from, part_by_light
from jaxrt.boundary.shadows import Plan
from jaxrt.boundary.trail import LENS, central_ray
from jaxrt.cameras import View
from jaxrt.core.maths import FAR
from jaxrt.core.pytree import pytree
from jaxrt.core.records import Ray
from jaxrt.core.samplers import Stream, independent
from jaxrt.kernels.few import where_any
from jaxrt.kernels.native import once
from jaxrt.lights import casters_of
from jaxrt.materials import Materials
from jaxrt.transport.path import Tables

WITHIN = LENS + 1  # block of random numbers that choose a place, and where to look next
DIM = 0.1  # weight of other edges beside those of lights that are seen: these are as much brighter
FAINT = 0.04  # weight of a difference that another sampler has, in all likelihood


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
    lit: Array  # () bool, or of several lights: the light's point is seen from its end


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
    """Return the numbers by which a chain goes on, of each event."""

    def numbers(k: int | Array) -> tuple[Array, Array, Array, Array]:
        a, b, c, d = (x.astype(dtype) for x in independent(stream, k))
        return a, b, c, d

    return numbers


def look_at(plan: Plan, tables: Tables, line: Line, place: Array, numbers: Numbers) -> Look:
    """Return what is seen at a place of a line, as if it were lit."""
    ray = once(ray_at)(tables.camera, line, place)
    return Look(place, chain_from(tables, ray, numbers, length_of(plan, tables)), jnp.ones((), bool))


def is_lit(plan: Plan, tables: Tables, chain: Chain, lamp: Lamp) -> Array:
    """Return whether a light's point is seen from a chain's end."""
    return blocker(tables, chain, lamp, plan.max_depth)[2] == MISSED


def differs(a: Look, b: Look) -> Array:
    """Return whether two looks do not see the same."""
    return jnp.any(a.chain.met != b.chain.met) | jnp.any(a.lit != b.lit)


def brightest(plan: Plan) -> float:
    """Return what the edge of a light that is seen is worth."""
    return 1 / DIM if plan.geometry_moves else 1.0


def interest(plan: Plan, tables: Tables, line: Line, looks: tuple[Look, Look]) -> Array:
    """Return 0 where two looks are alike, 1 where they differ by what is sampled here, FAINT where hardly so.

    Of a light that is seen, 1/DIM; where lights alone move, 1, and DIM for the edge of a shadow.
    """

    def worth(tables: Tables, line: Line, looks: tuple[Look, Look]) -> Array:
        a, b = looks
        pair = jnp.stack([a.chain.met[0], b.chain.met[0]])
        rays = jax.vmap(partial(ray_at, tables.camera, line))(jnp.stack([a.place, b.place]))
        near, beyond = lax.map(lambda ray: distances(tables.geometry, ray, pair)[0], rays)
        # Do they meet in between if they go on as they are?
        meet = (near[0] < near[1]) & (near[1] < FAR) & (beyond[1] < beyond[0]) & (beyond[0] < FAR)
        crosses = may_cross(tables.geometry, pair)
        # Nothing ends where one face of a mirror goes on in another, but beyond it may
        adjoins = (jnp.min(pair) >= 0) & ~crosses
        beyond_it = jnp.any(a.chain.met[1:] != b.chain.met[1:]) | jnp.any(a.lit != b.lit)
        others = (pair[0] != pair[1]) & ~jnp.where(adjoins, beyond_it, meet & crosses)
        by_light = part_by_light(tables, a.chain, b.chain)
        if not plan.geometry_moves:
            others = others | ~by_light
        bright = by_light & jnp.any(a.chain.met != b.chain.met)
        worth = brightest(plan)
        return jnp.where(others, FAINT, jnp.where(bright, worth, DIM * worth)).astype(line.start.dtype)

    apart = differs(*looks)
    found = where_any(apart, worth, lambda _, line, looks: jnp.zeros_like(line.start[0]), tables, line, looks)
    return jnp.where(apart, found, 0)


def line_at(start: Array, across: Array) -> Line:
    """Return the line from an image point, `across` to the right, else down."""
    one, nothing = jnp.ones_like(start[0]), jnp.zeros_like(start[0])
    return Line(start, jnp.where(across, jnp.stack([one, nothing]), jnp.stack([nothing, one])))


def line_through(camera: View, pixel: Array, t: Array) -> Line:
    """Return a line through a pixel, at a place spread evenly by t in [0, 1): half of them run along, half down."""
    across = t < 0.5
    offset, nothing = jnp.where(across, 2 * t, 2 * t - 1), jnp.zeros_like(t)
    corner = jnp.stack([pixel % camera.width, pixel // camera.width]).astype(t.dtype)
    return line_at(corner + jnp.where(across, jnp.stack([nothing, offset]), jnp.stack([offset, nothing])), across)


def ray_at(camera: View, line: Line, s: Array) -> Ray:
    """Return the camera's ray through a place of a line."""
    image = line.start + s * line.along
    return central_ray(camera, image[0], image[1])
