"""The paths of a packet's pixels, sample after sample: where some have ended, others begin.

In the open most paths end early, here and there among the lanes of a packet, and a packet costs the same for few as for
all. So the paths under way stand in one row, closed up when some end, of which the rear has as many as the packet has
lanes: these go on by one event, or new ones do while there are fewer (path regeneration and stream compaction: Novák,
Havran & Dachsbacher 2010, van Antwerpen 2011). A path's light does not depend on its place in the row, and sums of
light are exact, so that they do not depend on which path ends first. For native kernels without derivative backwards,
which would have to know how many turns there are.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxrt.core.maths import Parts, add_exactly
from jaxrt.core.pytree import pytree
from jaxrt.kernels.bits import WORD, each, masks
from jaxrt.kernels.native import once
from jaxrt.transport.film import Plan, Run, camera_ray, is_native, numbers_of, pixel_of
from jaxrt.transport.path import Tables, Walk, event, may_look, walk_along


@pytree
class Paths:
    """Paths, or one."""

    walk: Walk
    place: Array  # (3,) int32: lane of its pixel, number of its sample, and of its next event


@pytree
class State:
    """What has become of a packet's samples."""

    paths: Paths  # (2 · lanes, …): the row, then anything
    count: Array  # () int32, of the row
    sample: Array  # () int32, that begins next
    drawn: Parts  # (lanes, 3) each: the sum of the paths that have ended


def regenerates(plan: Plan, tables: Tables) -> bool:
    """Return whether paths give way to others: in native kernels, where some may end before their last event."""
    shapes = tables.geometry.spheres, tables.geometry.triangles
    return is_native(plan) and plan.max_depth > 1 and not (plan.outputs or plan.unroll) and shapes != (None, None)


def draw_paths(plan: Plan, tables: Tables, run: Run, packet: Array) -> Parts:
    """Return the sum of the samples of `run` of the packet's pixels, (lanes, 3) each."""
    lanes, tables = plan.lanes, replace(tables, sparse=True)
    index = jnp.arange(lanes, dtype=jnp.int32)

    def begin(state: State, _: Array) -> Paths:
        def one(lane: Array) -> Paths:
            x, y = pixel_of(plan, tables, run, packet, lane)
            ray = camera_ray(plan, tables, numbers_of(plan, tables, run, state.sample, x, y), x, y)
            return Paths(walk_along(tables, ray, True), jnp.stack([lane, state.sample, jnp.ones_like(lane)]))

        return jax.vmap(one)(index)

    def cut(state: State, first: Array) -> Paths:
        return jax.tree.map(lambda x: _rows(x, first, lanes), state.paths)

    def go_on(path: Paths) -> Paths:
        lane, sample, k = path.place
        numbers = numbers_of(plan, tables, run, sample, *pixel_of(plan, tables, run, packet, lane))
        walk = event(tables, path.walk, numbers(k), False, k <= plan.max_depth)
        assert walk.alive is not None
        alive = walk.alive & ((k < plan.max_depth) | may_look(tables, walk))
        return Paths(replace(walk, alive=alive), jnp.stack([lane, sample, k + 1]))

    def turn(state: State) -> State:
        fresh = (state.count < lanes) & (state.sample < run.end)
        first = jnp.where(fresh, state.count, jnp.maximum(state.count - lanes, 0))
        there = index < jnp.where(fresh, lanes, state.count)
        paths = lax.cond(fresh, begin, once(cut), state, first)
        paths = jax.vmap(go_on)(replace(paths, walk=replace(paths.walk, alive=paths.walk.alive & there)))
        row = jax.tree.map(partial(_put, first), state.paths, paths)
        count, sample = jnp.where(fresh, first + lanes, state.count), state.sample + fresh
        ended = masks((there & ~paths.walk.alive)[::-1])
        drawn = _drawn(state.drawn, paths, ended)
        return State(*_closed_up(row, count, first + lanes - 1, ended), sample, drawn)

    shapes = jax.eval_shape(begin, State(None, None, run.first, None), run.first)
    row = jax.tree.map(lambda x: jnp.zeros((2 * lanes, *x.shape[1:]), x.dtype), shapes)
    nothing = jnp.zeros((lanes, 3), tables.dtype)
    start = State(row, jnp.int32(0), run.first, (nothing, nothing, nothing))
    return lax.while_loop(lambda state: (state.count > 0) | (state.sample < run.end), turn, start).drawn


def _drawn(drawn: Parts, paths: Paths, ended: Array) -> Parts:
    """Return the sum with the light of the paths that have `ended`, told from the last on."""
    last = paths.place.shape[0] - 1

    def total(drawn: Parts, lane: Array, i: Array) -> Parts:
        return add_exactly(jax.tree.map(lambda x: _rows(x, lane), drawn), _rows(paths.walk.radiance, i))

    def draw(back: Array, drawn: Parts) -> tuple[Parts]:
        lane = paths.place[last - back, 0]
        return (jax.tree.map(partial(_put, lane), drawn, once(total)(drawn, lane, last - back)),)

    return _each(draw, ended, drawn)[0]


def _closed_up(row: Paths, count: Array, last: Array, ended: Array) -> tuple[Paths, Array]:
    """Return the row, and how many it counts, after those have left it that have `ended`, told from its `last` on."""

    def fill(back: Array, row: Paths, count: Array) -> tuple[Paths, Array]:
        return jax.tree.map(lambda x: _put(last - back, x, _rows(x, count - 1)), row), count - 1

    return _each(fill, ended, row, count)


def _each(one: Callable[..., tuple[Any, ...]], words: Array, *found: Any) -> tuple[Any, ...]:
    """Return what is found after one(number, *found) for each bit of the words, in order."""

    def of_word(w: Array, found: tuple[Any, ...]) -> tuple[Any, ...]:
        return each(lambda bit, *found: one(WORD * w + bit, *found), words[w], *found)

    return lax.fori_loop(0, words.size, of_word, found)


def _rows(x: Array, i: Array, n: int = 1) -> Array:
    return lax.dynamic_slice_in_dim(x, i, n, allow_negative_indices=False)


def _put(i: Array, rows: Array, some: Array) -> Array:
    return lax.dynamic_update_slice_in_dim(rows, some, i, 0, allow_negative_indices=False)
