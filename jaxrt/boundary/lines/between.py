"""What lies between two neighbouring chains that are not alike: an outline, or a curve where two surfaces cross.

Both are places on a ray o + τ d that leaves what the chains have in common. Of an outline, q on the occluder is at
o + τ d, and m is the unit vector at right angles to both. Where surfaces A and B of normals n_A and n_B cross, the
curve runs along n_A × n_B, and

    m = d × (n_A × n_B) / |…| = ((n_B·d) n_A − (n_A·d) n_B) / |…|.

The ray clears them by F = m·(o + τ d) − m·Q, or − ((n_B·d) n_A·P_A − (n_A·d) n_B·P_B) / |…|, P_A and P_B being the
material points at the place: all of them points on surfaces, times factors.
"""

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxrt.core.maths import FAR, cross, dot, normalize, safe_divide, safe_sqrt
from jaxrt.core.pytree import pytree, where
from jaxrt.core.records import Hit, Ray
from jaxrt.kernels.gather import take
from jaxrt.kernels.native import once
from jaxrt.shapes import Geometry, distance_to, surface_point

PARALLEL = 1e-4  # least sine between ray and curve, times that between both surfaces


@pytree
class Place:
    """Points on surfaces that come into F, besides the ray."""

    index: Array  # (2,) int32 primitives
    position: Array  # (2, 3)
    normal: Array  # (2, 3) unit; of a sphere from its centre to the position
    factor: Array  # (2, 3)
    aside: Array  # (3,) m
    distance: Array  # () τ
    crossing: Array  # () bool: no outline
    valid: Array  # () bool


def distances(geometry: Geometry, ray: Ray, pair: Array) -> tuple[Array, Array]:
    """Return the distances (2,) to two primitives, first as if they went on beyond their outlines, then as they are."""

    def both(i: Array) -> tuple[Array, Array]:
        return distance_to(geometry, ray, i, whole=True), distance_to(geometry, ray, i)

    return lax.map(both, jnp.maximum(pair, 0))


def may_cross(geometry: Geometry, pair: Array) -> Array:
    """Return whether two primitives are such as can cross: faces of one edge touch, but do not."""
    a, b = jnp.maximum(pair[0], 0), jnp.maximum(pair[1], 0)
    fine = (pair[0] != pair[1]) & (jnp.minimum(pair[0], pair[1]) >= 0)
    if geometry.triangles is None:
        return fine
    first = 0 if geometry.spheres is None else geometry.spheres.radius.shape[0]
    one, other = (take(geometry.triangles.corners, jnp.maximum(i - first, 0)) for i in (a, b))
    same = jnp.all(one[:, None] == other[None], -1)
    return fine & ~((jnp.sum(same) >= 2) & (a >= first) & (b >= first))


def place_between(geometry: Geometry, rays: Ray, met: Array, margin: tuple[Ray, Ray]) -> Place:
    """Return what ends between two rays (2,) that meet the primitives `met` (2,), negative for none.

    margin: a ray farther out on either side; triangles are taken to cross only if both rays there meet both.
    """
    first = jax.tree.map(lambda x: x[0], rays)
    spheres = 0 if geometry.spheres is None else geometry.spheres.radius.shape[0]
    four = jax.tree.map(lambda x, a, b: jnp.concatenate([x, jnp.stack([a, b])]), rays, *margin)
    whole, own = lax.map(lambda ray: distances(geometry, ray, met), four)
    own, wide = own[:2], own[2:]
    # A sphere goes up to its outline, where curves graze it; a triangle to just before its border
    there = jnp.all(jnp.where((met < spheres)[None], own, wide) < FAR)
    crossing = there & may_cross(geometry, met)
    # What the other side's ray misses ends here; of two such the nearer
    ends_a = (met[0] >= 0) & (own[1, 0] >= FAR)
    ends_b = (met[1] >= 0) & (own[0, 1] >= FAR)
    a_is_nearer = whole[0, 0] <= whole[0, 1]
    is_a = ends_a & (a_is_nearer | ~ends_b)
    occluder = jnp.maximum(jnp.where(is_a, met[0], met[1]), 0)
    return _either(
        crossing, once(_crossing)(geometry, first, met), once(_outline)(geometry, rays, occluder, ends_a | ends_b)
    )


