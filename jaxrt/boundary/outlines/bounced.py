"""The outlines that surfaces see by the rays they scatter: the sky's shadow, colour bleeding, dark lights, reflections.

A sample is a path from the camera to a diffuse or glossy surface, and from there a ray that grazes an outline. A unit
of clearance exchanges the radiance beyond the outline for that of what blocks it. The path's random numbers are held
fixed, as they are inside of edges: so the ray moves with all surfaces that the path turned on, and turns with the last.
"""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxrt.boundary.anchors import occluder_anchors
from jaxrt.boundary.clearance import EdgeSamples, Path, Turn, beside
from jaxrt.boundary.guiding import Draw, of_packets, one_of_both, place
from jaxrt.boundary.lookouts import Lookouts, lookouts_at, nearest_lookout, point_seen
from jaxrt.boundary.outlines.across import Glance
from jaxrt.boundary.shadows import Plan
from jaxrt.boundary.silhouettes import Rim, Silhouettes, aim_at, rim_at
from jaxrt.boundary.trail import central_ray, through_lens
from jaxrt.core.maths import dot, face_forward, normalize, reflect, safe_divide
from jaxrt.core.pytree import pytree, where
from jaxrt.core.records import Ray, SurfacePoint
from jaxrt.core.samplers import Stream, independent
from jaxrt.core.sampling import numbers_of_direction
from jaxrt.kernels.native import in_stages, once
from jaxrt.materials import evaluate, numbers_toward, scatter, tells_numbers_at
from jaxrt.scene import Scene
from jaxrt.shapes import find, leave, surface_point
from jaxrt.transport.medium import medium_at
from jaxrt.transport.path import Tables

TILES = 8  # the picture is divided into so many parts each way, among which a pilot shares the samples
CANDIDATES = 32  # points of outlines, of which one is taken by how large it looks
CANDIDATES_OF_LIGHTS = 8  # the same where lights alone move: their outlines are few and look alike
LOOKOUTS = 64
WIDE = 3.0  # radians: a lobe of all directions
TURNED = 1e-6  # least cosine at which a surface sees anything


@pytree
class Arrival:
    """A path's event."""

    turn: Turn
    point: SurfacePoint  # where it is
    flux: Array  # (3,) weight of light scattered there, at diffuse surfaces with the albedo, at glossy without f; or 0
    glossy: Array | None  # () bool; None in scenes without glossy surfaces
    absorption: Array | None  # (3,) per unit of length, of what its ray comes through; None where nothing absorbs


@pytree
class Station:
    """Where a path turns toward outlines."""

    arrival: Arrival
    facing: Array  # (3,) the normal on the side that is seen
    eye: Array  # (3,) the point, moved off the surface by its rounding

    def sends(self, tables: Tables, direction: Array) -> Array:
        """Return f cosθ (3,) of light from a direction, of diffuse surfaces without the albedo."""
        cosine = dot(self.facing, direction)
        even = jnp.where(cosine > TURNED, cosine / jnp.pi, 0) * jnp.ones_like(direction)
        if self.arrival.glossy is None:
            return even
        wo = -self.arrival.turn.ray.direction
        value = in_stages(evaluate)(tables.materials, self.arrival.point, wo, direction)[0]
        return jnp.where(self.arrival.glossy, jnp.where(jnp.abs(cosine) > TURNED, value, 0), even)

    def lobe(self, tables: Tables) -> "Lobe":
        """Return where a glossy surface mirrors light to, and about how wide its lobe is there."""
        assert self.arrival.glossy is not None
        wo = -self.arrival.turn.ray.direction
        direction = reflect(wo, self.facing)
        pdf = in_stages(evaluate)(tables.materials, self.arrival.point, wo, direction)[1]
        return Lobe(direction, lax.rsqrt(jnp.maximum(jnp.pi * pdf, WIDE**-2)), self.arrival.glossy)


@pytree
class Lobe:
    """The directions that a glossy surface scatters to, in the main."""

    direction: Array  # (3,)
    angle: Array  # () radians from it
    there: Array  # () bool


@pytree
class Grazing:
    """A ray that grazes an outline."""

    row: Array
    t: Array
    rim: Rim
    weight: Array  # (3,) angle that the outline sweeps a unit of clearance, times f cosθ, over its density


def events_seen(scene: Scene, plan: Plan) -> int:
    """Return the number of events from which outlines are looked for.

    None of glossy kinds that do not tell by which numbers they scatter to somewhere.
    """
    dark = scene.environment is None and scene.lights is None
    if dark or not scene.materials.see_outlines:
        return 0
    # After the last event, what is not of single directions sees the sky alone
    return plan.max_depth if scene.environment is not None else plan.max_depth - 1


