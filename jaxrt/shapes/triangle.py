"""Triangles: watertight nearest hit, any hit and the surface point.

Woop, Benthin and Wald, "Watertight Ray/Triangle Intersection", JCGT 2(1), 2013: shear the ray onto the +z axis and test
the signs of three 2-D edge functions. The paper relies on both triangles of an edge computing the same bits; a compiler
that contracts a·b − c·d into a fused multiply-add breaks that. So an edge function within its rounding bound of zero
counts as inside: rays on an edge hit both triangles, and the nearer one wins.
"""

import jax.numpy as jnp
from jax import Array, lax

from jaxrt.maths import FAR, cross, dot, grad_only, normalize, safe_divide, unit_roundoff
from jaxrt.pytree import pytree
from jaxrt.records import Ray, SurfacePoint


@pytree
class Triangles:
    """Triangles that share vertices."""

    vertices: Array  # (v, 3) scene units
    faces: Array  # (n, 3) int32 rows of `vertices`, counter-clockwise seen from outside
    material: Array  # (n,) int32


@pytree
class TriangleTable:
    """Triangles as the intersection loop reads them."""

    corners: Array  # (n, 3, 3) corner, coordinate
    material: Array  # (n,) int32


@pytree
class Shear:
    """A ray turned into the +z axis: axes permuted so that z is the longest, then sheared."""

    origin: Array  # (3,)
    axis: Array  # () int32, the ray's longest direction component
    x: Array  # () shear along the first other axis, d_x/d_z
    y: Array  # () shear along the second
    z: Array  # () 1/d_z


def triangle_table(triangles: Triangles) -> TriangleTable:
    """Return the rows that `find_triangle` reads; one without area, to rounding, shrinks to a point: never hit."""
    corners = triangles.vertices[triangles.faces]
    edge1, edge2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    rounding = 4 * unit_roundoff(edge1) * jnp.max(jnp.abs(edge1), -1) * jnp.max(jnp.abs(edge2), -1)
    flat = jnp.max(jnp.abs(cross(edge1.T, edge2.T)), 0) <= rounding
    return TriangleTable(jnp.where(flat[:, None, None], corners[:, :1], corners), triangles.material)


def _permute(axis: Array, v: Array) -> tuple[Array, Array, Array]:
    """Return v's components as (x, y, z) with z along `axis`, a cyclic permutation."""
    zx, zy = axis == 0, axis == 1
    x = jnp.where(zx, v[1], jnp.where(zy, v[2], v[0]))
    y = jnp.where(zx, v[2], jnp.where(zy, v[0], v[1]))
    return x, y, jnp.where(zx, v[0], jnp.where(zy, v[1], v[2]))


def shear_of(ray: Ray) -> Shear:
    """Return the shear that turns the ray into +z."""
    size = jnp.abs(ray.direction)
    axis = jnp.where((size[0] >= size[1]) & (size[0] >= size[2]), 0, jnp.where(size[1] >= size[2], 1, 2))
    x, y, z = _permute(axis, ray.direction)
    return Shear(ray.origin, axis.astype(jnp.int32), x / z, y / z, 1 / z)


def _barycentric(corners: Array, shear: Shear) -> tuple[list[Array], list[Array], Array]:
    """Return barycentric coordinates times their sum, the corners' depths, and what counts as zero in the first."""
    xs, ys, zs = [], [], []
    for corner in corners:
        x, y, z = _permute(shear.axis, corner - shear.origin)
        xs.append(x - shear.x * z)
        ys.append(y - shear.y * z)
        zs.append(z * shear.z)
    e0 = xs[2] * ys[1] - ys[2] * xs[1]
    e1 = xs[0] * ys[2] - ys[0] * xs[2]
    e2 = xs[1] * ys[0] - ys[1] * xs[0]
    bound = 4 * unit_roundoff(e0) * _largest(xs) * _largest(ys)
    return [jnp.where(jnp.abs(e) <= bound, 0, e) for e in (e0, e1, e2)], zs, bound


def _largest(values: list[Array]) -> Array:
    return jnp.maximum(jnp.abs(values[0]), jnp.maximum(jnp.abs(values[1]), jnp.abs(values[2])))


def _distance(corners: Array, shear: Shear) -> Array:
    """Return the distance to the triangle, FAR if it is missed, behind, seen edge-on or of no area."""
    (e0, e1, e2), (z0, z1, z2), bound = _barycentric(corners, shear)
    total = e0 + e1 + e2
    same_side = ((e0 >= 0) & (e1 >= 0) & (e2 >= 0)) | ((e0 <= 0) & (e1 <= 0) & (e2 <= 0))
    t = (e0 * z0 + e1 * z1 + e2 * z2) / jnp.where(total == 0, 1, total)
    # Where the triangle reaches behind the origin, two edge functions may each be wrong by `bound`: without the
    # margin a sliver would hit the rays that leave it
    first, last = jnp.minimum(z0, jnp.minimum(z1, z2)), jnp.maximum(z0, jnp.maximum(z1, z2))
    doubt = jnp.where(first > 0, 0, 2 * bound * (last - first))
    return jnp.where(same_side & (t * jnp.abs(total) > doubt), t, FAR)


def _hit_weights(corners: Array, ray: Ray) -> tuple[Array, Array]:
    """Return the barycentric coordinates of the second and third corner; in [0, 1] also where the ray misses."""
    (e0, e1, e2), _, _ = _barycentric(corners, shear_of(ray))
    total = jnp.abs(e0) + jnp.abs(e1) + jnp.abs(e2)
    return safe_divide(jnp.abs(e1), total), safe_divide(jnp.abs(e2), total)


def find_triangle(table: TriangleTable, ray: Ray, farthest: Array) -> tuple[Array, Array]:
    """Return (distance, row) of the nearest triangle closer than `farthest`; row −1 and `farthest` if none is."""
    shear = shear_of(ray)

    def closer(i: Array, best: tuple[Array, Array]) -> tuple[Array, Array]:
        t = _distance(table.corners[i], shear)
        nearer = t < best[0]
        return jnp.where(nearer, t, best[0]), jnp.where(nearer, i, best[1])

    return lax.fori_loop(0, table.corners.shape[0], closer, (farthest, jnp.int32(-1)))


def occluded_by_triangle(table: TriangleTable, ray: Ray, farthest: Array) -> Array:
    """Return whether any triangle is hit closer than `farthest`."""
    shear = shear_of(ray)

    def blocks(i: Array, blocked: Array) -> Array:
        return blocked | (_distance(table.corners[i], shear) < farthest)

    return lax.fori_loop(0, table.corners.shape[0], blocks, jnp.zeros((), bool))


def triangle_surface_point(table: TriangleTable, ray: Ray, i: Array) -> SurfacePoint:
    """Return where the ray meets the plane of triangle `i`, in closed form and differentiable in corners and ray.

    The point is laid on the triangle by its barycentric coordinates, which keeps its error independent of the distance
    travelled (Wächter and Binder, Ray Tracing Gems 2019, ch. 6). They are those of the hit test, so that slivers
    keep the point too; Cramer's rule gives their derivatives.
    """
    corners = table.corners[i]
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
    return SurfacePoint(p, normalize(normal), 8 * unit_roundoff(p) * size, table.material[i])
