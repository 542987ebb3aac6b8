"""Triangles: nearest hit, any hit and the surface point.

Few triangles are tested one by one, many through a tree (`search/traverse.py`); the test of one is
`edges.hit_distance`.
"""

from dataclasses import replace
from functools import partial
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array, lax

from jaxrt.core.maths import FAR, cross, dot, grad_only, normalize, safe_divide, unit_roundoff
from jaxrt.core.pytree import pytree, static
from jaxrt.core.records import Chart, Ray, SurfacePoint
from jaxrt.kernels.gather import take
from jaxrt.kernels.native import once
from jaxrt.shapes.adjacency import MeshEdges
from jaxrt.shapes.edges import Corner, along_axis, edge_functions, hit_distance, main_axis, shear, slopes_along
from jaxrt.shapes.search.boxes import Tree, tree_of
from jaxrt.shapes.search.bvh import Topology
from jaxrt.shapes.search.few_shapes import any_of, nearest_of
from jaxrt.shapes.search.traverse import any_hit, nearest_hit
from jaxrt.shapes.smooth import corner_normals, smooth_place


@pytree
class FaceChart:
    """Where the corners of faces are for textures; parts that the scene's textures do not ask for are None."""

    uv: Array | None = None  # (n, 3, 2)
    vertices: Array | None = None  # (n, 3) int32


@pytree
class Triangles:
    """Triangles that share vertices."""

    vertices: Array  # (v, 3) scene units
    faces: Array  # (n, 3) int32 rows of `vertices`, counter-clockwise seen from outside
    material: Array  # (n,) int32
    bvh: Topology | None = None  # made by `topology_of`; None: few, tested one by one
    edges: MeshEdges | None = None  # for what moving edges add to derivatives
    smooth: Array | None = None  # (n, 3) int32, corners of one number share their normal; None: no mesh is smooth
    chart: FaceChart | None = None  # None where no texture asks
    uv: Array | None = None  # (n, 3, 2) for the output of that name; None: the chart's, or shares of corners
    wide: bool = static(default=False)  # some are far wider than other things of the scene are large


@pytree
class TriangleTable:
    """Triangles as the intersection loop reads them."""

    corners: Array  # (n, 3, 3) corner, coordinate
    material: Array  # (n,) int32
    error: Array  # (n,) how far off its plane a point of a triangle may be seen; without derivative
    tree: Tree | None = None  # no derivative passes through it
    normals: Array | None = None  # (n, 3, 3) unit normal at each corner, None where no mesh is smooth
    chart: FaceChart | None = None  # as above
    wide: bool = static(default=False)  # as above: hits are then found with more care


def triangle_table(triangles: Triangles) -> TriangleTable:
    """Return the rows that `find_triangle` reads; one without area, to rounding, shrinks to a point: never hit."""
    corners = triangles.vertices[triangles.faces]
    edge1, edge2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    rounding = 4 * unit_roundoff(edge1) * jnp.max(jnp.abs(edge1), -1) * jnp.max(jnp.abs(edge2), -1)
    flat = jnp.max(jnp.abs(cross(edge1.T, edge2.T)), 0) <= rounding
    corners = jnp.where(flat[:, None, None], corners[:, :1], corners)
    tree = None if triangles.bvh is None else tree_of(triangles.bvh, lax.stop_gradient(corners), triangles.wide)
    normals = None if triangles.smooth is None else corner_normals(corners, triangles.smooth)
    return corner_table(corners, triangles.material, tree, normals, triangles.chart, triangles.wide)


def corner_table(
    corners: Array,
    material: Array,
    tree: Tree | None = None,
    normals: Array | None = None,
    chart: FaceChart | None = None,
    wide: bool = False,
) -> TriangleTable:
    """Return the rows of triangles by their corners (n, 3, 3)."""
    return TriangleTable(corners, material, _plane_error(lax.stop_gradient(corners)), tree, normals, chart, wide)


class Sight(NamedTuple):
    """What a ray tells all corners, apart by coordinate: a loop over triangles need not shuffle it."""

    origin: tuple[Array, ...]
    axis: Array  # () int32 the main one
    slopes: tuple[Array, ...]  # along it, as `shear` takes them


def sight_of(ray: Ray) -> Sight:
    """Return how a ray sees corners."""
    axis = main_axis(ray.direction)
    return Sight(tuple(ray.origin), axis, slopes_along(axis, ray.direction))


