"""Smooth meshes: normals interpolated between vertices, and rays that leave from the smooth surface they suggest.

A flat face with interpolated normals shows its facets again at the shadow terminator, where light that the normal
faces comes from below the face. Rays therefore leave from a lifted point (Hanika, "Hacking the shadow terminator", Ray
Tracing Gems II, 2021, ch. 4): the point, pushed out to the tangent planes of the three vertices, weighted as they are.
Only rays that go through the surface leave from the face itself.

Vertex normals are derived from the vertices of the moment, weighted after Max ("Weights for computing vertex normals
from facet normals", Journal of Graphics Tools 4(2), 1999), which is exact for vertices on a sphere.
"""

import jax
import jax.numpy as jnp
from jax import Array

from jaxrt.core.maths import cross, dot, normalize, safe_divide, safe_sqrt, sign_or_one
from jaxrt.core.records import Smooth

GRAZING = 1e-3  # least cosine between the shading normal and the ray that arrives


def corner_normals(corners: Array, groups: Array) -> Array:
    """Return the unit normals (n, 3, 3) at the corners (n, 3, 3) of faces; corners of one group share theirs.

    groups: (n, 3) int32 in [0, 3n). A corner whose group faces away from its own face takes the face's normal.
    """
    x = jnp.moveaxis(corners, 2, 0)  # coordinate, face, corner
    after, before = jnp.roll(x, -1, 2) - x, jnp.roll(x, 1, 2) - x
    lengths = safe_sqrt(dot(after, after)) * safe_sqrt(dot(before, before))
    scale = jnp.max(lengths)
    # cross / lengths is the face's normal times the sine of the angle: Max divides by the lengths once more
    weighted = safe_divide(cross(after, before), jnp.broadcast_to(lengths, x.shape))
    weighted = weighted * safe_divide(jnp.broadcast_to(scale, lengths.shape), lengths)[None]
    flat = _unit(weighted)
    sums = jax.ops.segment_sum(weighted.reshape(3, -1).T, groups.ravel(), num_segments=3 * corners.shape[0])
    shared = _unit(sums[groups].transpose(2, 0, 1))
    return jnp.moveaxis(jnp.where((dot(shared, flat) > 0)[None], shared, flat), 0, 2)


def _unit(v: Array) -> Array:
    """Return vectors (3, …) of unit length, 0 for 0."""
    largest = jax.lax.stop_gradient(jnp.max(jnp.abs(v), 0))
    scaled = safe_divide(v, jnp.broadcast_to(largest, v.shape))
    return safe_divide(scaled, jnp.broadcast_to(safe_sqrt(dot(scaled, scaled)), v.shape))


def smooth_place(
    corners: Array, normals: Array, weights: tuple[Array, Array], facet: Array, flat: Array, wo: Array
) -> tuple[Array, Smooth]:
    """Return the lifted place (3,) on the side of `wo`, and the rest that shading needs.

    corners, normals: (3, 3) one row a corner. weights: of the second and third corner. facet: (3,) place on the face.
    flat: (3,) unit normal of the face.
    """
    side = sign_or_one(dot(flat, wo))
    shares = (1 - weights[0] - weights[1], weights[0], weights[1])
    lift, mean = jnp.zeros_like(facet), jnp.zeros_like(facet)
    for corner, normal, share in zip(corners, normals, shares, strict=True):
        mean = mean + share * normal
        below = jnp.maximum(-side * dot(facet - corner, normal), 0)
        lift = lift + share * below * side * normal
    facing = side * normalize(mean)
    # Bend a normal that looks away from where the ray came from
    short = jnp.maximum(GRAZING - dot(facing, wo), 0)
    normal = side * normalize(facing + short * wo)
    return facet + lift, Smooth(normal, facet, side)
