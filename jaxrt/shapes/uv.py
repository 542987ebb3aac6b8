"""Two coordinates on each surface: longitude and latitude of spheres, places on textures or shares of triangles."""

from dataclasses import replace

import jax.numpy as jnp
from jax import Array

from jaxrt.core.maths import cross, dot, normalize, safe_divide
from jaxrt.kernels.gather import take
from jaxrt.shapes import FaceChart, Geometry, Triangles
from jaxrt.shapes.sphere import round_sphere
from jaxrt.shapes.triangle import interpolated


def uv_of(geometry: Geometry, index: Array, place: Array) -> Array:
    """Return the coordinates (2,) of a place on primitive `index`, differentiable in both.

    On a sphere u goes from 0 to 1 round +y, from −z by −x, +z and +x, and v from 0 at the bottom, −y, to 1 at the top.
    On a triangle u and v are what its corners have, interpolated, or else shares of the second and the third corner.
    """
    n = 0 if geometry.spheres is None else geometry.spheres.radius.shape[0]
    found = []
    if geometry.spheres is not None:
        center = take(geometry.spheres.center, jnp.minimum(index, n - 1))
        found.append(round_sphere(normalize(place - center)))
    if geometry.triangles is not None:
        row, chart = jnp.maximum(index - n, 0), geometry.triangles.chart
        shares = _on_triangle(take(geometry.triangles.corners, row), place)
        found.append(shares if chart is None or chart.uv is None else interpolated(take(chart.uv, row), shares))
    return found[0] if len(found) == 1 else jnp.where(index < n, found[0], found[1])


def with_places(triangles: Triangles | None) -> Triangles | None:
    """Return triangles whose tables have all places on textures that there are, whether a texture asks or not."""
    if triangles is None or triangles.uv is None:
        return triangles
    return replace(triangles, chart=replace(triangles.chart or FaceChart(), uv=triangles.uv), uv=None)


def _on_triangle(corners: Array, place: Array) -> Array:
    edge1, edge2, s = corners[1] - corners[0], corners[2] - corners[0], place - corners[0]
    normal = cross(edge1, edge2)
    squared = dot(normal, normal)
    return jnp.stack(
        [safe_divide(dot(cross(s, edge2), normal), squared), safe_divide(dot(cross(edge1, s), normal), squared)]
    )
