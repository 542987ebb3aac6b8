"""How a packet of rays that stay together walks through a mesh's tree: nearest hit and any hit.

A node's eight boxes are tested at once against the hull of the rays in the frame of their main axis (after Reshetov,
Soupikov and Hurley, "Multi-level ray tracing algorithm", 2005). Four planes bound the rays between the depth where the
first starts and the depth where the last ends: through their extremes at both depths, since the largest of straight
lines is convex in depth. So the hull is tight for rays from one point and for rays towards one point.
Faces of a leaf that the hull meets are tested one by one against all rays at once.
"""

from collections.abc import Callable

import jax.numpy as jnp
from jax import Array, lax

from jaxrt.maths import FAR, unit_roundoff
from jaxrt.native import once
from jaxrt.shapes.boxes import Tree
from jaxrt.shapes.bvh import WIDTH
from jaxrt.shapes.edges import along_axis, hit_distance, shear
from jaxrt.shapes.order import floats, largest, least, most, smallest
from jaxrt.shapes.walk import TINY, face_of, keys, leaf_at, node_at, part, walk


def walk_together(
    any_hit: bool, tree: Tree, o: Array, d: Array, farthest: Array, axis: Array, sign: Array
) -> tuple[Array, Array]:
    """Return (distance, face) of rays (3, lanes) that all go along `axis` to the side `sign`; as for `walk_alone`.

    Lanes with farthest < 0 are dead.
    """
    places = [24 * jnp.where(axis + k > 2, axis + k - 3, axis + k) for k in (1, 2, 0)]
    (ox, oy, oz), (dx, dy, dz) = (along_axis(axis, v) for v in (o, d))
    sx, sy, sz = dx / dz, dy / dz, 1 / dz
    hull = _hull(tree, (ox, oy, oz), (sign * sx, sign * sy, sign * sz), farthest, places, sign)

    def keys_of(node: Array) -> Array:
        at = node_at(tree, node)
        sides = [floats(part(tree.words, at + side + (k // 3 & 24))) for k in places for side in (0, 24)]
        return hull(*sides)

    def met(number: Array) -> Array:
        """Return one bit for each face that the hull meets."""
        at, sides = leaf_at(tree, number), []
        for k in places:
            a, b, c = (floats(part(tree.words, at + (k & 56) + 8 * corner)) for corner in range(3))
            sides += [least(least(a, b), c), most(most(a, b), c)]
        found = hull(*sides)
        ok = (found < jnp.iinfo(found.dtype).max) & (part(tree.words, at + 72) >= 0)
        return jnp.sum(jnp.where(ok, 1 << lax.iota(jnp.int32, WIDTH), 0), dtype=jnp.int32)

    def distances(number: Array, slot: Array) -> Array:
        at = leaf_at(tree, number) + (slot & 7)
        corners = [[floats(part(tree.words, at + (k & 56) + 8 * corner, 1)) for k in places] for corner in range(3)]
        return hit_distance([shear(x - ox, y - oy, z - oz, sx, sy, sz) for x, y, z in corners])

    def leaf(number: Array, farthest: Array, face: Array) -> tuple[Array, Array]:
        def one(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
            mask, farthest, face = state
            slot = 31 - lax.clz(mask & -mask)
            t = once(distances)(number, slot)
            if any_hit:
                return mask & (mask - 1), jnp.where(t < farthest, -1, farthest), face
            f = face_of(tree, number, slot)
            closer = (t < farthest) | ((t == farthest) & (f < face))
            return mask & (mask - 1), jnp.where(closer, t, farthest), jnp.where(closer, f, face)

        return lax.while_loop(lambda s: s[0] != 0, one, (once(met)(number), farthest, face))[1:]

    return walk(tree, keys_of, leaf, farthest)


def _hull(
    tree: Tree, o: tuple[Array, ...], slopes: tuple[Array, ...], farthest: Array, places: list[Array], sign: Array
) -> Callable[..., Array]:
    """Return the test of eight boxes, given by least and largest x, y, z, that gives their keys.

    Depths are counted forward, from that of the first origin. slopes: dx, dy and 1 over |dz|.
    """
    alive, u, depth = farthest >= 0, unit_roundoff(farthest), sign * o[2]

    def least_of(*rows: Array) -> Array:
        # All at once: each loop of its own costs compile time
        return smallest(jnp.where(alive[None], jnp.stack(rows), FAR))

    start, latest, end, shortest = least_of(depth, -depth, -depth - farthest / slopes[2], slopes[2])
    root = [floats(part(tree.words, side + (places[2] // 3 & 24))) for side in (0, 24)]
    span = most(least(-end, largest(jnp.where(sign > 0, root[1], -root[0]))) - start, 0)
    first = [v + (start - depth) * slope for v, slope in zip(o, slopes[:2], strict=False)]
    last = [v + span * slope for v, slope in zip(first, slopes[:2], strict=True)]
    both = least_of(*(sign * v for v in (*first, *last) for sign in (1, -1)))
    near, far = both[:4], both[4:]
    margin = tree.pad + 8 * u * (jnp.sum(jnp.abs(both)) + 4 * span)
    alone = jnp.stack([start, -latest - start + margin, shortest, span + margin, margin, sign])
    numbers = near, (far - near) / most(span, TINY), alone
    return _keys_in(once(lambda *x: jnp.concatenate(x))(*numbers))


def _keys_in(numbers: Array) -> Callable[..., Array]:
    """Return the test of `_hull` from its numbers."""

    def test(x0: Array, x1: Array, y0: Array, y1: Array, z0: Array, z1: Array) -> Array:
        lines, slopes = numbers[:4], numbers[4:8]
        start, latest, shortest, end, margin, sign = numbers[8:]
        forward = sign > 0
        near, far = jnp.where(forward, z0, -z1) - start, jnp.where(forward, z1, -z0) - start
        enter, leave = most(near - margin, 0), least(far + margin, end)
        hit = enter <= leave
        # Least x, −largest x, least y, −largest y
        for k, side in enumerate((x1, -x0, y1, -y0)):
            hit &= side >= lines[k] - margin + least(enter * slopes[k], leave * slopes[k])
        return keys(most(near - latest, 0) * shortest, hit)

    return test
