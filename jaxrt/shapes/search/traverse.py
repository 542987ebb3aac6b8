"""The nearest and any hit of a ray on a mesh, through its tree, and what becomes of the search under vmap.

Of many rays, those that stay together walk in packets (`packet.py`), the others one by one (`walk.py`): all, where the
tree has no packets. Where devices want many lanes, all walk side by side (`lockstep.py`).
"""

from collections.abc import Callable
from functools import cache, partial

import jax
import jax.numpy as jnp
from jax import Array, lax
from jax.custom_batching import custom_vmap

from jaxrt.core.maths import FAR, unit_roundoff
from jaxrt.kernels.bits import each, mask
from jaxrt.kernels.gather import part, put
from jaxrt.kernels.native import kernel, once
from jaxrt.shapes.edges import main_axis
from jaxrt.shapes.search.boxes import Tree
from jaxrt.shapes.search.lockstep import walk_side_by_side
from jaxrt.shapes.search.order import least, most, smallest
from jaxrt.shapes.search.packet import walk_together
from jaxrt.shapes.search.walk import RAY, nonzero, ray_rows, slabs, walk_alone

PACKET = 32  # lanes of a packet
LOCKSTEP = 1024  # more lanes than that walk side by side
SPREAD = 0.5  # slopes of a packet differ by less than that
ACROSS = 10  # on a tree of n leaves, a packet is no wider than this many sides of a leaf, √n of which span the tree
LONELY = 4  # fewer lanes than that are not worth a packet
ALONE = -2  # instead of a face: the ray is still to walk, by itself


def nearest_hit(tree: Tree, origin: Array, direction: Array, farthest: Array) -> tuple[Array, Array]:
    """Return (distance, face) of what one ray hits first, closer than `farthest`; `farthest` and −1 if nothing is."""
    return _batchable(False, kernel())(tree, origin, direction, farthest)


def any_hit(tree: Tree, origin: Array, direction: Array, farthest: Array) -> Array:
    """Return whether one ray hits anything closer than `farthest`."""
    return _batchable(True, kernel())(tree, origin, direction, farthest)[1] >= 0


def _alone(any_hit: bool, tree: Tree, o: Array, d: Array, farthest: Array) -> tuple[Array, Array]:
    """Return (distance, face) of one ray."""
    return walk_alone(any_hit, tree, *once(partial(ray_rows, tree.balls))(o, d), farthest)


