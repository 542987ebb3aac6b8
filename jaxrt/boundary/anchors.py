"""Points that stay where they are on a surface, or on an outline, while it moves: what clearances are made of."""

import jax.numpy as jnp
from jax import Array

from jaxrt.boundary.clearance import Anchors
from jaxrt.boundary.silhouettes import Rim, Silhouettes
from jaxrt.core.maths import cross, dot, safe_divide
from jaxrt.shapes import Geometry


def surface_anchors(
    geometry: Geometry, faces: Array | None, index: Array, point: tuple[Array, Array], factor: Array
) -> Anchors:
    """Return the point of primitive `index` that stays where it is on it, times a factor (3,).

    point: position and outward normal. faces: (n, 3) of all triangles; None where triangles do not move.
    """
    p, n = point[0], 0 if geometry.spheres is None else geometry.spheres.radius.shape[0]
    on_sphere = jnp.where(index < n, 1, 0).astype(p.dtype)
    sphere = normal = on = None
    if geometry.spheres is not None:
        sphere, normal, on = jnp.clip(index, 0, n - 1), point[1], on_sphere
    if faces is None:
        return Anchors(sphere, normal, on, None, None, factor)
    assert geometry.triangles is not None
    face = jnp.maximum(index - n, 0)
    weights = (1 - on_sphere) * _barycentric(geometry.triangles.corners[face], p)
    return Anchors(sphere, normal, on, faces[face], weights, factor)


def _barycentric(corners: Array, p: Array) -> Array:
    """Return the barycentric coordinates (3,) of a point in a triangle's plane; 0, 0, 1 for one without area."""
    edge1, edge2, s = corners[1] - corners[0], corners[2] - corners[0], p - corners[0]
    normal = cross(edge1, edge2)
    squared = dot(normal, normal)
    beta = safe_divide(dot(cross(s, edge2), normal), squared)
    gamma = safe_divide(dot(cross(edge1, s), normal), squared)
    return jnp.stack([1 - beta - gamma, beta, gamma])


def occluder_anchors(outlines: Silhouettes, meshes_move: bool, row: Array, t: Array, rim: Rim) -> Anchors:
    """Return the outline's point with the factor −m that the clearance gives it."""
    n = outlines.spheres_count
    on_sphere = jnp.where(row < n, 1, 0).astype(t.dtype)
    factor = jnp.where(rim.valid, -rim.normal, 0)
    sphere = normal = on = None
    if outlines.spheres is not None:
        sphere, normal, on = jnp.minimum(row, n - 1), rim.normal, on_sphere
    if outlines.edges is None or not meshes_move:
        return Anchors(sphere, normal, on, None, None, factor)
    ends = outlines.edges.vertices[jnp.maximum(row - n, 0)]
    weights = (1 - on_sphere) * jnp.stack([1 - t, t, jnp.zeros_like(t)])
    return Anchors(sphere, normal, on, jnp.stack([ends[0], ends[1], ends[0]]), weights, factor)
