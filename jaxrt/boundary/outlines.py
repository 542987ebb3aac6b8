"""The outlines that the camera sees: where the picture itself changes abruptly.

A unit of clearance of the camera's ray exchanges the radiance inside an outline for that outside. An edge of a mesh
counts wherever the colour can change across it. On a smooth ball radiance varies like the root of the distance to the
rim, so the inside is shaded at the rim itself.
"""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxrt.boundary.clearance import EdgeSamples, ViewPoints
from jaxrt.boundary.guiding import Draw, place, sample_guided
from jaxrt.boundary.shadows import BEYOND, NUDGE, Plan, bins_for, occluder_anchors
from jaxrt.boundary.silhouettes import Rim, Silhouettes, angular_lengths, edge_table, rim_at
from jaxrt.cameras import projection
from jaxrt.core.maths import dot, normalize, safe_divide
from jaxrt.core.pytree import pytree
from jaxrt.core.records import Hit, Ray, Smooth, SurfacePoint
from jaxrt.core.samplers import independent
from jaxrt.kernels.native import once
from jaxrt.scene import Scene
from jaxrt.shapes import find, surface_point
from jaxrt.shapes.sphere import onto_sphere, sphere_error
from jaxrt.transport.path import Tables, Walk, event_at, last_look, tables_of, walk_from

LIGHTS_ONLY = 16  # the outlines of lights alone get this part of the samples: they are few and smooth


@pytree
class OutlineTables:
    """What outline samples are drawn from."""

    tables: Tables
    outlines: Silhouettes


