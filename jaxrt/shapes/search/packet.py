"""How a packet of rays that stay together walks through a mesh's tree: nearest hit and any hit.

A node's eight boxes are tested at once against the hull of the rays in the frame of their main axis (after Reshetov,
Soupikov and Hurley, "Multi-level ray tracing algorithm", 2005). Four planes bound the rays between the depth where the
first starts and the depth where the last ends: through their extremes at both depths, since the largest of straight
lines is convex in depth. So the hull is tight for rays from one point and for rays towards one point.
Faces of a leaf that the hull meets are tested one by one against all rays at once. Of a packet that is wider than a
leaf few rays may meet it: its box is tested first, and few rays are tested one by one against all faces, as alone.
"""

from collections.abc import Callable
from functools import partial

import jax.numpy as jnp
from jax import Array, lax

from jaxrt.core.maths import FAR, unit_roundoff
from jaxrt.kernels.bits import each, mask
from jaxrt.kernels.gather import part, put
from jaxrt.kernels.native import once
from jaxrt.shapes.edges import along_axis
from jaxrt.shapes.search.boxes import Tree
from jaxrt.shapes.search.bvh import WIDTH
from jaxrt.shapes.search.order import floats, largest, least, most, smallest
from jaxrt.shapes.search.walk import (
    TINY,
    closest,
    face_of,
    leaf_at,
    leaf_boxes,
    leaf_distances,
    nonzero,
    places_of,
    slabs,
    walk,
)

Numbers = tuple[Array, ...]  # (lanes,) each, x and y beside the main axis first
FEW = 8  # no more rays than that are tested against a leaf one by one