def _together(any_hit: bool, tree: Tree, o: Array, d: Array, farthest: Array) -> tuple[Array, Array]:
    """Return (distance, face) of many rays (lanes, 3), packet by packet."""
    lanes = farthest.shape[0]
    size = min(PACKET, lanes)
    filling = -lanes % size
    o, d = (jnp.concatenate([x, jnp.broadcast_to(x[:1], (filling, 3))]).T for x in (o, d))
    reach = jnp.concatenate([farthest, jnp.full(filling, -1, farthest.dtype)])
    reach = once(_reach_of_those_that_may_hit)(tree, o, d, reach)

    def one_packet(k: Array, results: tuple[Array, Array]) -> tuple[Array, Array]:
        rows = [lax.dynamic_slice_in_dim(x, k * size, size, -1) for x in (o, d, reach)]
        nothing = rows[2], jnp.full(size, -1, jnp.int32)
        search = partial(_packet_or_singles if tree.packets else _all_single, any_hit, tree, *rows)
        found = lax.cond(jnp.any(rows[2] > 0), search, lambda: nothing)
        t, face = (lax.dynamic_update_slice(all_, x, (k * size,)) for all_, x in zip(results, found, strict=True))
        return t, face

    nothing = reach, jnp.full(lanes + filling, -1, jnp.int32)
    distance, face = lax.fori_loop(0, (lanes + filling) // size, one_packet, nothing)
    distance, face = distance[:lanes], face[:lanes]
    return jnp.where(face < 0, farthest, distance), face


def _reach_of_those_that_may_hit(tree: Tree, o: Array, d: Array, farthest: Array) -> Array:
    """Return `farthest` of the rays (3, lanes) that meet the box around all, −1 of others and those that go nowhere."""
    inverse = 1 / nonzero(d)
    enter, leave = slabs(*(list(x) for x in (tree.low, tree.high, o, inverse)))
    margin = 1 + 8 * unit_roundoff(d)
    return jnp.where((farthest > 0) & (enter <= least(leave, farthest) * margin), farthest, -1)


def _packet_or_singles(any_hit: bool, tree: Tree, o: Array, d: Array, farthest: Array) -> tuple[Array, Array]:
    """Return (distance, face) of a packet, group by group: the lanes that go along the same axis the same way.

    Each lane keeps its own main axis, so that a ray meets the same face with the same rounding in whatever company.
    """
    axes = main_axis(d)
    forward = jnp.sum(jnp.where(lax.broadcasted_iota(jnp.int32, d.shape, 0) == axes[None], d, 0), 0) > 0
    way = 2 * axes + forward.astype(jnp.int32)

    def group(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        left, distance, face = state
        first = jnp.min(jnp.where(left, way, 6))
        members, axis = left & (way == first), first >> 1
        sign = jnp.where(first & 1 == 1, 1, -1).astype(d.dtype)
        slopes = d / jnp.where(members, jnp.abs(d[axis]), 1)[None]

        def packet() -> tuple[Array, Array]:
            # Lanes that take no part go along the axis: no division by 0
            along = jnp.where(lax.iota(jnp.int32, 3) == axis, sign, 0)
            together = jnp.where(members[None], d, along[:, None])
            found = walk_together(any_hit, tree, o, together, jnp.where(members, farthest, -1), axis, sign, within)
            return jnp.where(members, found[0], distance), jnp.where(members, found[1], face)

        def later() -> tuple[Array, Array]:
            return distance, jnp.where(members, ALONE, face)

        worth = (_spread(slopes, members) < SPREAD) & (jnp.sum(members) > LONELY)
        return left & ~members, *lax.cond(worth, packet, later)

    alive = farthest > 0
    spread, apart = _spread(d, alive), _spread(o, alive)
    widths = least(ACROSS * tree.side, SPREAD), tree.side
    near, within = ((spread < w) & (apart < w * tree.reach) for w in widths)
    start = alive & near, farthest, jnp.where(alive & ~near, jnp.int32(ALONE), -1)
    found = lax.while_loop(lambda state: jnp.any(state[0]), group, start)[1:]
    return lax.cond(jnp.any(found[1] == ALONE), partial(_singles, any_hit, tree, o, d), lambda *found: found, *found)


def _all_single(any_hit: bool, tree: Tree, o: Array, d: Array, farthest: Array) -> tuple[Array, Array]:
    """Return (distance, face) of lanes that walk one by one, those that go anywhere."""
    return _singles(any_hit, tree, o, d, farthest, jnp.where(farthest > 0, jnp.int32(ALONE), -1))


def _singles(any_hit: bool, tree: Tree, o: Array, d: Array, distance: Array, face: Array) -> tuple[Array, Array]:
    """Return (distance, face) after the lanes marked ALONE have walked, one by one."""
    rays, places = (x.ravel() for x in once(partial(ray_rows, tree.balls))(o, d))

    def single(lane: Array, distance: Array, face: Array) -> tuple[Array, Array]:
        row, at = once(lambda a, b, i: (part(a, i * RAY, RAY), part(b, i * 3, 3)))(rays, places, lane)
        t, f = walk_alone(any_hit, tree, row, at, part(distance, lane, 1)[0])
        return put(distance, t[None], lane), put(face, f[None], lane)

    return each(single, mask(face == ALONE), distance, face)


def _spread(v: Array, alive: Array) -> Array:
    """Return the largest difference between the lanes of vectors (3, lanes)."""
    least = smallest(jnp.where(alive[None], jnp.concatenate([v, -v]), FAR))
    x, y, z = -least[:3] - least[3:]
    return most(x, most(y, z))


def _many(any_hit: bool, wide: bool, tree: Tree, o: Array, d: Array, farthest: Array) -> tuple[Array, Array]:
    """Return (distance, face) of many rays. wide: side by side, however many they are."""
    if farthest.shape[0] > LOCKSTEP or wide:
        return walk_side_by_side(any_hit, tree, o, d, farthest)
    return once(partial(_together, any_hit))(tree, o, d, farthest)


@cache
def _batchable(any_hit: bool, native: bool | None) -> Callable[..., tuple[Array, Array]]:
    """Return the search of one ray whose vmap walks many rays, and whose vmap of vmap maps over those.

    native: as `kernel` tells. Each kind of kernel has a search of its own: jax 0.12 keeps what it has traced of a
    function, and would take one kind's for another's.
    """
    wide = native is False

    @custom_vmap
    def one(tree: Tree, o: Array, d: Array, farthest: Array) -> tuple[Array, Array]:
        return _alone(any_hit, tree, o, d, farthest)

    @custom_vmap
    def many(tree: Tree, o: Array, d: Array, farthest: Array) -> tuple[Array, Array]:
        return _many(any_hit, wide, tree, o, d, farthest)

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

    def own(size: int, batched: list, rays: tuple[Array, ...]) -> list[Array]:
        """Return rays of which each of the batch has its own."""
        pairs = zip(rays, batched, strict=True)
        return [x if flag else jnp.broadcast_to(x[None], (size, *x.shape)) for x, flag in pairs]

    @one.def_vmap
    def one_rule(size: int, batched: list, tree: Tree, *rays: Array) -> tuple:
        if any(jax.tree.leaves(batched[0])):
            return mapped(one, size, batched, (tree, *rays))
        return many(tree, *own(size, batched[1:], rays)), (True, True)

    @many.def_vmap
    def many_rule(size: int, batched: list, tree: Tree, *rays: Array) -> tuple:
        if not wide or any(jax.tree.leaves(batched[0])):
            return mapped(many, size, batched, (tree, *rays))
        found = many(tree, *(x.reshape(-1, *x.shape[2:]) for x in own(size, batched[1:], rays)))
        return tuple(x.reshape(size, -1) for x in found), (True, True)

    return one
