"""A packet's samples side by side, event by event: paths that have ended make room for those that go on.

In the open most paths end early, here and there among the lanes of a packet, and a packet costs the same for few as for
all. So the paths of several samples stand in one row, in which those that go on move up (stream compaction: van
Antwerpen 2011, "Improving SIMD efficiency for parallel Monte Carlo light transport on the GPU"). For native kernels
without derivative backwards, which would have to know how many paths go on.
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
from jaxrt.transport.film import BLOCK, Plan, Run, camera_ray, is_native, numbers_of, pixel_of
from jaxrt.transport.path import Tables, Walk, event, last_look, looks_at_last, walk_along


@pytree
class Paths:
    """Paths in a row."""

    walk: Walk
    number: Array  # (n,) int32, of the path among those of its block: lanes · sample + lane


@pytree
class Row:
    """The paths of a block of samples: in front those under way, and what those that have ended have brought."""

    paths: Paths
    count: Array  # () int32 under way
    drawn: Array  # (n, 3) radiance by the path's number


def compacts(plan: Plan, tables: Tables) -> bool:
    """Return whether paths make room: in a native kernel, where they may end before the last event."""
    shapes = tables.geometry.spheres, tables.geometry.triangles
    return is_native(plan) and plan.max_depth > 1 and not (plan.outputs or plan.unroll) and shapes != (None, None)


def draw_block(plan: Plan, tables: Tables, run: Run, first: Array, end: Array, packet: Array) -> Array:
    """Return the radiance (BLOCK, lanes, 3) of samples `first` to `end` − 1 of a packet's pixels, then anything."""
    lanes, tables = plan.lanes, replace(tables, sparse=True)

    def begin(number: Array) -> Paths:
        sample, x, y = _place(plan, tables, run, first, packet, number)
        ray = camera_ray(plan, tables, numbers_of(plan, tables, run, sample, x, y), x, y)
        return Paths(walk_along(tables, ray, True), number)

    def go_on(k: Array, path: Paths) -> Paths:
        numbers = numbers_of(plan, tables, run, *_place(plan, tables, run, first, packet, path.number))
        return replace(path, walk=event(tables, path.walk, numbers(k), False))

    def look(path: Paths) -> Paths:
        return replace(path, walk=replace(path.walk, radiance=last_look(tables, path.walk)))

    n = BLOCK * lanes
    begun = lax.map(jax.vmap(begin), jnp.arange(n, dtype=jnp.int32).reshape(BLOCK, lanes))
    paths = jax.tree.map(lambda x: x.reshape(n, *x.shape[2:]), begun)
    row = Row(paths, lanes * (end - first), jnp.zeros((n, 3), tables.dtype))
    row = lax.fori_loop(
        1, plan.max_depth + 1, lambda k, row: _compacted(_all(partial(go_on, k), row, lanes), lanes), row
    )
    if looks_at_last(tables):
        row = _all(look, row, lanes)
    return _packed(row, jnp.zeros(n, bool)).drawn.reshape(BLOCK, lanes, 3)


def _place(plan: Plan, tables: Tables, run: Run, first: Array, packet: Array, number: Array) -> tuple[Array, ...]:
    """Return sample, column and row of a path."""
    return first + number // plan.lanes, *pixel_of(plan, tables, run, packet, number % plan.lanes)


def _all(one: Callable[[Paths], Paths], row: Row, lanes: int) -> Row:
    """Return the row with one(path) for each path under way, `lanes` at once."""

    def cut(j: Array, paths: Paths) -> Paths:
        return jax.tree.map(lambda x: lax.dynamic_slice_in_dim(x, lanes * j, lanes), paths)

    def part(j: Array, paths: Paths) -> Paths:
        some = once(cut)(j, paths)
        alive = some.walk.alive & (lanes * j + jnp.arange(lanes) < row.count)
        some = jax.vmap(one)(replace(some, walk=replace(some.walk, alive=alive)))
        return jax.tree.map(lambda x, y: lax.dynamic_update_slice_in_dim(x, y, lanes * j, 0), paths, some)

    return replace(row, paths=lax.fori_loop(0, _parts(row.count, lanes), part, row.paths))


def _compacted(row: Row, lanes: int) -> Row:
    """Return the row without the paths that have ended, if that makes a part fewer to go through."""
    goes_on = row.paths.walk.alive & (jnp.arange(row.drawn.shape[0]) < row.count)
    fewer = _parts(jnp.sum(goes_on, dtype=jnp.int32), lanes) < _parts(row.count, lanes)
    return lax.cond(fewer, _packed, lambda row, _: row, row, goes_on)


def _packed(row: Row, goes_on: Array) -> Row:
    """Return the row with the paths in front that go on; what the others have brought is drawn."""
    ended = ~goes_on & (jnp.arange(goes_on.size) < row.count)

    def draw(i: Array, drawn: Array) -> tuple[Array]:
        return (_put(drawn, row.paths.number[i], _row(row.paths.walk.radiance, i)),)

    def move(i: Array, paths: Paths, count: Array) -> tuple[Paths, Array]:
        return jax.tree.map(lambda x: _put(x, count, _row(x, i)), paths), count + 1

    drawn = _each(draw, ended, row.drawn)[0]
    return Row(*_each(move, goes_on, row.paths, jnp.int32(0)), drawn)


def _each(one: Callable[..., tuple[Any, ...]], chosen: Array, *found: Any) -> tuple[Any, ...]:
    """Return what is found after one(number, *found) for each of the chosen, in order."""
    words = masks(chosen)

    def of_word(w: Array, found: tuple[Any, ...]) -> tuple[Any, ...]:
        return each(lambda bit, *found: one(WORD * w + bit, *found), words[w], *found)

    return lax.fori_loop(0, words.size, of_word, found)


def _parts(count: Array, lanes: int) -> Array:
    return (count + lanes - 1) // lanes


def _row(x: Array, i: Array) -> Array:
    return lax.dynamic_slice_in_dim(x, i, 1)


def _put(rows: Array, i: Array, row: Array) -> Array:
    return lax.dynamic_update_slice_in_dim(rows, row, i, 0)
