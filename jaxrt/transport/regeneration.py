"""The paths of a packet's pixels, sample after sample: where some have ended, others begin.

In the open most paths end early, here and there among the lanes of a packet, and a packet costs the same for few as for
all. So the paths under way stand in one row, closed up when some end, of which the rear has as many as the packet has
lanes: these go on by one event, or new ones do while there are fewer (path regeneration and stream compaction: Novák,
Havran & Dachsbacher 2010, van Antwerpen 2011). What a path brings does not depend on its place in the row. For native
kernels without derivative backwards, which would have to know how many turns there are.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxrt.core.pytree import pytree
from jaxrt.kernels.bits import WORD, each, masks
from jaxrt.kernels.native import once
from jaxrt.transport.film import Plan, Run, camera_ray, is_native, numbers_of, pixel_of
from jaxrt.transport.path import Tables, Walk, event, may_look, walk_along

MOST = 32  # samples whose light is kept before it is summed; the fewer, the more often a row runs out


@pytree
class Paths:
    """Paths, or one."""

    walk: Walk  # in the row without `alive`, for all of it are
    lane: Array  # () int32 of its pixel in the packet
    sample: Array  # () int32
    event: Array  # () int32 number of its next event


@pytree
class State:
    """What has become of a packet's samples."""

    row: Paths  # (2 · lanes, …), of which the first are under way
    count: Array  # () int32, of these
    sample: Array  # () int32, that begins next
    drawn: Array  # (MOST · lanes, 3) what those that have ended have brought, by sample and lane


def regenerates(plan: Plan, tables: Tables) -> bool:
    """Return whether paths give way to others: in native kernels, where some may end before their last event."""
    shapes = tables.geometry.spheres, tables.geometry.triangles
    return is_native(plan) and plan.max_depth > 1 and not (plan.outputs or plan.unroll) and shapes != (None, None)


def draw_paths(plan: Plan, tables: Tables, run: Run, first: Array, end: Array, packet: Array) -> Array:
    """Return the radiance (MOST, lanes, 3) of samples `first` to `end` − 1, at most MOST, of the packet's pixels.

    What follows them is anything.
    """
    lanes, tables = plan.lanes, replace(tables, sparse=True)
    index = jnp.arange(lanes, dtype=jnp.int32)

    def begin(sample: Array) -> Paths:
        def one(lane: Array) -> Paths:
            x, y = pixel_of(plan, tables, run, packet, lane)
            ray = camera_ray(plan, tables, numbers_of(plan, tables, run, sample, x, y), x, y)
            return Paths(replace(walk_along(tables, ray, True), alive=None), lane, sample, jnp.ones_like(lane))

        return jax.vmap(one)(index)

    def rear(row: Paths, start: Array) -> Paths:
        return jax.tree.map(lambda x: _some(x, start, lanes), row)

    def go_on(path: Paths, alive: Array) -> tuple[Paths, Array]:
        k = path.event
        numbers = numbers_of(plan, tables, run, path.sample, *pixel_of(plan, tables, run, packet, path.lane))
        walk = event(tables, replace(path.walk, alive=alive), numbers(k), False, k <= plan.max_depth)
        assert walk.alive is not None
        goes_on = walk.alive & ((k < plan.max_depth) | may_look(tables, walk))
        return replace(path, walk=replace(walk, alive=None), event=k + 1), goes_on

    def turn(state: State) -> State:
        fresh = (state.count < lanes) & (state.sample < end)
        start = jnp.where(fresh, state.count, jnp.maximum(state.count - lanes, 0))
        there = index < jnp.where(fresh, lanes, state.count)
        paths = lax.cond(fresh, lambda: begin(state.sample), lambda: once(rear)(state.row, start))
        paths, goes_on = jax.vmap(go_on)(paths, there)
        drawn = _drawn(state.drawn, paths, first, there & ~goes_on)
        paths, count = _closed_up(paths, there & goes_on)
        row = jax.tree.map(partial(_put, start), state.row, paths)
        return State(row, start + count, state.sample + fresh.astype(jnp.int32), drawn)

    row = jax.tree.map(lambda x: jnp.zeros((2 * lanes, *x.shape[1:]), x.dtype), jax.eval_shape(begin, first))
    state = State(row, jnp.int32(0), first, jnp.zeros((MOST * lanes, 3), tables.dtype))
    state = lax.while_loop(lambda state: (state.count > 0) | (state.sample < end), turn, state)
    return state.drawn.reshape(MOST, lanes, 3)


def _drawn(drawn: Array, paths: Paths, first: Array, ended: Array) -> Array:
    """Return what is drawn with what the paths have brought that have `ended`."""
    lanes = ended.size

    def draw(i: Array, drawn: Array) -> tuple[Array]:
        place = (paths.sample[i] - first) * lanes + paths.lane[i]
        return (_put(place, drawn, _some(paths.walk.radiance, i)),)

    return _each(draw, ended, drawn)[0]


def _closed_up(paths: Paths, alive: Array) -> tuple[Paths, Array]:
    """Return the paths with those in front that are alive, and how many these are."""
    count, index = jnp.sum(alive, dtype=jnp.int32), jnp.arange(alive.size, dtype=jnp.int32)

    def tell(i: Array, gaps: Array, n: Array) -> tuple[Array, Array]:
        return _put(n, gaps, i[None]), n + 1

    def fill(i: Array, paths: Paths, n: Array) -> tuple[Paths, Array]:
        return jax.tree.map(lambda x: _put(gaps[n], x, _some(x, i)), paths), n + 1

    gaps = _each(tell, ~alive & (index < count), index, jnp.int32(0))[0]
    return _each(fill, alive & (index >= count), paths, jnp.int32(0))[0], count


def _each(one: Callable[..., tuple[Any, ...]], chosen: Array, *found: Any) -> tuple[Any, ...]:
    """Return what is found after one(number, *found) for each that is chosen, in order."""
    words = masks(chosen)

    def of_word(w: Array, found: tuple[Any, ...]) -> tuple[Any, ...]:
        return each(lambda bit, *found: one(WORD * w + bit, *found), words[w], *found)

    return lax.fori_loop(0, words.size, of_word, found)


def _some(x: Array, i: Array, n: int = 1) -> Array:
    return lax.dynamic_slice_in_dim(x, i, n, allow_negative_indices=False)


def _put(i: Array, rows: Array, some: Array) -> Array:
    return lax.dynamic_update_slice_in_dim(rows, some, i, 0, allow_negative_indices=False)
