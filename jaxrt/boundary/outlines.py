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

from jaxrt.boundary.anchors import occluder_anchors
from jaxrt.boundary.clearance import EdgeSamples, ViewRays, beside
from jaxrt.boundary.guiding import Draw, place, sample_guided
from jaxrt.boundary.shadows import NUDGE, Plan
from jaxrt.boundary.silhouettes import Afar, Eye, Rim, Silhouettes, angular_lengths, bins_for, edge_table, rim_at
from jaxrt.boundary.trail import through_lens
from jaxrt.cameras import View, edges_known, projection
from jaxrt.core.maths import dot, normalize, safe_divide, safe_sqrt
from jaxrt.core.pytree import pytree, where
from jaxrt.core.records import Hit, Ray, Smooth, SurfacePoint
from jaxrt.core.samplers import independent
from jaxrt.kernels.native import once
from jaxrt.scene import Scene
from jaxrt.shapes import Geometry, charted_as, find, measured, surface_point
from jaxrt.shapes.sphere import onto_sphere, sphere_chart, sphere_error
from jaxrt.shapes.triangle import triangle_point_at
from jaxrt.transport.outputs import what_is_met
from jaxrt.transport.path import Tables, Walk, event_at, last_look, tables_of, walk_along

CLOSE = 1e-5  # what hides an outline is nearer by this share of its distance
LIGHTS_ONLY = 16  # the outlines of lights alone get this part of the samples: they are few and smooth


@pytree
class OutlineTables:
    """What outline samples are drawn from."""

    tables: Tables
    outlines: Silhouettes


def camera_edges(scene: Scene, seed: Array, plan: Plan) -> tuple[EdgeSamples, ...]:
    """Return samples of the outlines that the camera sees move: all of them, or those of sphere lights alone.

    None where they are not known of the camera: an outline is that of an eye, however far away.
    """
    if not edges_known(scene.camera):
        return ()
    tables = tables_of(scene)
    edges = edge_table(scene.triangles) if scene.triangles is not None and plan.geometry_moves else None
    outlines = Silhouettes(tables.geometry.spheres, edges)
    lights = scene.lights is not None and scene.lights.have_size
    if outlines.rows == 0 or not (lights or plan.geometry_moves):
        return ()
    bins = bins_for(outlines.rows)
    camera, nothing = tables.camera, jnp.zeros((), scene.dtype)
    reach = nothing if camera.lens is None else camera.radius
    weights = angular_lengths(outlines, _eye(camera), reach, True, bins)
    if not plan.geometry_moves:
        weights = jnp.where(jnp.arange(weights.shape[0]) >= tables.first_light * bins, weights, 0)
    n = plan.part(1, LIGHTS_ONLY)
    operands = OutlineTables(tables, outlines)
    return (sample_guided(partial(_sample, plan, bins), operands, weights, n, seed ^ jnp.uint32(1), plan.devices),)


def _eye(camera: View) -> Eye:
    if camera.heading is None:
        return camera.position
    nothing = jnp.zeros_like(camera.heading[0])
    across = camera.start((nothing + camera.width, nothing + camera.height)) - camera.start((nothing, nothing))
    return Afar(camera.heading, safe_sqrt(dot(across, across)))


def _sample(plan: Plan, bins: int, operands: OutlineTables, draw: Draw) -> tuple[EdgeSamples, Array]:
    """Return one sample, and what it brings."""
    tables, outlines = through_lens(operands.tables, draw.stream), operands.outlines
    camera = tables.camera
    placed = once(place)(draw)
    row = placed.bin // bins
    t = ((placed.bin % bins).astype(placed.t.dtype) + placed.t) / bins
    rim = once(partial(rim_at, creases=True))(outlines, row, t, _eye(camera))
    view = once(projection)(camera, rim.point)
    eye = camera.eye(rim.point)
    if camera.heading is not None:
        rim = replace(rim, distance=dot(rim.point - eye, camera.heading))
    # The change of radiance across it
    outside, inside, clear = _radiances(plan, tables, outlines, row, rim, eye, draw)
    density = placed.density * bins * draw.total
    seen = rim.valid & clear & view.inside & (density > 0)
    spread = safe_divide(rim.jacobian * view.density, rim.distance * rim.distance * density)
    weight = jnp.where(seen, (outside - inside) * spread, 0)
    pixel = jnp.where(seen, view.pixel, camera.width * camera.height)
    occluder = occluder_anchors(outlines, plan.geometry_moves, row, t, rim)
    facing = jnp.where(seen, rim.normal, 0)
    rays = None
    if plan.geometry_moves:
        rays = ViewRays(view.image, facing, jnp.where(seen, view.depth, 0) * facing, camera.lens)
    seen_at = beside(view.image[None], plan.filter)
    samples = EdgeSamples(pixel[None], weight[None], None, rays, (occluder,), place=seen_at)
    return samples, jnp.sum(jnp.abs(weight))


def _radiances(
    plan: Plan, tables: Tables, outlines: Silhouettes, row: Array, rim: Rim, eye: Array, draw: Draw
) -> tuple[Array, Array, Array]:
    """Return the radiance, or the outputs, just outside and just inside an outline, and whether nothing hides it.

    Both use the same random numbers, so that equal surfaces on both sides cancel.
    """
    starts, clear = both_sides(tables, outlines, row, rim, eye)
    if plan.outputs:
        both = jax.vmap(partial(what_is_met, plan.outputs, tables))(*starts)
    else:
        both = jax.vmap(partial(_radiance_from, plan, tables, draw))(*starts)
    return both[0], both[1], clear