def _either(crossing: Array, one: Place, other: Place) -> Place:
    chosen: Place = where(crossing, one, other)
    return chosen


def _crossing(geometry: Geometry, ray: Ray, met: Array) -> Place:
    """Return the place where two surfaces cross."""
    pair = jnp.maximum(met, 0)
    both = met.min() >= 0
    distance = distance_to(geometry, ray, pair[0], whole=True)
    distance = jnp.where(both & (distance < FAR), distance, 1)
    normals = lax.map(lambda i: surface_point(geometry, ray, Hit(i, both)).normal, pair)
    aside = cross(ray.direction, cross(normals[0], normals[1]))
    length = safe_sqrt(dot(aside, aside))
    slopes = jnp.stack([dot(normals[1], ray.direction), -dot(normals[0], ray.direction)])
    factors = -safe_divide(slopes, length)[:, None] * normals
    position = ray.origin + distance * ray.direction
    valid = both & (length > PARALLEL)
    return Place(
        pair, jnp.stack([position] * 2), normals, factors, normalize(aside), distance, jnp.ones((), bool), valid
    )


def _outline(geometry: Geometry, rays: Ray, index: Array, valid: Array) -> Place:
    """Return the place where an outline of primitive `index` lies between two rays (2,)."""
    n = 0 if geometry.spheres is None else geometry.spheres.radius.shape[0]
    ray = jax.tree.map(lambda x: x[0], rays)
    found = []
    if geometry.spheres is not None:
        row = jnp.minimum(index, n - 1)
        center, radius = geometry.spheres.center[row], geometry.spheres.radius[row]
        distance = dot(center - ray.origin, ray.direction)
        aside = normalize(ray.origin + distance * ray.direction - center)
        found.append((center + radius * aside, aside, distance))
    if geometry.triangles is not None:
        found.append(_edge_place(take(geometry.triangles.corners, jnp.maximum(index - n, 0)), rays))
    position, aside, distance = found[0]
    if len(found) == 2:
        position, aside, distance = where(index < n, *found)
    valid = valid & (dot(aside, aside) > 0) & (distance > 0)
    nothing = jnp.zeros_like(aside)
    return Place(
        jnp.stack([index, index]),
        jnp.stack([position, position]),
        jnp.stack([aside, aside]),
        jnp.stack([-aside, nothing]),
        aside,
        distance,
        jnp.zeros((), bool),
        valid,
    )


def _edge_place(corners: Array, rays: Ray) -> tuple[Array, Array, Array]:
    """Return (point, m, τ) on that edge of a triangle which two rays (2,) pass on different sides."""

    def sides(ray: Ray) -> Array:
        """Return on which side of each edge a ray passes, (3,): volumes over the length of the edge."""
        found = []
        for i in range(3):
            a, b = corners[i] - ray.origin, corners[(i + 1) % 3] - ray.origin
            edge = b - a
            found.append(safe_divide(dot(ray.direction, cross(a, b)), safe_sqrt(dot(edge, edge))))
        return jnp.stack(found)

    one, other = (sides(jax.tree.map(lambda x, i=i: x[i], rays)) for i in range(2))
    off = jnp.where(one * other <= 0, 0, jnp.minimum(jnp.abs(one), jnp.abs(other)))
    k = jnp.where((off[0] <= off[1]) & (off[0] <= off[2]), 0, jnp.where(off[1] <= off[2], 1, 2))
    p, q = (
        jnp.where(k == 0, corners[i], jnp.where(k == 1, corners[(1 + i) % 3], corners[(2 + i) % 3])) for i in (0, 1)
    )
    ray = jax.tree.map(lambda x: x[0], rays)
    edge, away = q - p, p - ray.origin
    across = cross(edge, ray.direction)
    squared = dot(across, across)
    distance = safe_divide(dot(cross(away, edge), -across), squared)
    t = jnp.clip(safe_divide(dot(cross(away, ray.direction), -across), squared), 0, 1)
    return p + t * edge, normalize(across), distance
