"""The watertight test of a ray against one face, or of many against many: plain arithmetic on whatever shape comes.

Woop, Benthin and Wald, "Watertight Ray/Triangle Intersection", JCGT 2(1), 2013: shear the ray onto the +z axis and test
the signs of three 2-D edge functions. The paper relies on both triangles of an edge computing the same bits; a compiler
that contracts a·b − c·d into a fused multiply-add breaks that. So an edge function within its rounding bound of zero
counts as inside: rays on an edge hit both triangles, and the nearer one wins.
"""

from collections.abc import Sequence

import jax.numpy as jnp
from jax import Array

from jaxrt.core.maths import FAR, unit_roundoff
from jaxrt.shapes.search.order import least, most

# x, y beside the sheared ray; then the distance at which it is level with the corner along its main axis, and of
# triangles that may be wide along x and y too
Corner = tuple[Array, ...]
LEVEL = 1e-20  # least slope for which such a distance is told


def main_axis(direction: Array) -> Array:
    """Return the longest component (int32) of a direction (3,); of equal ones the first."""
    size = jnp.abs(direction)
    first = (size[0] >= size[1]) & (size[0] >= size[2])
    return jnp.where(first, 0, jnp.where(size[1] >= size[2], 1, 2)).astype(jnp.int32)


def along_axis(axis: Array, v: Array | Sequence[Array]) -> tuple[Array, Array, Array]:
    """Return v's components (3, …) as (x, y, z) with z along `axis`, a cyclic permutation."""
    zx, zy = axis == 0, axis == 1
    x = jnp.where(zx, v[1], jnp.where(zy, v[2], v[0]))
    y = jnp.where(zx, v[2], jnp.where(zy, v[0], v[1]))
    return x, y, jnp.where(zx, v[0], jnp.where(zy, v[1], v[2]))


def slopes_along(axis: Array, direction: Array) -> tuple[Array, Array, Array]:
    """Return what `shear` takes of a direction (3, …)."""
    dx, dy, dz = along_axis(axis, direction)
    return dx / dz, dy / dz, 1 / dz


def shear(x: Array, y: Array, z: Array, sx: Array, sy: Array, sz: Array, *, wide: bool = False) -> Corner:
    """Return a corner, seen from the ray's origin and with z along its main axis, sheared.

    (sx, sy, sz)·d_z = (d_x, d_y, 1).
    """
    corner = x - sx * z, y - sy * z, z * sz
    return (*corner, *(v * (sz / _nonzero(s)) for v, s in ((x, sx), (y, sy)))) if wide else corner


def _nonzero(slope: Array) -> Array:
    return jnp.where(jnp.abs(slope) < LEVEL, LEVEL, slope)


def edge_functions(corners: list[Corner]) -> tuple[list[Array], Array, Array]:
    """Return barycentric coordinates times their sum, what counts as zero in them, and whether the ray is beside all.

    A coordinate that counts as zero is set to 0. Beside: on one side of all corners. A face that is small and far to
    the side has edge functions below their rounding bound; both faces of an edge judge its two corners alike.
    """
    (x0, y0, *_), (x1, y1, *_), (x2, y2, *_) = corners
    ends = [f(a, f(b, c)) for a, b, c in ((x0, x1, x2), (y0, y1, y2)) for f in (least, most)]
    left, right, below, above = ends
    beside = (left > 0) | (right < 0) | (below > 0) | (above < 0)
    bound = 4 * unit_roundoff(x0) * most(right, -left) * most(above, -below)
    edges = x2 * y1 - y2 * x1, x0 * y2 - y0 * x2, x1 * y0 - y1 * x0
    return [jnp.where(jnp.abs(e) <= bound, 0, e) for e in edges], bound, beside


def hit_distance(corners: list[Corner]) -> Array:
    """Return the distance to the face, FAR if it is missed, behind, seen edge-on or of no area."""
    (e0, e1, e2), bound, beside = edge_functions(corners)
    (z0, *levels0), (z1, *levels1), (z2, *levels2) = (corner[2:] for corner in corners)
    total = e0 + e1 + e2
    depth = e0 * z0 + e1 * z1 + e2 * z2
    same_side = (least(e0, least(e1, e2)) >= 0) | (most(e0, most(e1, e2)) <= 0)
    # Where the triangle reaches behind the origin, two edge functions may each be wrong by `bound`: without the
    # margin a sliver would hit the rays that leave it
    first, last = least(z0, least(z1, z2)), most(z0, most(z1, z2))
    doubt = jnp.where(first > 0, 0, 2 * bound * (last - first))
    ahead = jnp.where(total < 0, -depth, depth) > doubt
    if levels0:
        # A hit is inside the triangle's box. That decides for a floor of 1e6, whose margin is 0.3: the whole of it lies
        # ahead along one axis, and the hit as far as it does
        for a, b, c in zip(levels0, levels1, levels2, strict=True):
            first, last = most(first, least(a, least(b, c))), least(last, most(a, most(b, c)))
        hit = same_side & ~beside & (total != 0) & ((first > 0) | ahead) & (last > 0)
        return jnp.where(hit, least(most(depth / jnp.where(hit, total, 1), first), last), FAR)
    hit = same_side & ~beside & ahead
    # The quotient comes last: it ends a fused loop, and what was before it would be computed twice
    return jnp.where(hit, depth, FAR) / jnp.where(hit, total, 1)
