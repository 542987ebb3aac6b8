"""How much the radiance changes across an outline that an eye, or a surface, looks past.

An edge of a mesh counts wherever the colour can change across it. Its faces are shaded a little within: what stands on
a floor ends in it, and sees the sky from there where all of the face sees the floor. On a smooth ball radiance varies
like the root of the distance to the rim, so the inside is shaded at the rim itself.
"""

from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxrt.boundary.shadows import NUDGE
from jaxrt.boundary.silhouettes import Rim, Silhouettes
from jaxrt.core.maths import dot, normalize, safe_divide, safe_sqrt
from jaxrt.core.pytree import pytree, where
from jaxrt.core.records import Hit, Ray, Smooth, SurfacePoint
from jaxrt.core.samplers import Stream, independent
from jaxrt.kernels.few import where_any
from jaxrt.kernels.native import once
from jaxrt.shapes import Geometry, charted_as, find, measured, surface_point
from jaxrt.shapes.sphere import onto_sphere, sphere_chart, sphere_error
from jaxrt.shapes.triangle import triangle_point_at
from jaxrt.transport.path import Tables, Walk, arrive, depart, looks_at_last, walk_along

WITHIN = 0.05  # of the way from an edge to a face's third corner, at most, the face is shaded
CLOSE = 1e-5  # what hides an outline is nearer by this share of its distance


@pytree
class Glance:
    """A look past a point of an outline."""

    eye: Array  # (3,) where it comes from
    row: Array  # () int32 of the outlines
    rim: Rim
    sees_lights: Array  # () bool, whether it may see sphere lights
    absorption: Array | None  # (3,) per unit of length, of what it goes through; None where nothing absorbs
    stream: Stream
    first: Array  # () int32 number of its first event


def change_across(tables: Tables, outlines: Silhouettes, glance: Glance, max_depth: int) -> tuple[Array, Array]:
    """Return how much more radiance (3,) there is just outside an outline than just inside, and whether it shows.

    Both sides use the same random numbers, so that equal surfaces cancel. One loop finds what these rays meet and what
    all later ones do, for a search is dear to compile.
    """
    end = max_depth + 1 + looks_at_last(tables)

    def event(k: Array, state: tuple[Walk, Array]) -> tuple[Walk, Array]:
        walks, clear = state
        # A lane that has ended, or has no first event, waits for others at its number; what is hidden needs no light
        running = k < end
        begins = running & (k == glance.first)
        operands = tables, outlines, glance, begins, k, walks, clear
        following: tuple[Walk, Array] = where_any(begins | (running & clear), go_on, lambda *x: x[-2:], *operands)
        return following

    def go_on(
        tables: Tables, outlines: Silhouettes, glance: Glance, begins: Array, k: Array, walks: Walk, clear: Array
    ) -> tuple[Walk, Array]:
        hits = jax.vmap(once(find), in_axes=(None, 0, 0))(tables.geometry, walks.ray, walks.alive)
        points = jax.vmap(once(surface_point), in_axes=(None, 0, 0))(tables.geometry, walks.ray, hits)
        met = walks.ray, hits, points
        known = begins, clear, tables.geometry, outlines, glance.row, glance.rim, met
        (rays, hits, points), clear = where_any(begins, _begun, lambda *x: (x[-1], x[1]), *known)
        u = tuple(x.astype(glance.eye.dtype) for x in independent(glance.stream, k))
        walks = jax.vmap(partial(arrive, tables))(replace(walks, ray=rays), hits, points)
        # The last ray only looks
        goes_on = clear & (k <= max_depth)
        operands = tables, walks, replace(hits, valid=hits.valid & goes_on), points, u
        return where(goes_on, where_any(goes_on, _departed, lambda *x: x[1], *operands), walks), clear

    def start(ray: Ray) -> Walk:
        walk = walk_along(tables, ray, glance.sees_lights)
        return walk if glance.absorption is None else replace(walk, absorption=glance.absorption)

    walks = jax.vmap(start)(_rays_past(glance.rim, glance.eye))
    walks, clear = lax.fori_loop(glance.first, end, event, (walks, jnp.zeros((), bool)))
    return walks.radiance[0] - walks.radiance[1], clear


