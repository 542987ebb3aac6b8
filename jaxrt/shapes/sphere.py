"""Spheres: nearest hit, any hit and the surface point, right for walls of radius 1e6 and for small far balls.

Few are tested one by one. Of many, all but walls are found through a tree, as the faces of a mesh are.
"""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.typing import DTypeLike
from numpy.typing import NDArray

from jaxrt.core.maths import dot, grad_only, normalize, safe_divide, safe_sqrt, two_sum, unit_roundoff
from jaxrt.core.pytree import pytree, static
from jaxrt.core.records import Chart, Ray, SurfacePoint
from jaxrt.kernels.gather import take
from jaxrt.kernels.native import once
from jaxrt.shapes.roots import power_of, root_distance, roots_of, smallest
from jaxrt.shapes.search.boxes import Tree, ball_tree
from jaxrt.shapes.search.bvh import Topology, topology_of_boxes
from jaxrt.shapes.search.few_shapes import any_of, nearest_of
from jaxrt.shapes.search.traverse import any_hit, nearest_hit

Floats = NDArray[np.float64]
Row = tuple[Array, Array, Array, Array, Array]  # center, radius, base, shift, constant
Coordinates = tuple[tuple[Array, ...], tuple[Array, ...]]  # of a ray's origin and direction
MIN_SPHERES = 72  # fewer are tested one by one: from there on a tree is faster for rays of all kinds, packets from 24
WALLS, WALL = 16, 8  # so many spheres, the largest ones, stay outside of a tree, if they are so many times the usual


@pytree
class Spheres:
    """What the user owns, and of huge spheres the digits that its numbers have no room for."""

    center: Array  # (n, 3) scene units
    radius: Array  # (n,) scene units, > 0
    lost: Array  # (n,) scene units, what rounding the above took from the radius (`lost_digits`); without derivative
    material: Array  # (n,) int32
    bvh: Topology | None = None  # made by `sphere_topology`; None: few, tested one by one
    outside: Array | None = None  # (k,) int32, rows that are tested one by one beside the tree
    charted: bool = static(default=False)  # whether surface points say where on the sphere they are


@pytree
class SphereTable:
    """Spheres as the intersection loop reads them: power = (o − base)·(f − shift) + constant."""

    center: Array  # (n, 3)
    radius: Array  # (n,)
    base: Array  # (n, 3) origin of coordinates for the power: 0 for huge spheres, else the centre
    shift: Array  # (n, 3) center − base
    constant: Array  # (n,)
    material: Array  # (n,) int32
    outside: Array | None = None  # (k,) int32, rows that are not in the tree; None without
    tree: Tree | None = None  # no derivative passes through it
    charted: bool = static(default=False)


def sphere_table(spheres: Spheres) -> SphereTable:
    """Return the rows that `find_sphere` and `occluded_by_sphere` read; derivatives go to centre and radius only."""
    c, r = spheres.center, spheres.radius
    squared = jnp.sum(c * c, -1)
    huge = r * r > squared / 4
    power = exact_power(c, r, kept_digits(spheres)) + grad_only(squared - r * r)
    base, constant = jnp.where(huge[:, None], 0, c), jnp.where(huge, power, -r * r)
    tree = None if spheres.bvh is None else ball_tree(spheres.bvh, *lax.stop_gradient((c, r, base, constant)))
    shift = jnp.where(huge[:, None], c, 0)
    return SphereTable(c, r, base, shift, constant, spheres.material, spheres.outside, tree, spheres.charted)


def with_more(spheres: Spheres, center: Array, radius: Array, material: Array) -> Spheres:
    """Return the spheres followed by others (m, …) of which no digits are lost, outside of any tree."""
    outside = None
    if spheres.outside is not None:
        rows = spheres.radius.shape[0] + jnp.arange(radius.shape[0], dtype=jnp.int32)
        outside = jnp.concatenate([spheres.outside, rows])
    return Spheres(
        jnp.concatenate([spheres.center, center]),
        jnp.concatenate([spheres.radius, radius]),
        jnp.concatenate([spheres.lost, jnp.zeros_like(radius)]),
        jnp.concatenate([spheres.material, material]),
        spheres.bvh,
        outside,
        spheres.charted,
    )


def without_more(table: SphereTable, n: int) -> SphereTable:
    """Return the table of the first n spheres, where the others were added by `with_more`."""
    more, outside = table.radius.shape[0] - n, table.outside
    first = jax.tree.map(lambda x: x[:n], replace(table, outside=None, tree=None))
    kept = None if outside is None else outside[: outside.shape[0] - more]
    return replace(first, outside=kept, tree=table.tree)


