"""Walking the tree of a mesh: nearest hit and any hit, for one ray or for a packet of rays that stay together.

Two kernels share one walk. A node's eight boxes are tested at once, either against one ray, or, for a packet, against
the hull of its rays in the frame of its main axis: at depth z the rays are within o + z·[least, largest slope]
(after Reshetov, Soupikov and Hurley, "Multi-level ray tracing algorithm", 2005). A leaf's eight faces are tested at
once against one ray; in a packet, those faces that its hull meets are tested one by one against all lanes at once.

The stack holds one row of eight keys for each level: where the ray enters the child's box, as the bits of a float with
the child's number in the last three. The least key is the next child to visit, so that nothing is ever sorted, and
the stack cannot overflow.

Of equally distant faces the one of the smallest number is hit. A face is found where it is hit inside its own box,
padded: what only the error bound of the edge test calls a hit, beyond the tip of a sliver, is not.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax
from jax.custom_batching import custom_vmap

from jaxrt.maths import FAR, unit_roundoff
from jaxrt.native import once
from jaxrt.shapes.boxes import Tree
from jaxrt.shapes.bvh import WIDTH
from jaxrt.shapes.edges import hit_distance, main_axis, shear

PACKET = 32  # lanes of a packet
LOCKSTEP = 1024  # more lanes than that walk each on its own, all at the same time, as accelerators want it
SPREAD = 0.5  # slopes of a packet differ by less than that
LONELY = 4  # fewer lanes than that are not worth a packet
TINY = 1e-20  # least size of a direction component, for its reciprocal alone


def _slice(flat: Array, start: Array, size: int = WIDTH) -> Array:
    return lax.dynamic_slice(flat, (start,), (size,), allow_negative_indices=False)


def _bits(x: Array) -> Array:
    """Return non-negative floats as integers of the same order; negative floats become negative."""
    return lax.bitcast_convert_type(x, jnp.int32 if x.dtype == jnp.float32 else jnp.int64)


def _least(a: Array, b: Array) -> Array:
    return jnp.where(a < b, a, b)


def _most(a: Array, b: Array | float) -> Array:
    return jnp.where(a > b, a, b)


def _keys(near: Array, hit: Array) -> Array:
    """Return the eight keys of a node's children: by distance, then number; the largest integer where missed."""
    bits = _bits(near)
    number = lax.iota(bits.dtype, WIDTH)
    return jnp.where(hit, (bits & ~7) | number, jnp.iinfo(bits.dtype).max)


NONE = -(2**31)  # no node
ALONE = -2  # instead of a face: the ray is still to walk, by itself


class _Walk(NamedTuple):
    """A walk under way. Lanes: () for one ray, (PACKET,) for a packet."""

    top: Array  # () int32 row of the stack in use, −1 when it is empty
    rows: Array  # (depth·8,) keys
    nodes: Array  # (depth,) int32 node that each row belongs to
    code: Array  # () int32 what to visit now: a node, −1 − a leaf, or NONE
    farthest: Array  # (lanes) distance of the nearest hit so far
    face: Array  # (lanes) int32 face hit, −1 for none


