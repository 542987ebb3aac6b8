"""All shapes of a scene behind three functions: `find`, `occluded`, `surface_point`.

`find` and `occluded` say which primitive is hit, as indices without derivative. `surface_point` recomputes where, in
closed form from the index: that is what derivatives flow through.

Primitives are numbered: spheres, then sphere lights, then triangles.
"""

from dataclasses import replace

import jax.numpy as jnp
from jax import Array, lax

from jaxrt.core.maths import FAR, dot, sign_or_one
from jaxrt.core.pytree import pytree, static, where
from jaxrt.core.records import Chart, Hit, Ray, Smooth, SurfacePoint
from jaxrt.shapes.adjacency import mesh_edges
from jaxrt.shapes.search.bvh import Survey, Topology, survey, topology_of
from jaxrt.shapes.sphere import (
    Spheres,
    SphereTable,
    find_sphere,
    kept_digits,
    lost_digits,
    nearest_approach,
    occluded_by_sphere,
    sphere_distance,
    sphere_surface_point,
    sphere_table,
    sphere_topology,
    with_more,
    without_more,
)
from jaxrt.shapes.triangle import (
    FaceChart,
    Triangles,
    TriangleTable,
    find_triangle,
    occluded_by_triangle,
    plane_distance,
    triangle_distance,
    triangle_surface_point,
    triangle_table,
)

__all__ = [
    "FaceChart",
    "Geometry",
    "Spheres",
    "Survey",
    "Topology",
    "Triangles",
    "charted_as",
    "distance_to",
    "find",
    "geometry_of",
    "kept_digits",
    "leave",
    "lost_digits",
    "mesh_edges",
    "occluded",
    "sphere_topology",
    "surface_point",
    "survey",
    "topology_of",
    "with_more",
    "without_more",
]


@pytree
class Geometry:
    """Everything a ray can hit; a kind of shape that the scene lacks is None."""

    spheres: SphereTable | None
    triangles: TriangleTable | None
    is_measured: bool = static(default=False)  # whether points tell how far light travels to them

    @property
    def has_tree(self) -> bool:
        """Whether a search spares the rays of which it is told that nothing depends on them."""
        return any(shapes is not None and shapes.tree is not None for shapes in (self.spheres, self.triangles))


def geometry_of(spheres: Spheres | None, triangles: Triangles | None, is_measured: bool = False) -> Geometry:
    """Return the tables that the three functions read. is_measured: points tell how far light travels to them."""
    return Geometry(
        None if spheres is None else sphere_table(spheres),
        None if triangles is None else triangle_table(triangles),
        is_measured,
    )


def find(geometry: Geometry, ray: Ray, wanted: Array | None = None) -> Hit:
    """Return what the ray hits first. No derivative passes through.

    wanted: () bool; where not, nothing is hit, and a tree is not searched. None: always.
    """
    geometry, ray = lax.stop_gradient((geometry, ray))
    distance, index = jnp.full((), FAR, ray.origin.dtype), jnp.int32(-1)
    if wanted is not None:
        distance = jnp.where(wanted, distance, 0)
    if geometry.spheres is not None:
        distance, index = find_sphere(geometry.spheres, ray, distance)
    if geometry.triangles is not None:
        _, row = find_triangle(geometry.triangles, ray, distance)
        index = jnp.where(row >= 0, row + _first_triangle(geometry), index)
    return Hit(jnp.maximum(index, 0), index >= 0)


def distance_to(geometry: Geometry, ray: Ray, index: Array, whole: bool = False) -> Array:
    """Return the distance () along the ray to primitive `index`, FAR if it misses. No derivative passes through.

    whole: surfaces go on beyond their outlines, triangles by their planes, spheres by where a ray is nearest to them.
    """
    geometry, ray = lax.stop_gradient((geometry, ray))
    of_triangle = plane_distance if whole else triangle_distance
    of_sphere = nearest_approach if whole else sphere_distance
    if geometry.triangles is None:
        assert geometry.spheres is not None
        return of_sphere(geometry.spheres, ray, index)
    if geometry.spheres is None:
        return of_triangle(geometry.triangles, ray, index)
    first = _first_triangle(geometry)
    a = of_sphere(geometry.spheres, ray, jnp.minimum(index, first - 1))
    return jnp.where(index < first, a, of_triangle(geometry.triangles, ray, jnp.maximum(index - first, 0)))