def both_sides(
    tables: Tables, outlines: Silhouettes, row: Array, rim: Rim, eye: Array
) -> tuple[tuple[Ray, Hit, SurfacePoint], Array]:
    """Return the rays (2,) from an eye just outside and just inside an outline with what they meet, and where.

    Second, () bool, whether nothing hides the outline from the eye. Surfaces that end at the outline are met on it: a
    ray beside it would miss faces that are seen almost edge-on.
    """
    past = normalize(rim.point + NUDGE * rim.distance * rim.normal - eye)
    rays = Ray(jnp.stack([eye, eye]), jnp.stack([past, normalize(rim.point - eye)]))
    hits = jax.vmap(once(find), in_axes=(None, 0))(tables.geometry, rays)
    points = jax.vmap(once(surface_point), in_axes=(None, 0, 0))(tables.geometry, rays, hits)
    beyond = jax.tree.map(lambda x: x[0], (rays, hits, points))
    toward, first, place = jax.tree.map(lambda x: x[1], (rays, hits, points))
    gap = rim.distance - dot(place.position - eye, toward.direction)
    behind = gap * jnp.abs(dot(place.normal, toward.direction)) > 2 * place.error
    hidden = first.valid & (gap > CLOSE * rim.distance) & behind & ~_ends(outlines, row, first.index)
    inside = outside = None
    if outlines.edges is not None:
        inside, outside = _at_edge(tables.geometry, outlines, row, rim, toward)
        beyond = where(outside[0], outside[1], beyond)
    if outlines.spheres is not None:
        at_rim = _at_rim(tables.geometry, outlines, row, rim, toward, place)
        of_sphere = row < outlines.spheres_count
        inside = at_rim if inside is None else where(of_sphere, at_rim, inside)
    return jax.tree.map(lambda *x: jnp.stack(x), beyond, inside), ~hidden


def _ends(outlines: Silhouettes, row: Array, index: Array) -> Array:
    """Return whether primitive `index` ends at a row's outline."""
    n = outlines.spheres_count
    sphere = (row < n) & (index == row)
    if outlines.edges is None:
        return sphere
    return sphere | ((row >= n) & jnp.any(outlines.edges.faces[jnp.maximum(row - n, 0)] + n == index))


def _at_edge(
    geometry: Geometry, outlines: Silhouettes, row: Array, rim: Rim, ray: Ray
) -> tuple[tuple[Ray, Hit, SurfacePoint], tuple[Array, tuple[Ray, Hit, SurfacePoint]]]:
    """Return how a ray to an edge meets the face inside, then whether the other face is outside, and how it is met."""
    edges, n = outlines.edges, outlines.spheres_count
    assert edges is not None and geometry.triangles is not None
    triangles, edge = geometry.triangles, jnp.maximum(row - n, 0)
    a, v1, normals, faces = edges.corners[edge, 0], edges.corners[edge, 3], edges.normals[edge], edges.faces[edge]
    apart = (row >= n) & (dot(rim.normal, v1 - a) > 0)
    # Of two faces on one side the one that comes nearer to the eye hides the other
    lean = [safe_divide(dot(normal, rim.normal), dot(normal, ray.direction)) for normal in normals]
    nearer = jnp.where(~apart & (lean[1] < lean[0]), faces[1], faces[0])

    def met(face: Array) -> tuple[Ray, Hit, SurfacePoint]:
        point = triangle_point_at(triangles, rim.point, ray.direction, face)
        return ray, Hit(face + n, jnp.ones((), bool)), measured(geometry, ray, point)

    return met(nearer), (apart, met(faces[1]))


def _at_rim(
    geometry: Geometry, outlines: Silhouettes, row: Array, rim: Rim, ray: Ray, like: SurfacePoint
) -> tuple[Ray, Hit, SurfacePoint]:
    """Return how a ray to a sphere's rim meets the sphere. like: a surface point of the scene."""
    spheres = outlines.spheres
    assert spheres is not None
    sphere = jnp.minimum(row, outlines.spheres_count - 1)
    place = spheres.center[sphere], spheres.radius[sphere], spheres.base[sphere], spheres.shift[sphere]
    table = (*place, spheres.constant[sphere])
    # The rim of a huge sphere is off its surface by rounding, and rays that leave it would meet it
    position = onto_sphere(table, rim.point)
    error = sphere_error(table, position)
    smooth = None if like.smooth is None else Smooth(rim.normal, position, jnp.ones_like(error))
    point = SurfacePoint(position, rim.normal, error, spheres.material[sphere], smooth)
    if like.chart is not None:
        point = charted_as(replace(point, chart=sphere_chart(spheres, rim.normal)), like)
    # By rounding a ray along the surface may seem to come from inside, where it is dark
    from_outside = Ray(ray.origin, normalize(ray.direction - NUDGE * rim.normal))
    return from_outside, Hit(sphere, jnp.ones((), bool)), measured(geometry, from_outside, point)


def _radiance_from(plan: Plan, tables: Tables, draw: Draw, ray: Ray, hit: Hit, point: SurfacePoint) -> Array:
    """Return the radiance (3,) along a camera ray whose first surface is known."""
    walk = walk_along(tables, ray, True)

    def event(walk: Walk, k: Array) -> tuple[Walk, None]:
        here = once(find)(tables.geometry, walk.ray, walk.alive)
        there = once(surface_point)(tables.geometry, walk.ray, here)
        first = k == 1
        here, there = where(first, (hit, point), (here, there))
        u = tuple(x.astype(ray.origin.dtype) for x in independent(draw.stream, k))
        return event_at(tables, walk, here, there, u), None

    walk, _ = lax.scan(event, walk, jnp.arange(1, plan.max_depth + 1, dtype=jnp.int32))
    return last_look(tables, walk)