def lookouts_of(plan: Plan, tables: Tables, outlines: Silhouettes, seed: Array, events: int) -> Lookouts:
    """Return what is seen of moving outlines, or of sphere lights alone, from where paths come to."""
    first, creases = 0 if plan.geometry_moves else tables.first_light, plan.max_depth > 1
    return lookouts_at(outlines, _places(tables, seed, events, plan.devices), first, creases)


def seen_by_surfaces(
    plan: Plan, events: int, tables: Tables, outlines: Silhouettes, lookouts: Lookouts, draw: Draw
) -> tuple[Glance, EdgeSamples]:
    """Return a surface's look past an outline, and the samples of a change by 1 across it."""
    tables = through_lens(tables, draw.stream)
    camera = tables.camera
    # A path from the camera
    placed = once(place)(draw)
    last, tile = placed.bin // (TILES * TILES), placed.bin % (TILES * TILES)
    x = ((tile % TILES).astype(placed.t.dtype) + placed.t) * (camera.width / TILES)
    y = ((tile // TILES).astype(placed.t.dtype) + draw.spread[0]) * (camera.height / TILES)
    arrivals = _path(tables, central_ray(camera, x, y), draw.stream, events)
    arrival = jax.tree.map(lambda a: a[last], arrivals)
    point, wo = arrival.point, -arrival.turn.ray.direction
    facing = face_forward(point.shading, wo)
    # Where the path has met nothing, its point is of no use
    brings = jnp.sum(arrival.flux) > 0
    eye = jnp.where(brings, once(leave)(point, facing).origin, camera.start((x, y)))
    # From its end past an outline
    grazing = _grazing(plan, tables, outlines, lookouts, Station(arrival, facing, eye), draw)
    direction, absorption = normalize(grazing.rim.point - eye), None
    if tables.materials.are_translucent:
        eye = jnp.where(brings, once(leave)(point, direction).origin, eye)
    if arrival.absorption is not None:
        absorption = medium_at(tables.materials, arrival.absorption, point, wo).beyond(direction)
    density = placed.density * draw.total * (TILES * TILES / (camera.width * camera.height))
    seen = jnp.any(grazing.weight > 0) & (density > 0)
    weight = jnp.where(seen, arrival.flux * safe_divide(grazing.weight, density), 0)
    column, row = (
        jnp.minimum(x.astype(jnp.int32), camera.width - 1),
        jnp.minimum(y.astype(jnp.int32), camera.height - 1),
    )
    pixel = jnp.where(seen, row * camera.width + column, camera.width * camera.height)
    seen_at = None if plan.filter is None else beside(jnp.stack([x, y])[None], plan.filter)
    # How it moves
    anchors = occluder_anchors(outlines, plan.geometry_moves, grazing.row, grazing.t, grazing.rim)
    # `last` counts from 0, and its ray comes after it; what is not seen has no first event
    first = jnp.where(seen, last + 2, plan.max_depth + 2)
    glance = Glance(eye, grazing.row, grazing.rim, jnp.zeros((), bool), absorption, draw.stream, first)
    if not plan.geometry_moves:
        return glance, EdgeSamples(pixel[None], weight[None], None, None, (anchors,), place=seen_at)
    numbers = once(numbers_of_direction)(facing, direction)
    if arrival.glossy is not None:
        coin = independent(draw.stream, 0)[1].astype(eye.dtype)
        numbers = once(numbers_toward)(tables.materials, point, wo, direction, coin, numbers)
    factor = jnp.where(seen, grazing.rim.normal, 0)
    change = Ray(factor, grazing.rim.distance * factor)
    turns = _aimed(arrivals.turn, last, numbers)
    path = Path(turns, last, change, jnp.stack([x, y]), lens=camera.lens)
    return glance, EdgeSamples(pixel[None], weight[None], None, None, (anchors,), path=path, place=seen_at)


def _path(tables: Tables, ray: Ray, stream: Stream, events: int) -> Arrival:
    """Return the events (events,) of a path from the camera."""

    def event(carry: tuple[Ray, Array, Array | None], k: Array) -> tuple[tuple[Ray, Array, Array | None], Arrival]:
        ray, throughput, absorption = carry
        wo, beyond = -ray.direction, None
        hit = once(find)(tables.geometry, ray)
        point = once(surface_point)(tables.geometry, ray, hit)
        _, _, *u = (x.astype(throughput.dtype) for x in independent(stream, k))
        scattering = in_stages(scatter)(tables.materials, point, wo, (u[0], u[1]))
        arriving = jnp.where(hit.valid, throughput, 0)
        if absorption is not None:
            medium = medium_at(tables.materials, absorption, point, wo)
            arriving, beyond = arriving * medium.passed(), medium.beyond(scattering.direction)
        onward = arriving * scattering.weight
        flux = jnp.where(scattering.diffuse, onward, 0)
        if scattering.glossy is not None:
            flux = jnp.where(scattering.glossy & tells_numbers_at(tables.materials, point), arriving, flux)
        arrival = Arrival(Turn(ray, hit.index, (u[0], u[1])), point, flux, scattering.glossy, absorption)
        return (once(leave)(point, scattering.direction), onward, beyond), arrival

    ones = jnp.ones_like(ray.origin)
    start = ray, ones, jnp.zeros_like(ones) if tables.materials.absorb else None
    return lax.scan(event, start, jnp.arange(1, events + 1, dtype=jnp.int32))[1]


def _places(tables: Tables, seed: Array, events: int, devices: tuple[jax.Device, ...]) -> Array:
    """Return places (LOOKOUTS, 3) that paths of the picture come to: the camera's own where they come to none."""

    def lane(operands: tuple[Tables, Array], k: Array) -> Array:
        tables, seed = operands
        stream = Stream(jnp.uint32(0), k.astype(jnp.uint32), seed ^ jnp.uint32(3), jnp.uint32(LOOKOUTS))
        u, v, *_ = (x.astype(tables.dtype) for x in independent(stream, 0))
        ray = central_ray(tables.camera, u * tables.camera.width, v * tables.camera.height)
        arrival = jax.tree.map(lambda a: a[k % events], _path(tables, ray, stream, events))
        return jnp.where(jnp.sum(arrival.flux) > 0, arrival.point.position, ray.origin)

    def packet(operands: tuple[Tables, Array], _: Array) -> Array:
        return jax.vmap(partial(lane, operands))(jnp.arange(LOOKOUTS, dtype=jnp.int32))

    places: Array = of_packets(packet, (tables, seed), 1, devices[:1])[0]
    return places


def _grazing(
    plan: Plan, tables: Tables, outlines: Silhouettes, lookouts: Lookouts, station: Station, draw: Draw
) -> Grazing:
    """Return one of several points of outlines, taken by how much of the light that arrives each may change."""
    eye = station.eye
    start = once(nearest_lookout)(lookouts, eye) * outlines.rows
    count = CANDIDATES if plan.geometry_moves else CANDIDATES_OF_LIGHTS

    def worth(tables: Tables, station: Station, rim: Rim, row: Array, density: Array) -> Array:
        own = (row == station.arrival.turn.index) & (row < outlines.spheres_count)
        ok = rim.valid & ~own & (rim.distance > 0)
        sent = jnp.mean(station.sends(tables, normalize(rim.point - station.eye)))
        return jnp.where(ok, safe_divide(rim.jacobian * sent, rim.distance * rim.distance * density), 0)

    def drawn(outlines: Silhouettes, lookouts: Lookouts, lobe: Lobe | None, k: Array) -> tuple[Array, Array, Array]:
        """Return row, place and density of point k: all are evenly spread, but half of those by a lobe near to it."""
        if lobe is None:
            return point_seen(lookouts, start, (k.astype(eye.dtype) + draw.spread[1]) / count, outlines.rows)
        half = count // 2
        each, number = jnp.where(lobe.there, half, count), jnp.where(lobe.there, k % half, k)
        v = (number.astype(eye.dtype) + draw.spread[1]) / each
        row, t, density = point_seen(lookouts, start, v, outlines.rows)
        aim = aim_at(outlines, row, eye, lobe.direction, lobe.angle)
        t = jnp.where(lobe.there & (k >= half), aim.draw(t), t)
        return row, t, density * jnp.where(lobe.there, (1 + aim.density(t)) / 2, 1)

    def choose(k: Array, best: tuple[Array, Array, Rim, Array, Array]) -> tuple[Array, Array, Rim, Array, Array]:
        """Keep what is there or take point k, by their worth."""
        *chosen, total, coin = best
        row, t, density = once(drawn)(outlines, lookouts, lobe, k)
        rim = once(partial(rim_at, creases=plan.max_depth > 1))(outlines, row, t, eye)
        taken, coin, total = one_of_both(coin, once(worth)(tables, station, rim, row, density), total)
        return *where(taken, (row, t, rim), tuple(chosen)), total, coin

    lobe = None if station.arrival.glossy is None else station.lobe(tables)
    nothing, coin = jnp.zeros_like(eye[0]), independent(draw.stream, 0)[0].astype(eye.dtype)
    none = Rim(jnp.zeros_like(eye), jnp.zeros_like(eye), nothing, nothing, nothing > 0)
    row, t, rim, total, _ = lax.fori_loop(0, count, choose, (jnp.int32(0), nothing, none, nothing, coin))
    sent = station.sends(tables, normalize(rim.point - eye))
    return Grazing(row, t, rim, sent * safe_divide(total / count, jnp.mean(sent)))


def _aimed(turns: Turn, last: Array, numbers: tuple[Array, Array]) -> Turn:
    """Return a path's events with other numbers at one of them."""
    here, (u0, u1) = jnp.arange(turns.index.shape[0]) == last, turns.numbers
    return replace(turns, numbers=(jnp.where(here, numbers[0], u0), jnp.where(here, numbers[1], u1)))