def _walk(tree: Tree, keys_of: Callable, leaf: Callable, farthest: Array) -> tuple[Array, Array]:
    """Return (farthest, face) of the lanes after a walk from the root.

    keys_of(node) gives eight keys; leaf(number, farthest, face) gives the last two anew.
    """
    far = jnp.iinfo(_bits(farthest).dtype).max
    word = _bits(farthest).dtype

    def limit(farthest: Array) -> Array:
        return jnp.max(_bits(farthest)) | 7

    def pick(node: Array, row: Array, most: Array) -> tuple[Array, Array, Array]:
        """Return (child, how many of the row can be met, row without the child)."""
        key = jnp.min(row)
        child = _slice(tree.links, node * WIDTH + (key & 7).astype(jnp.int32), 1)[0]
        return (
            jnp.where(key <= most, child, NONE),
            jnp.sum(row <= most, dtype=jnp.int32),
            jnp.where(row == key, far, row),
        )

    def descend(w: _Walk) -> _Walk:
        row = once(keys_of)(w.code)
        code, count, rest = pick(w.code, row, limit(w.farthest))
        # A row of one child need not be kept
        top = w.top + 1
        rows = lax.dynamic_update_slice(w.rows, rest, (top * WIDTH,), allow_negative_indices=False)
        nodes = lax.dynamic_update_slice(w.nodes, w.code[None], (top,), allow_negative_indices=False)
        return w._replace(top=jnp.where(count > 1, top, w.top), rows=rows, nodes=nodes, code=code)

    def visit(w: _Walk) -> _Walk:
        farthest, face = leaf(-1 - w.code, w.farthest, w.face)
        return w._replace(code=jnp.int32(NONE), farthest=farthest, face=face)

    def pop(w: _Walk) -> _Walk:
        top = jnp.maximum(w.top, 0)
        row = _slice(w.rows, top * WIDTH)
        code, count, rest = pick(_slice(w.nodes, top, 1)[0], row, limit(w.farthest))
        code = jnp.where(w.top >= 0, code, NONE)
        rows = lax.dynamic_update_slice(w.rows, rest, (top * WIDTH,), allow_negative_indices=False)
        return w._replace(top=jnp.where(count > 1, w.top, w.top - 1), rows=rows, code=code)

    def step(w: _Walk) -> _Walk:
        w = lax.while_loop(lambda w: w.code >= 0, descend, w)
        w = lax.while_loop(lambda w: (w.code < 0) & (w.code != NONE), visit, w)
        return pop(w)

    def going(w: _Walk) -> Array:
        return ((w.top >= 0) | (w.code != NONE)) & (limit(w.farthest) >= 0)

    start = _Walk(
        top=jnp.int32(-1),
        rows=jnp.full(tree.depth * WIDTH, far, word),
        nodes=jnp.zeros(tree.depth, jnp.int32),
        code=jnp.int32(0),
        farthest=farthest,
        face=jnp.full(farthest.shape, -1, jnp.int32),
    )
    end = lax.while_loop(going, step, start)
    return end.farthest, end.face


def _single(any_hit: bool, tree: Tree, origin: Array, direction: Array, farthest: Array) -> tuple[Array, Array]:
    """Return (distance, face) of one ray."""
    u = unit_roundoff(origin)
    safe = jnp.where(jnp.abs(direction) < TINY, jnp.where(direction < 0, -TINY, TINY), direction)
    places = (main_axis(direction) + jnp.asarray([1, 2, 0], jnp.int32)) % 3
    o, d = origin[places], direction[places]
    # In two arrays: each array that a loop reads costs it a store per turn
    ray = once(lambda *x: jnp.concatenate(x))(origin, 1 / safe, o, d[:2] / d[2], 1 / d[2:])
    turn = once(lambda *x: jnp.concatenate(x))(jnp.where(direction < 0, 24, 0), places * 24)
    corners_at, faces_at = tree.nodes * 48, tree.nodes * WIDTH

    def keys_of(node: Array) -> Array:
        at = node * 48
        near = [(_slice(tree.numbers, at + 8 * k + turn[k]) - ray[k]) * ray[3 + k] for k in range(3)]
        far = [(_slice(tree.numbers, at + 24 + 8 * k - turn[k]) - ray[k]) * ray[3 + k] for k in range(3)]
        enter = _most(_most(near[0], near[1]), _most(near[2], 0))
        leave = _least(_least(far[0], far[1]), far[2]) * (1 + 8 * u)
        return _keys(enter, enter <= leave)

    def distances(number: Array) -> Array:
        at = corners_at + number * 72
        corner = [[_slice(tree.numbers, at + turn[3 + k] + 8 * c) - ray[6 + k] for k in range(3)] for c in range(3)]
        return hit_distance([shear(x, y, z, ray[9], ray[10], ray[11]) for x, y, z in corner])

    def leaf(number: Array, farthest: Array, face: Array) -> tuple[Array, Array]:
        t = once(distances)(number)
        nearest = jnp.min(_bits(t))
        faces = _slice(tree.links, faces_at + number * WIDTH)
        first = jnp.min(jnp.where(_bits(t) == nearest, faces, jnp.iinfo(jnp.int32).max))
        distance = lax.bitcast_convert_type(nearest, t.dtype)
        closer = (distance < farthest) | ((distance == farthest) & (first < face))
        hit_at = jnp.full_like(distance, -1) if any_hit else distance
        return jnp.where(closer, hit_at, farthest), jnp.where(closer, first, face)

    return _walk(tree, keys_of, leaf, farthest)