def camera_edges(scene: Scene, seed: Array, plan: Plan) -> tuple[EdgeSamples, ...]:
    """Return samples of the outlines that the camera sees move: all of them, or those of sphere lights alone.

    None where the camera's rays start at many places: an outline is that of an eye.
    """
    if not scene.camera.is_central:
        return ()
    tables = tables_of(scene)
    edges = edge_table(scene.triangles) if scene.triangles is not None and plan.geometry_moves else None
    outlines = Silhouettes(tables.geometry.spheres, edges)
    lights = scene.lights is not None and scene.lights.have_size
    if outlines.rows == 0 or not (lights or plan.geometry_moves):
        return ()
    bins = bins_for(outlines.rows)
    weights = angular_lengths(outlines, tables.camera.position, jnp.zeros((), scene.dtype), True, bins)
    if not plan.geometry_moves:
        weights = jnp.where(jnp.arange(weights.shape[0]) >= tables.first_light * bins, weights, 0)
    n = plan.n if plan.geometry_moves else -(-plan.n // LIGHTS_ONLY)
    operands = OutlineTables(tables, outlines)
    return (sample_guided(partial(_sample, plan, bins), operands, weights, n, seed ^ jnp.uint32(1), plan.devices),)


def _sample(plan: Plan, bins: int, operands: OutlineTables, draw: Draw) -> tuple[EdgeSamples, Array]:
    """Return one sample, and what it brings."""
    tables, outlines = operands.tables, operands.outlines
    camera = tables.camera
    placed = once(place)(draw)
    row = placed.bin // bins
    t = ((placed.bin % bins).astype(placed.t.dtype) + placed.t) / bins
    rim = once(partial(rim_at, creases=True))(outlines, row, t, camera.position)
    view = once(projection)(camera, rim.point)
    # The change of radiance across it
    outside, inside, clear = _radiances(plan, tables, outlines, row, rim, draw)
    density = placed.density * bins * draw.total
    seen = rim.valid & clear & view.inside & (density > 0)
    spread = safe_divide(rim.jacobian * view.density, rim.distance * rim.distance * density)
    weight = jnp.where(seen, (outside - inside) * spread, 0)
    pixel = jnp.where(seen, view.pixel, camera.width * camera.height)
    occluder = occluder_anchors(outlines, plan.geometry_moves, row, t, rim)
    points = ViewPoints(view.image, jnp.where(seen, view.depth, 0), jnp.where(seen, rim.normal, 0))
    points_or_none = points if plan.geometry_moves else None
    return EdgeSamples(pixel[None], weight[None], None, points_or_none, (occluder,)), jnp.sum(jnp.abs(weight))


def _radiances(
    plan: Plan, tables: Tables, outlines: Silhouettes, row: Array, rim: Rim, draw: Draw
) -> tuple[Array, Array, Array]:
    """Return the radiance just outside and just inside an outline, and whether nothing hides it.

    Both use the same random numbers, so that equal surfaces on both sides cancel.
    """
    eye = tables.camera.position

    def ray_past(side: Array) -> Ray:
        return Ray(eye, normalize(rim.point + side * NUDGE * rim.distance * rim.normal - eye))

    def start(side: Array) -> tuple[Ray, Hit, SurfacePoint]:
        ray = ray_past(side)
        hit = once(find)(tables.geometry, ray)
        point = once(surface_point)(tables.geometry, ray, hit)
        return ray, hit, point

    sides = jnp.asarray([1, -1], eye.dtype)
    rays, hits, points = jax.vmap(start)(sides)
    outer, first, place = jax.tree.map(lambda x: x[0], (rays, hits, points))
    travelled = dot(place.position - eye, outer.direction)
    hidden = first.valid & (travelled < rim.distance * (1 - BEYOND)) & ~_own(outlines, row, first.index)
    if outlines.spheres is not None:
        hits, points = _at_rim(outlines, row, rim, hits, points)
    both = jax.vmap(partial(_radiance_from, plan, tables, draw))(rays, hits, points)
    return both[0], both[1], ~hidden


def _own(outlines: Silhouettes, row: Array, index: Array) -> Array:
    """Return whether primitive `index` is one of the faces at an edge."""
    n = outlines.spheres_count
    if outlines.edges is None:
        return jnp.zeros((), bool)
    return (row >= n) & jnp.any(outlines.edges.faces[jnp.maximum(row - n, 0)] + n == index)


def _at_rim(outlines: Silhouettes, row: Array, rim: Rim, hits: Hit, points: SurfacePoint) -> tuple[Hit, SurfacePoint]:
    """Return both starts, the inner one put on the rim itself where it is that of a sphere."""
    spheres = outlines.spheres
    assert spheres is not None
    sphere = jnp.minimum(row, outlines.spheres_count - 1)
    place = spheres.center[sphere], spheres.radius[sphere], spheres.base[sphere], spheres.shift[sphere]
    table = (*place, spheres.constant[sphere])
    # The rim of a huge sphere is off its surface by rounding, and rays that leave it would meet it
    position = onto_sphere(table, rim.point)
    error = sphere_error(table, position)
    at_rim = (
        Hit(sphere, jnp.ones((), bool)),
        replace(
            jax.tree.map(lambda x: x[1], points),
            position=position,
            normal=rim.normal,
            error=error,
            material=spheres.material[sphere],
        ),
    )
    if points.smooth is not None:
        smooth = Smooth(rim.normal, position, jnp.ones_like(error))
        at_rim = at_rim[0], replace(at_rim[1], smooth=smooth)
    use = row < outlines.spheres_count
    return jax.tree.map(lambda old, new: old.at[1].set(jnp.where(use, new, old[1])), (hits, points), at_rim)


def _radiance_from(plan: Plan, tables: Tables, draw: Draw, ray: Ray, hit: Hit, point: SurfacePoint) -> Array:
    """Return the radiance (3,) along a camera ray whose first surface is known."""
    walk = walk_from(tables, ray)

    def event(walk: Walk, k: Array) -> tuple[Walk, None]:
        here = once(find)(tables.geometry, walk.ray)
        there = once(surface_point)(tables.geometry, walk.ray, here)
        first = k == 1
        here, there = jax.tree.map(lambda a, b: jnp.where(first, a, b), (hit, point), (here, there))
        u = tuple(x.astype(ray.origin.dtype) for x in independent(draw.stream, k))
        return event_at(tables, walk, here, there, u), None

    walk, _ = lax.scan(event, walk, jnp.arange(1, plan.max_depth + 1, dtype=jnp.int32))
    return last_look(tables, walk)