def walk_together(
    any_hit: bool, tree: Tree, o: Array, d: Array, farthest: Array, axis: Array, sign: Array, within: Array
) -> tuple[Array, Array]:
    """Return (distance, face) of rays (3, lanes) that all go along `axis` to the side `sign`; as for `walk_alone`.

    Lanes with farthest < 0 are dead; at most 32 lanes. within: they are closer together than a leaf is wide.
    """
    places = places_of(axis)
    origin, (dx, dy, dz) = (along_axis(axis, v) for v in (o, d))
    sx, sy, sz = dx / dz, dy / dz, 1 / dz
    hull = _hull(tree, origin, (sign * sx, sign * sy, sign * sz), farthest, places, sign)

    def boxes(at: Array) -> tuple[Array, Array]:
        sides = [floats(part(tree.words, at + side + (k // 3 & 24), WIDTH)) for k in places for side in (0, 24)]
        return hull(*sides)

    meet = _rays_in(tree, origin, (1 / nonzero(dx), 1 / nonzero(dy), sz), places)
    rays = (*o, *d) if tree.balls else (*origin, sx, sy, sz)
    by_ray, by_face = _by_ray(any_hit, tree, rays, places), _by_face(any_hit, tree, rays, places)

    def leaf(code: Array, box: Array, farthest: Array, face: Array) -> tuple[Array, Array]:
        rays = lax.cond(within, lambda *_: jnp.int32(-1), once(meet), box, farthest)
        few = lax.population_count(rays) <= FEW
        faces = lax.cond(few, lambda _: jnp.int32(0), once(partial(_faces_in, tree, hull, places)), code)
        return by_face(code, faces, *by_ray(code, jnp.where(few, rays, 0), farthest, face))

    return walk(tree, boxes, leaf, farthest)


def _rays_in(tree: Tree, origin: Numbers, inverse: Numbers, places: list[Array]) -> Callable[[Array, Array], Array]:
    """Return the test of all rays against one box, by its place among the words, that gives a bit for each ray."""

    def test(box: Array, farthest: Array) -> Array:
        low, high = ([floats(part(tree.words, box + side + (k // 3 & 24), 1)) for k in places] for side in (0, 24))
        enter, leave = slabs(low, high, origin, inverse)
        return mask(enter <= least(leave, farthest) * (1 + 8 * unit_roundoff(farthest)))

    return test


def _faces_in(tree: Tree, hull: Callable[..., tuple[Array, Array]], places: list[Array], leaf: Array) -> Array:
    """Return one bit for each face of a leaf that the hull meets."""
    there = part(tree.words, leaf_at(tree, leaf) + 72, WIDTH) >= 0
    return mask(hull(*leaf_boxes(tree, leaf, places))[1] & there)


def _by_ray(any_hit: bool, tree: Tree, rays: Numbers, places: list[Array]) -> Callable[..., tuple[Array, Array]]:
    """Return the test of the rays in a mask, one after another, against all faces of a leaf."""

    def distances(leaf: Array, lane: Array) -> Array:
        return leaf_distances(tree, leaf, places, [part(x, lane, 1) for x in rays])

    def one(leaf: Array, lane: Array, farthest: Array, face: Array) -> tuple[Array, Array]:
        t = once(distances)(leaf, lane)
        mine = closest(any_hit, tree, leaf, t, *(part(x, lane, 1)[0] for x in (farthest, face)))
        return put(farthest, mine[0][None], lane), put(face, mine[1][None], lane)

    return lambda leaf, bits, farthest, face: each(partial(one, leaf), bits, farthest, face)


def _by_face(any_hit: bool, tree: Tree, rays: Numbers, places: list[Array]) -> Callable[..., tuple[Array, Array]]:
    """Return the test of the faces in a mask, one after another, against all rays."""

    def distances(leaf: Array, slot: Array) -> Array:
        return leaf_distances(tree, leaf, places, rays, slot)

    def one(leaf: Array, slot: Array, farthest: Array, face: Array) -> tuple[Array, Array]:
        t = once(distances)(leaf, slot)
        if any_hit:
            return jnp.where(t < farthest, -1, farthest), face
        f = face_of(tree, leaf, slot)
        closer = (t < farthest) | ((t == farthest) & (f < face))
        return jnp.where(closer, t, farthest), jnp.where(closer, f, face)

    return lambda leaf, bits, farthest, face: each(partial(one, leaf), bits, farthest, face)


def _hull(
    tree: Tree, o: Numbers, slopes: Numbers, farthest: Array, places: list[Array], sign: Array
) -> Callable[..., tuple[Array, Array]]:
    """Return the test of eight boxes, given by least and largest x, y, z: where they are entered, and whether met.

    Depths are counted forward, from that of the first origin. slopes: dx, dy and 1 over |dz|.
    """
    alive, u, depth = farthest >= 0, unit_roundoff(farthest), sign * o[2]

    def least_of(*rows: Array) -> Array:
        # All at once: each loop of its own costs compile time
        return smallest(jnp.where(alive[None], jnp.stack(rows), FAR))

    start, latest, end, shortest = least_of(depth, -depth, -depth - farthest / slopes[2], slopes[2])
    root = [floats(part(tree.words, side + (places[2] // 3 & 24), WIDTH)) for side in (0, 24)]
    span = most(least(-end, largest(jnp.where(sign > 0, root[1], -root[0]))) - start, 0)
    first = [v + (start - depth) * slope for v, slope in zip(o, slopes[:2], strict=False)]
    last = [v + span * slope for v, slope in zip(first, slopes[:2], strict=True)]
    both = least_of(*(sign * v for v in (*first, *last) for sign in (1, -1)))
    near, far = both[:4], both[4:]
    margin = tree.pad + 8 * u * (jnp.sum(jnp.abs(both)) + 4 * span)
    alone = jnp.stack([start, -latest - start + margin, shortest, span + margin, margin, sign])
    numbers = near, (far - near) / most(span, TINY), alone
    return _test_of(once(lambda *x: jnp.concatenate(x))(*numbers))


def _test_of(numbers: Array) -> Callable[..., tuple[Array, Array]]:
    """Return the test of `_hull` from its numbers."""

    def test(x0: Array, x1: Array, y0: Array, y1: Array, z0: Array, z1: Array) -> tuple[Array, Array]:
        lines, slopes = numbers[:4], numbers[4:8]
        start, latest, shortest, end, margin, sign = numbers[8:]
        forward = sign > 0
        near, far = jnp.where(forward, z0, -z1) - start, jnp.where(forward, z1, -z0) - start
        enter, leave = most(near - margin, 0), least(far + margin, end)
        hit = enter <= leave
        # Least x, −largest x, least y, −largest y
        for k, side in enumerate((x1, -x0, y1, -y0)):
            hit &= side >= lines[k] - margin + least(enter * slopes[k], leave * slopes[k])
        return most(near - latest, 0) * shortest, hit

    return test