def sphere_topology(center: Floats, radius: Floats, least: int = MIN_SPHERES) -> tuple[Topology, Array] | None:
    """Return the tree over spheres (n, 3), (n,), and the rows (k,) of those outside of it; None where they are few."""
    if len(radius) < least:
        return None
    order = np.argsort(-radius, kind="stable")
    walls = int(np.sum(radius[order[:WALLS]] > WALL * np.median(radius)))
    outside, inside = np.sort(order[:walls]), np.sort(order[walls:])
    low, high = (center[inside] + sign * radius[inside, None] for sign in (-1, 1))
    tree = topology_of_boxes(low, high)
    rows = jnp.asarray(np.append(inside, -1), jnp.int32)
    return replace(tree, faces=rows[tree.faces]), jnp.asarray(outside, jnp.int32)


def _row(table: SphereTable, i: Array) -> Row:
    center, radius = take(table.center, i), take(table.radius, i)
    return center, radius, take(table.base, i), take(table.shift, i), take(table.constant, i)


def sphere_distance(table: SphereTable, ray: Ray, i: Array) -> Array:
    """Return the smallest positive distance to sphere `i`, FAR if there is none. No derivative is taken of it."""
    return root_distance(_row(table, i), ray.origin, ray.direction)


def nearest_approach(table: SphereTable, ray: Ray, i: Array) -> Array:
    """Return that distance, and of a ray that misses where it is nearest to the sphere: both meet at its outline."""
    b, power, discriminant = roots_of(_row(table, i), ray.origin, ray.direction)
    return jnp.where((discriminant <= 0) & (power > 0) & (b < 0), -b, smallest(b, power, discriminant))


def _pair(table: SphereTable, ray: Coordinates, pair: Array) -> list[tuple[Array, Array]]:
    """Return (row, distance) of two neighbouring spheres; an odd last one comes twice, which harms nothing.

    Two at a time halve the loop's bookkeeping: a search of ten spheres takes 16 ns instead of 27.
    """
    rows = [jnp.minimum(2 * pair + j, _in_loop(table) - 1) for j in range(2)]
    if table.outside is not None:
        rows = [take(table.outside, i) for i in rows]
    distances = once(lambda rows, ray: [root_distance(_row(table, i), *ray) for i in rows])(rows, ray)
    return list(zip(rows, distances, strict=True))


def _in_loop(table: SphereTable) -> int:
    """Return how many spheres are tested one by one."""
    return (table.radius if table.outside is None else table.outside).shape[0]


def _coordinates(ray: Ray) -> Coordinates:
    return tuple(ray.origin), tuple(ray.direction)