def _packet(any_hit: bool, tree: Tree, o: Array, d: Array, farthest: Array, axis: Array) -> tuple[Array, Array]:
    """Return (distance, face) of the lanes of a packet; o, d: (3, lanes). Lanes with farthest < 0 are dead."""
    corners_at, faces_at = tree.nodes * 48, tree.nodes * WIDTH
    u = unit_roundoff(o)
    kx, ky, kz = (jnp.where(k > 2, k - 3, k) for k in (axis + 1, axis + 2, axis))
    (ox, oy, oz), (dx, dy, dz) = ([v[k] for k in (kx, ky, kz)] for v in (o, d))
    alive = farthest >= 0
    sign = jnp.where(jnp.sum(jnp.where(alive, dz, 0)) < 0, -1, 1).astype(o.dtype)
    sx, sy, sz = dx / dz, dy / dz, 1 / dz

    def ends(v: Array) -> tuple[Array, Array]:
        return jnp.min(jnp.where(alive, v, FAR)), jnp.max(jnp.where(alive, v, -FAR))

    (x_low, x_high), (y_low, y_high), (z_low, z_high) = (ends(v) for v in (ox, oy, oz))
    (a_low, a_high), (b_low, b_high) = (ends(sign * v) for v in (sx, sy))
    a_low, b_low = (v - 8 * u * jnp.abs(v) for v in (a_low, b_low))
    a_high, b_high = (v + 8 * u * jnp.abs(v) for v in (a_high, b_high))
    shortest = ends(sign * sz)[0]
    x_low, y_low, z_low = (v - tree.pad for v in (x_low, y_low, z_low))
    x_high, y_high, z_high = (v + tree.pad for v in (x_high, y_high, z_high))
    forward = sign > 0

    def hull(x0: Array, x1: Array, y0: Array, y1: Array, z0: Array, z1: Array) -> Array:
        enter = _most(jnp.where(forward, z0 - z_high, z_low - z1), 0)
        leave = jnp.where(forward, z1 - z_low, z_high - z0)
        hit = (
            (leave >= 0)
            & (x1 - x_low >= _least(enter * a_low, leave * a_low))
            & (x0 - x_high <= _most(enter * a_high, leave * a_high))
            & (y1 - y_low >= _least(enter * b_low, leave * b_low))
            & (y0 - y_high <= _most(enter * b_high, leave * b_high))
        )
        return _keys(enter * shortest, hit)

    def keys_of(node: Array) -> Array:
        sides = [_slice(tree.numbers, node * 48 + side + 8 * k) for k in (kx, ky, kz) for side in (0, 24)]
        return hull(*sides)

    def corner_rows(number: Array) -> list[list[Array]]:
        return [
            [_slice(tree.numbers, corners_at + number * 72 + 24 * k + 8 * c) for c in range(3)] for k in (kx, ky, kz)
        ]

    def met(number: Array) -> Array:
        sides = []
        for a, b, c in corner_rows(number):
            sides += [_least(_least(a, b), c), _most(_most(a, b), c)]
        keys = hull(*sides)
        ok = (keys <= jnp.iinfo(keys.dtype).max - 1) & (_slice(tree.links, faces_at + number * WIDTH) >= 0)
        return jnp.sum(jnp.where(ok, 1 << lax.iota(jnp.int32, WIDTH), 0))

    def distances(number: Array, slot: Array) -> Array:
        at = corners_at + number * 72 + slot
        corner = [[_slice(tree.numbers, at + 24 * k + 8 * c, 1) for k in (kx, ky, kz)] for c in range(3)]
        return hit_distance([shear(x - ox, y - oy, z - oz, sx, sy, sz) for x, y, z in corner])

    def leaf(number: Array, farthest: Array, face: Array) -> tuple[Array, Array]:
        def one(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
            mask, farthest, face = state
            slot = 31 - lax.clz(mask & -mask)
            t = once(distances)(number, slot)
            f = _slice(tree.links, faces_at + number * WIDTH + slot, 1)[0]
            closer = (t < farthest) | ((t == farthest) & (f < face))
            return mask & (mask - 1), jnp.where(closer, -1 if any_hit else t, farthest), jnp.where(closer, f, face)

        _, farthest, face = lax.while_loop(lambda s: s[0] != 0, one, (once(met)(number), farthest, face))
        return farthest, face

    return _walk(tree, keys_of, leaf, farthest)


def nearest_hit(tree: Tree, origin: Array, direction: Array, farthest: Array) -> tuple[Array, Array]:
    """Return (distance, face) of what one ray hits first, closer than `farthest`; `farthest` and −1 if nothing is."""
    return _nearest(tree, origin, direction, farthest)


def any_hit(tree: Tree, origin: Array, direction: Array, farthest: Array) -> Array:
    """Return whether one ray hits anything closer than `farthest`."""
    return _any(tree, origin, direction, farthest)[1] >= 0


def _together(any_hit: bool, tree: Tree, o: Array, d: Array, farthest: Array) -> tuple[Array, Array]:
    """Return (distance, face) of many rays (lanes, 3), packet by packet."""
    lanes = farthest.shape[0]
    size = min(PACKET, lanes)
    filling = -lanes % size
    o, d = (jnp.concatenate([x, jnp.broadcast_to(x[:1], (filling, 3))]).T for x in (o, d))
    farthest = jnp.concatenate([farthest, jnp.full(filling, -1, farthest.dtype)])
    # A ray that goes nowhere costs nothing
    farthest = jnp.where(farthest > 0, farthest, -1)

    def one_packet(k: Array, results: tuple[Array, Array]) -> tuple[Array, Array]:
        rows = [lax.dynamic_slice_in_dim(x, k * size, size, -1) for x in (o, d, farthest)]
        found = _packet_or_singles(any_hit, tree, *rows)
        t, face = (lax.dynamic_update_slice(all_, x, (k * size,)) for all_, x in zip(results, found, strict=True))
        return t, face

    nothing = farthest, jnp.full(lanes + filling, -1, jnp.int32)
    distance, face = lax.fori_loop(0, (lanes + filling) // size, one_packet, nothing)
    return distance[:lanes], face[:lanes]


def _packet_or_singles(any_hit: bool, tree: Tree, o: Array, d: Array, farthest: Array) -> tuple[Array, Array]:
    """Return (distance, face) of a packet, group by group: the lanes that go along the same axis the same way.

    Each lane keeps its own main axis, so that a ray meets the same face with the same rounding in whatever company.
    """
    axes = main_axis(d)
    forward = jnp.sum(jnp.where(lax.broadcasted_iota(jnp.int32, d.shape, 0) == axes[None], d, 0), 0) > 0
    way = 2 * axes + forward.astype(jnp.int32)

    def group(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        left, distance, face = state
        members = left & (way == jnp.min(jnp.where(left, way, 6)))
        axis = jnp.min(jnp.where(members, axes, 3))
        mean = jnp.sum(jnp.where(members[None], d, 0), 1)
        slopes = d / jnp.where(members, jnp.abs(d[axis]), 1)[None]
        tight = _spread(slopes, members) < SPREAD

        def packet() -> tuple[Array, Array]:
            # Lanes that take no part go the way of the others: no division by 0
            reach = jnp.where(members, farthest, -1)
            found = _packet(any_hit, tree, o, jnp.where(members[None], d, mean[:, None]), reach, axis)
            return jnp.where(members, found[0], distance), jnp.where(members, found[1], face)

        def later() -> tuple[Array, Array]:
            return distance, jnp.where(members, ALONE, face)

        return left & ~members, *lax.cond(tight & (jnp.sum(members) > LONELY), packet, later)

    def single(i: Array, found: tuple[Array, Array]) -> tuple[Array, Array]:
        distance, face = found
        mine = face[i] == ALONE
        t, f = _single(any_hit, tree, o[:, i], d[:, i], jnp.where(mine, farthest[i], -1))
        t, f = jnp.where(mine, t, distance[i]), jnp.where(mine, f, face[i])
        return lax.dynamic_update_slice(distance, t[None], (i,)), lax.dynamic_update_slice(face, f[None], (i,))

    alive = farthest > 0
    near = (_spread(d, alive) < SPREAD) & (_spread(o, alive) < SPREAD * tree.reach)
    start = alive & near, farthest, jnp.where(alive & ~near, ALONE, -1)
    found = lax.while_loop(lambda state: jnp.any(state[0]), group, start)[1:]
    return lax.fori_loop(0, jnp.where(jnp.any(found[1] == ALONE), farthest.shape[0], 0), single, found)


def _spread(v: Array, alive: Array) -> Array:
    """Return the largest difference between the lanes of vectors (3, lanes)."""
    low, high = jnp.where(alive[None], v, FAR), jnp.where(alive[None], v, -FAR)
    return jnp.max(jnp.max(high, 1) - jnp.min(low, 1))


def _many(any_hit: bool, tree: Tree, o: Array, d: Array, farthest: Array) -> tuple[Array, Array]:
    """Return (distance, face) of many rays."""
    if farthest.shape[0] > LOCKSTEP:
        return jax.vmap(partial(_single, any_hit, tree))(o, d, farthest)
    return once(partial(_together, any_hit))(tree, o, d, farthest)


def _batchable(any_hit: bool) -> Callable[..., tuple[Array, Array]]:
    """Return the search of one ray whose vmap walks many rays, and whose vmap of vmap maps over those."""

    @custom_vmap
    def one(tree: Tree, o: Array, d: Array, farthest: Array) -> tuple[Array, Array]:
        return _single(any_hit, tree, o, d, farthest)

    @custom_vmap
    def many(tree: Tree, o: Array, d: Array, farthest: Array) -> tuple[Array, Array]:
        return _many(any_hit, tree, o, d, farthest)

    def mapped(f: Callable[..., tuple[Array, Array]], size: int, batched: list, operands: tuple) -> tuple:
        """Return f of each of the batch, one after another."""
        leaves, tree = jax.tree.flatten(operands)
        flags = jax.tree.leaves(batched)

        def row(i: Array) -> tuple[Array, Array]:
            picked = [
                lax.dynamic_index_in_dim(x, i, keepdims=False) if flag else x
                for x, flag in zip(leaves, flags, strict=True)
            ]
            return f(*jax.tree.unflatten(tree, picked))

        return lax.map(row, jnp.arange(size, dtype=jnp.int32)), (True, True)

    @one.def_vmap
    def one_rule(size: int, batched: list, tree: Tree, *rays: Array) -> tuple:
        if any(jax.tree.leaves(batched[0])):
            return mapped(one, size, batched, (tree, *rays))
        rays = tuple(
            x if flag else jnp.broadcast_to(x[None], (size, *x.shape))
            for x, flag in zip(rays, batched[1:], strict=True)
        )
        return many(tree, *rays), (True, True)

    @many.def_vmap
    def many_rule(size: int, batched: list, *operands: Array) -> tuple:
        return mapped(many, size, batched, operands)

    return one


_nearest, _any = _batchable(False), _batchable(True)