def sheared(corners: Array, sight: Sight, wide: bool = False) -> list[Corner]:
    """Return the corners (3, 3) as a ray sees them."""
    apart = [[x - o for x, o in zip(corner, sight.origin, strict=True)] for corner in corners]
    return [shear(*along_axis(sight.axis, corner), *sight.slopes, wide=wide) for corner in apart]


def _hit_weights(corners: Array, ray: Ray) -> tuple[Array, Array]:
    """Return the barycentric coordinates of the second and third corner; in [0, 1] also where the ray misses."""
    (e0, e1, e2), _, _ = edge_functions(sheared(corners, sight_of(ray)))
    total = jnp.abs(e0) + jnp.abs(e1) + jnp.abs(e2)
    return safe_divide(jnp.abs(e1), total), safe_divide(jnp.abs(e2), total)


def triangle_distance(table: TriangleTable, ray: Ray, i: Array) -> Array:
    """Return the distance to triangle `i`, FAR if it is missed. No derivative is taken of it."""
    return hit_distance(sheared(take(table.corners, i), sight_of(ray), table.wide))


def plane_distance(table: TriangleTable, ray: Ray, i: Array) -> Array:
    """Return the distance to the plane of triangle `i`, FAR if it lies behind or along the ray."""
    corners = take(table.corners, i)
    normal = normalize(cross(corners[1] - corners[0], corners[2] - corners[0]))
    t = safe_divide(dot(normal, corners[0] - ray.origin), dot(normal, ray.direction))
    return jnp.where(t > 0, jnp.minimum(t, FAR), FAR)


def find_triangle(table: TriangleTable, ray: Ray, farthest: Array) -> tuple[Array, Array]:
    """Return (distance, row) of the nearest triangle closer than `farthest`; row −1 and `farthest` if none is."""
    if table.tree is not None:
        return nearest_hit(table.tree, ray.origin, ray.direction, farthest)
    return nearest_of(table.corners.shape[0], partial(_one, table, sight_of(ray)), farthest)


def occluded_by_triangle(table: TriangleTable, ray: Ray, farthest: Array) -> Array:
    """Return whether any triangle is hit closer than `farthest`."""
    if table.tree is not None:
        return any_hit(table.tree, ray.origin, ray.direction, farthest)
    return any_of(table.corners.shape[0], partial(_one, table, sight_of(ray)), farthest)


def _one(table: TriangleTable, sight: Sight, i: Array) -> list[tuple[Array, Array]]:
    """Return number and distance of a triangle, as a loop over all wants them."""
    return [(i, hit_distance(sheared(table.corners[i], sight, table.wide)))]


def triangle_surface_point(table: TriangleTable, ray: Ray, i: Array) -> SurfacePoint:
    """Return where the ray meets the plane of triangle `i`, in closed form and differentiable in corners and ray.

    The point is laid on the triangle by its barycentric coordinates, which keeps its error independent of the distance
    travelled (Wächter and Binder, Ray Tracing Gems 2019, ch. 6). They are those of the hit test, so that slivers
    keep the point too; Cramer's rule gives their derivatives, 0 where the ray misses, or its slope is 0 to
    rounding. Of a wide triangle the ray may know the place better.
    """
    corners = take(table.corners, i)
    a, edge1, edge2 = corners[0], corners[1] - corners[0], corners[2] - corners[0]
    normal = cross(edge1, edge2)
    # Solve o + t d = a + β edge1 + γ edge2 by Cramer's rule
    slope, size = dot(normal, ray.direction), lax.stop_gradient(jnp.max(jnp.abs(normal)))
    # Else derivatives of the quotients overflow. Their common scale cancels
    known = jnp.abs(slope) > unit_roundoff(slope) * size
    scale = jnp.where(known, size, 1)
    q = jnp.where(known, cross(ray.origin - a, ray.direction) / scale, 0)
    slope = jnp.where(known, slope / scale, 1)
    beta, gamma = jnp.clip(dot(edge2, q) / -slope, 0, 1), jnp.clip(dot(edge1, q) / slope, 0, 1)
    # Once: else each coordinate of what follows, and of textures, finds them anew
    hit1, hit2 = once(_hit_weights)(*lax.stop_gradient((corners, ray)))
    beta, gamma = hit1 + grad_only(beta), hit2 + grad_only(gamma)
    p = a + beta * edge1 + gamma * edge2
    unit, error = normalize(normal), take(table.error, i)
    if table.wide:
        p = p + _place_on_ray(*lax.stop_gradient((corners, unit)), error, *lax.stop_gradient((ray, p)))
    return _shaded(table, i, corners, (beta, gamma), SurfacePoint(p, unit, error, table.material[i]), ray.direction)