def occluded(geometry: Geometry, ray: Ray, distance: Array, skip: Array | None = None) -> Array:
    """Return whether anything but sphere row `skip` lies on the ray closer than `distance`."""
    geometry, ray, distance = lax.stop_gradient((geometry, ray, distance))
    blocked = jnp.zeros((), bool)
    if geometry.spheres is not None:
        blocked = occluded_by_sphere(geometry.spheres, ray, distance, skip)
    if geometry.triangles is not None:
        blocked = blocked | occluded_by_triangle(geometry.triangles, ray, distance)
    return blocked


def surface_point(geometry: Geometry, ray: Ray, hit: Hit) -> SurfacePoint:
    """Return the point where the ray meets primitive `hit.index`; finite, but meaningless, where nothing is hit."""
    return measured(geometry, ray, _surface_point(geometry, ray, hit))


def measured(geometry: Geometry, ray: Ray, point: SurfacePoint) -> SurfacePoint:
    """Return the point with the length of the ray that found it, where the scene wants that."""
    if not geometry.is_measured:
        return point
    return replace(point, travelled=dot(place_of(point) - ray.origin, ray.direction))


def _surface_point(geometry: Geometry, ray: Ray, hit: Hit) -> SurfacePoint:
    if geometry.triangles is None:
        assert geometry.spheres is not None
        return sphere_surface_point(geometry.spheres, ray, hit.index)
    if geometry.spheres is None:
        return triangle_surface_point(geometry.triangles, ray, hit.index)
    first = _first_triangle(geometry)
    on_sphere = hit.index < first
    a = sphere_surface_point(geometry.spheres, ray, jnp.minimum(hit.index, first - 1))
    b = triangle_surface_point(geometry.triangles, ray, jnp.maximum(hit.index - first, 0))
    if b.smooth is not None:
        a = replace(a, smooth=Smooth(a.normal, a.position, jnp.ones_like(a.error)))
    if a.chart is not None or b.chart is not None:
        a, b = charted_as(a, b), charted_as(b, a)
    return where(on_sphere, a, b)


def charted_as(point: SurfacePoint, other: SurfacePoint) -> SurfacePoint:
    """Return the point with a chart of the parts that another's has too, those that it lacks being 0."""
    own, more = point.chart or Chart(), other.chart or Chart()
    parts = ((getattr(own, part), getattr(more, part)) for part in ("uv", "vertices", "shares"))
    return replace(point, chart=Chart(*(jnp.zeros_like(b) if a is None and b is not None else a for a, b in parts)))


def place_of(point: SurfacePoint) -> Array:
    """Return where a point (3,) lies on the surface itself, which that of a smooth mesh may be lifted off."""
    return point.position if point.smooth is None else point.smooth.facet


def leave(point: SurfacePoint, direction: Array) -> Ray:
    """Return the ray from a surface point, its origin moved off the surface by the point's own rounding bound.

    The move is along the geometric normal, to the side the ray goes to, and carries no derivative
    (Pharr et al., Physically Based Rendering, 4th ed., §6.8.6; ours is bounded by the coordinates' size).
    """
    side, start = sign_or_one(dot(point.normal, direction)), point.position
    if point.smooth is not None:
        # The lifted position is on the side that the ray came from; from there, go by the shading normal
        through = dot(point.smooth.normal, direction) * point.smooth.side < 0
        side = jnp.where(through, -point.smooth.side, point.smooth.side)
        start = jnp.where(through, point.smooth.facet, start)
    return Ray(start + lax.stop_gradient(side * point.error * point.normal), direction)


def _first_triangle(geometry: Geometry) -> int:
    return 0 if geometry.spheres is None else geometry.spheres.radius.shape[0]