def _departed(tables: Tables, walks: Walk, hits: Hit, points: SurfacePoint, u: tuple[Array, ...]) -> Walk:
    """Return both paths (2,) gone on from where they have arrived, by the same numbers."""
    return jax.vmap(partial(depart, u=u), in_axes=(None, 0, 0, 0))(tables, walks, hits, points)


def both_sides(
    tables: Tables, outlines: Silhouettes, row: Array, rim: Rim, eye: Array
) -> tuple[tuple[Ray, Hit, SurfacePoint], Array]:
    """Return the rays (2,) from an eye just outside and just inside an outline with what they meet, and where.

    Second, () bool, whether nothing hides the outline from the eye.
    """
    rays = _rays_past(rim, eye)
    hits = jax.vmap(once(find), in_axes=(None, 0))(tables.geometry, rays)
    points = jax.vmap(once(surface_point), in_axes=(None, 0, 0))(tables.geometry, rays, hits)
    return _sides(tables.geometry, outlines, row, rim, (rays, hits, points))


def _rays_past(rim: Rim, eye: Array) -> Ray:
    """Return rays (2,) from an eye just past an outline, and to it."""
    past = normalize(rim.point + NUDGE * rim.distance * rim.normal - eye)
    return Ray(jnp.stack([eye, eye]), jnp.stack([past, normalize(rim.point - eye)]))


def _begun(begins: Array, clear: Array, *known: Any) -> tuple[Any, Array]:
    """Return `_sides` where a path begins, else what is met and `clear`."""
    return where(begins, _sides(*known), (known[-1], clear))


def _sides(
    geometry: Geometry, outlines: Silhouettes, row: Array, rim: Rim, met: tuple[Ray, Hit, SurfacePoint]
) -> tuple[tuple[Ray, Hit, SurfacePoint], Array]:
    """Return `both_sides` from what the rays past an outline and to it meet.

    Surfaces that end at the outline are met on it: a ray beside it would miss faces that are seen almost edge-on.
    """
    beyond, (toward, first, place) = (jax.tree.map(lambda x, i=i: x[i], met) for i in range(2))
    gap = rim.distance - dot(place.position - toward.origin, toward.direction)
    behind = gap * jnp.abs(dot(place.normal, toward.direction)) > 2 * place.error
    hidden = first.valid & (gap > CLOSE * rim.distance) & behind & ~_ends(outlines, row, first.index)
    inside = outside = None
    if outlines.edges is not None:
        inside, outside = _at_edge(geometry, outlines, row, rim, toward)
        beyond = where(outside[0], outside[1], beyond)
    if outlines.spheres is not None:
        at_rim = _at_rim(geometry, outlines, row, rim, toward, place)
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
    (a, _, *corners), normals, faces = edges.corners[edge], edges.normals[edge], edges.faces[edge]
    apart = (row >= n) & (dot(rim.normal, corners[1] - a) > 0)
    # Of two faces on one side the one that comes nearer to the eye hides the other
    lean = [safe_divide(dot(normal, rim.normal), dot(normal, ray.direction)) for normal in normals]
    second = ~apart & (lean[1] < lean[0])

    def met(face: Array, corner: Array) -> tuple[Ray, Hit, SurfacePoint]:
        inward = corner - rim.point
        step = jnp.minimum(safe_divide(NUDGE * rim.distance, safe_sqrt(dot(inward, inward))), WITHIN)
        point = triangle_point_at(triangles, rim.point + step * inward, ray.direction, face)
        return ray, Hit(face + n, jnp.ones((), bool)), measured(geometry, ray, point)

    return met(*where(second, (faces[1], corners[1]), (faces[0], corners[0]))), (apart, met(faces[1], corners[1]))


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