def triangle_point_at(table: TriangleTable, place: Array, direction: Array, i: Array) -> SurfacePoint:
    """Return the surface point of triangle `i` at a place on it, which a ray of some direction sees at any slant."""
    corners = take(table.corners, i)
    s, edge1, edge2 = place - corners[0], corners[1] - corners[0], corners[2] - corners[0]
    unit = normalize(cross(edge1, edge2))
    area = dot(cross(edge1, edge2), unit)
    weights = safe_divide(dot(cross(s, edge2), unit), area), safe_divide(dot(cross(edge1, s), unit), area)
    return _shaded(
        table, i, corners, weights, SurfacePoint(place, unit, take(table.error, i), table.material[i]), direction
    )


def _shaded(
    table: TriangleTable,
    i: Array,
    corners: Array,
    weights: tuple[Array, Array],
    point: SurfacePoint,
    direction: Array,
) -> SurfacePoint:
    """Return the point with what a smooth mesh adds. weights: barycentric, of the second and third corner."""
    if table.chart is not None:
        point = replace(point, chart=_chart(table.chart, i, weights))
    if table.normals is None:
        return point
    lifted, smooth = smooth_place(corners, take(table.normals, i), weights, point.position, point.normal, -direction)
    return replace(point, position=lifted, smooth=smooth)


def _chart(corners: FaceChart, i: Array, weights: tuple[Array, Array]) -> Chart:
    """Return where on triangle `i` the point of these barycentric coordinates is."""
    shares = jnp.stack([1 - weights[0] - weights[1], *weights])
    uv = vertices = None
    if corners.uv is not None:
        uv = interpolated(take(corners.uv, i), weights)
    if corners.vertices is not None:
        vertices = take(corners.vertices, i)
    return Chart(uv, vertices, None if vertices is None else shares)


def interpolated(corners: Array, weights: Array | tuple[Array, Array]) -> Array:
    """Return what corners have (3, c) at a place of these barycentric coordinates, of the second and third corner."""
    a, b, c = corners
    return a + weights[0] * (b - a) + weights[1] * (c - a)


def _plane_error(corners: Array) -> Array:
    """Return bounds (n,) on how far off its plane float arithmetic sees a point laid on each triangle, in scene units.

    Let m be the largest |coordinate| of the corners along an axis. There a + β edge1 + γ edge2 is wrong by 8u m: 2u m
    for its two sums, 3u of each product for difference, product and its sum, with |edge| ≤ 2m and β + γ ≤ 1. The next
    ray's origin rounds by u m once it is moved, and the hit test by 2u m when it subtracts origin from corners (Higham,
    Accuracy and Stability of Numerical Algorithms, 2nd ed., §3.1); one more u for all that is of second order. Errors
    along an axis lead off the plane by the normal's share of it only: a floor may be wide at no price. What the normal
    itself may be wrong by counts as a share too, which is much for a sliver.
    """
    edge1, edge2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    a, b, size, u = jnp.abs(edge1.T), jnp.abs(edge2.T), jnp.abs(corners).max(1).T, unit_roundoff(corners)
    normal = jnp.abs(cross(edge1.T, edge2.T))
    wrong = 4 * u * jnp.stack([a[i] * b[j] + a[j] * b[i] for i, j in ((1, 2), (2, 0), (0, 1))])
    # Scaled, since squares of small or large ones leave the range of floats
    largest = normal.max(0)
    scaled = safe_divide(normal, largest[None])
    share = safe_divide(scaled, jnp.sqrt(jnp.sum(scaled * scaled, 0))[None]) + safe_divide(wrong, largest[None])
    return 12 * u * jnp.sum(share * size, 0)


def _place_on_ray(corners: Array, unit: Array, error: Array, ray: Ray, p: Array) -> Array:
    """Return what moves p, of barycentric coordinates, to where the ray meets the plane; 0 where p is as well known.

    Both are within `error` of the plane. Along it p is wrong by 8u of the largest coordinate, which is 0.5 on a floor
    of 1e6, and the other by the plane's error over the slope and the rounding of ray and distance.
    """
    slope = dot(unit, ray.direction)
    t = jnp.clip(safe_divide(dot(unit, corners[0] - ray.origin), slope), 0, FAR)
    place = ray.origin + t * ray.direction
    place = place - dot(unit, place - corners[0]) * unit
    u, reach = unit_roundoff(p), jnp.abs(ray.origin).max() + t
    better = error + 4 * u * reach * jnp.abs(slope) < 8 * u * jnp.abs(corners).max() * jnp.abs(slope)
    return jnp.where(better, place - p, 0)