def find_sphere(table: SphereTable, ray: Ray, farthest: Array) -> tuple[Array, Array]:
    """Return (distance, row) of the nearest sphere closer than `farthest`; row −1 and `farthest` if there is none."""
    distance, row = farthest, jnp.int32(-1)
    if _in_loop(table):
        distance, row = nearest_of(-(-_in_loop(table) // 2), partial(_pair, table, _coordinates(ray)), farthest)
    if table.tree is None:
        return distance, row
    distance, ball = nearest_hit(table.tree, ray.origin, ray.direction, distance)
    return distance, jnp.where(ball >= 0, ball, row)


def occluded_by_sphere(table: SphereTable, ray: Ray, farthest: Array, skip: Array | None) -> Array:
    """Return whether any sphere but row `skip`, which is in no tree, is hit closer than `farthest`."""
    blocked = jnp.zeros((), bool)
    if _in_loop(table):
        blocked = any_of(-(-_in_loop(table) // 2), partial(_pair, table, _coordinates(ray)), farthest, skip)
    if table.tree is None:
        return blocked
    return blocked | any_hit(table.tree, ray.origin, ray.direction, jnp.where(blocked, 0, farthest))


def sphere_surface_point(table: SphereTable, ray: Ray, i: Array) -> SurfacePoint:
    """Return where the ray meets sphere `i`, in closed form and differentiable in sphere and ray.

    A ray that misses gets some finite point. A projection puts the point on the sphere to within `error`.
    """
    row = once(_row)(table, i)
    t = once(_distance_to_surface)(row, ray)
    p = once(onto_sphere)(row, ray.origin + t * ray.direction)
    normal = normalize(p - row[0])
    return SurfacePoint(p, normal, sphere_error(row, p), table.material[i], chart=sphere_chart(table, normal))


def sphere_chart(table: SphereTable, normal: Array) -> Chart | None:
    """Return where on a sphere of the table its normal (3,) is, None where no texture asks."""
    return Chart(uv=round_sphere(normal)) if table.charted else None


def round_sphere(normal: Array) -> Array:
    """Return longitude and latitude (2,), in [0, 1], of a direction (3,) from a sphere's middle.

    u goes round +y, from −z by −x, +z and +x, and v from the bottom, −y, to the top.
    """
    x, y, z = normal
    across = safe_sqrt(x * x + z * z)
    pole = across == 0
    u = 0.5 + jnp.arctan2(x, jnp.where(pole, 1, z)) / (2 * jnp.pi)
    v = 0.5 + jnp.arctan2(y, jnp.where(pole, jnp.where(y == 0, 1, 0), across)) / jnp.pi
    return jnp.stack([u, v])


def _distance_to_surface(row: Row, ray: Ray) -> Array:
    """Return the distance that `root_distance` finds, differentiable; for a miss, that to where the line is nearest.

    The quotient would be without bound where such a ray begins beside the sphere, and its derivative no number.
    """
    b, power, discriminant = roots_of(row, ray.origin, ray.direction)
    meets, root = discriminant > 0, safe_sqrt(discriminant)
    smaller = jnp.where(meets, jnp.abs(power / jnp.where(meets, jnp.abs(b) + root, 1)), jnp.abs(b))
    return jnp.where((power < 0) & (b < 0), root - b, smaller)


def onto_sphere(row: Row, p: Array) -> Array:
    """Return p moved along the normal onto the sphere: c + (p − c) r/m, m = |p − c|, without its cancellation."""
    center, radius, _, _, _ = row
    power = power_of(row, p)
    m = safe_sqrt(radius * radius + power)
    return p - (p - center) * safe_divide(power, m * (m + radius))


def sphere_error(row: Row, p: Array) -> Array:
    """Return a bound on the distance from a point computed on the sphere to the sphere, without derivative.

    8u times the terms that the power sums, over its slope 2r, plus the rounding of the coordinates.
    """
    center, radius, base, shift, constant = map(lax.stop_gradient, row)
    p = lax.stop_gradient(p)
    terms = dot(jnp.abs(p - base), jnp.abs(p) + jnp.abs(center) + jnp.abs(shift)) + jnp.abs(constant)
    return 8 * unit_roundoff(p) * (terms / (2 * radius) + jnp.sum(jnp.abs(p)))


def lost_digits(center: Floats, radius: Floats, dtype: DTypeLike) -> Floats:
    """Return by how much the radii (n,) must be longer, once all is rounded to `dtype`, for walls to stay in place.

    It puts a wall of radius 1e6 where it should be, though its centre is rounded to 1/16. With the rounded c and r,
    (r + lost)² − |c|² is that of the unrounded sphere, and with it the power of the origin, near which the scene lies.
    Of spheres that are not huge 0: they are what their numbers say. center: (n, 3), float64.
    """
    c, r = (np.asarray(x, dtype).astype(float) for x in (center, radius))
    excess = (radius - r) * (radius + r) - np.sum((center - c) * (center + c), -1)
    huge = r * r > np.sum(c * c, -1) / 4
    return np.where(huge, excess / (r + np.sqrt(np.maximum(r * r + excess, 0))), 0)


def kept_digits(spheres: Spheres) -> Array:
    """Return the lost digits (n,) as far as they may be those of the present centre and radius, else 0.

    So whatever changes centre and radius, with the digits or without, gets the sphere that they say: off by half an ulp
    of them at most, and not at all where it is another sphere altogether. For rounding takes at most u|x| from a number
    x, so that |(r + lost)² − r²| ≤ 2u(|c|² + r²) to first order, hence |lost| r ≤ u(|c|² + r²).
    """
    c, r = spheres.center, spheres.radius
    squared = jnp.sum(c * c, -1)
    most = 1.001 * unit_roundoff(r) * (squared + r * r)  # .001: more than enough for the second order
    kept = (jnp.abs(spheres.lost) * r <= most) & (r * r > squared / 4)
    return lax.stop_gradient(jnp.where(kept, spheres.lost, 0))


def exact_power(center: Array, radius: Array, lost: Array) -> Array:
    """Return |center|² − (radius + lost)² of each sphere, rounded once, without derivative.

    center: (n, 3), radius: (n,), lost: (n,) far below the radius. Each factor is split into two halves whose products
    are exact, so that no compiler's choice between rounding a product and fusing it matters; the products are summed
    with their rounding errors (Ogita, Rump and Oishi 2005), in pairs.
    """
    factors, lost = lax.stop_gradient((jnp.concatenate([center, radius[:, None]], -1), lost))
    word, cut = (jnp.uint32, 12) if factors.dtype == jnp.float32 else (jnp.uint64, 27)
    high = lax.bitcast_convert_type(lax.bitcast_convert_type(factors, word) >> cut << cut, factors.dtype)
    halves = jnp.stack([high, factors - high], -1)
    signed = halves * jnp.asarray([1, 1, 1, -1], factors.dtype)[None, :, None]
    total, error = (signed[..., None] * halves[..., None, :]).reshape(-1, 16), -lost * (2 * factors[:, 3] + lost)
    while total.shape[-1] > 1:
        total, rest = two_sum(*jnp.split(total, 2, -1))
        error = error + jnp.sum(rest, -1)
    return total[:, 0] + error
