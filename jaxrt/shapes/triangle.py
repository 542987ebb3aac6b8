"""Triangles: nearest hit, any hit and the surface point.

Few triangles are tested one by one, many through a tree (`traverse.py`); the test of one is `edges.hit_distance`.
"""

from dataclasses import replace

import jax.numpy as jnp
from jax import Array, lax

from jaxrt.gather import take
from jaxrt.maths import cross, dot, grad_only, normalize, safe_divide, unit_roundoff
from jaxrt.pytree import pytree
from jaxrt.records import Ray, SurfacePoint
from jaxrt.shapes.adjacency import MeshEdges
from jaxrt.shapes.boxes import Tree, tree_of
from jaxrt.shapes.bvh import Topology
from jaxrt.shapes.edges import along_axis, edge_functions, hit_distance, main_axis, shear
from jaxrt.shapes.smooth import corner_normals, smooth_place
from jaxrt.shapes.traverse import any_hit, nearest_hit


@pytree
class Triangles:
    """Triangles that share vertices."""

    vertices: Array  # (v, 3) scene units
    faces: Array  # (n, 3) int32 rows of `vertices`, counter-clockwise seen from outside
    material: Array  # (n,) int32
    bvh: Topology | None = None  # made by `topology_of`; None: few, tested one by one
    edges: MeshEdges | None = None  # for what moving edges add to derivatives
    smooth: Array | None = None  # (n, 3) int32, corners of one number share their normal; None: no mesh is smooth


@pytree
class TriangleTable:
    """Triangles as the intersection loop reads them."""

    corners: Array  # (n, 3, 3) corner, coordinate
    material: Array  # (n,) int32
    tree: Tree | None = None  # no derivative passes through it
    normals: Array | None = None  # (n, 3, 3) unit normal at each corner, None where no mesh is smooth


def triangle_table(triangles: Triangles) -> TriangleTable:
    """Return the rows that `find_triangle` reads; one without area, to rounding, shrinks to a point: never hit."""
    corners = triangles.vertices[triangles.faces]
    edge1, edge2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    rounding = 4 * unit_roundoff(edge1) * jnp.max(jnp.abs(edge1), -1) * jnp.max(jnp.abs(edge2), -1)
    flat = jnp.max(jnp.abs(cross(edge1.T, edge2.T)), 0) <= rounding
    corners = jnp.where(flat[:, None, None], corners[:, :1], corners)
    tree = None if triangles.bvh is None else tree_of(triangles.bvh, lax.stop_gradient(corners))
    normals = None if triangles.smooth is None else corner_normals(corners, triangles.smooth)
    return TriangleTable(corners, triangles.material, tree, normals)


def sheared(corners: Array, ray: Ray) -> list[tuple[Array, Array, Array]]:
    """Return the corners (3, 3) as the ray sees them."""
    axis = main_axis(ray.direction)
    dx, dy, dz = along_axis(axis, ray.direction)
    return [shear(*along_axis(axis, corner - ray.origin), dx / dz, dy / dz, 1 / dz) for corner in corners]


def _hit_weights(corners: Array, ray: Ray) -> tuple[Array, Array]:
    """Return the barycentric coordinates of the second and third corner; in [0, 1] also where the ray misses."""
    (e0, e1, e2), _, _ = edge_functions(sheared(corners, ray))
    total = jnp.abs(e0) + jnp.abs(e1) + jnp.abs(e2)
    return safe_divide(jnp.abs(e1), total), safe_divide(jnp.abs(e2), total)


def find_triangle(table: TriangleTable, ray: Ray, farthest: Array) -> tuple[Array, Array]:
    """Return (distance, row) of the nearest triangle closer than `farthest`; row −1 and `farthest` if none is."""
    if table.tree is not None:
        return nearest_hit(table.tree, ray.origin, ray.direction, farthest)

    def closer(i: Array, best: tuple[Array, Array]) -> tuple[Array, Array]:
        t = hit_distance(sheared(table.corners[i], ray))
        nearer = t < best[0]
        return jnp.where(nearer, t, best[0]), jnp.where(nearer, i, best[1])

    return lax.fori_loop(0, table.corners.shape[0], closer, (farthest, jnp.int32(-1)))


def occluded_by_triangle(table: TriangleTable, ray: Ray, farthest: Array) -> Array:
    """Return whether any triangle is hit closer than `farthest`."""
    if table.tree is not None:
        return any_hit(table.tree, ray.origin, ray.direction, farthest)

    def blocks(i: Array, blocked: Array) -> Array:
        return blocked | (hit_distance(sheared(table.corners[i], ray)) < farthest)

    return lax.fori_loop(0, table.corners.shape[0], blocks, jnp.zeros((), bool))


def triangle_surface_point(table: TriangleTable, ray: Ray, i: Array) -> SurfacePoint:
    """Return where the ray meets the plane of triangle `i`, in closed form and differentiable in corners and ray.

    The point is laid on the triangle by its barycentric coordinates, which keeps its error independent of the distance
    travelled (Wächter and Binder, Ray Tracing Gems 2019, ch. 6). They are those of the hit test, so that slivers
    keep the point too; Cramer's rule gives their derivatives.
    """
    corners = take(table.corners, i)
    a, edge1, edge2 = corners[0], corners[1] - corners[0], corners[2] - corners[0]
    normal = cross(edge1, edge2)
    # Solve o + t d = a + β edge1 + γ edge2 by Cramer's rule
    s = ray.origin - a
    q = cross(s, ray.direction)
    slope = dot(normal, ray.direction)
    beta, gamma = safe_divide(dot(edge2, q), -slope), safe_divide(dot(edge1, q), slope)
    beta, gamma = jnp.clip(beta, 0, 1), jnp.clip(gamma, 0, 1)
    hit1, hit2 = _hit_weights(*lax.stop_gradient((corners, ray)))
    beta, gamma = hit1 + grad_only(beta), hit2 + grad_only(gamma)
    p = a + beta * edge1 + gamma * edge2
    size = jnp.sum(jnp.max(jnp.abs(lax.stop_gradient(corners)), axis=0))
    point = SurfacePoint(p, normalize(normal), 8 * unit_roundoff(p) * size, table.material[i])
    if table.normals is None:
        return point
    lifted, smooth = smooth_place(corners, take(table.normals, i), (beta, gamma), p, point.normal, -ray.direction)
    return replace(point, position=lifted, smooth=smooth)
