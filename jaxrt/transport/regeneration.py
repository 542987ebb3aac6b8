"""The paths of a packet's pixels, sample after sample: where some have ended, others begin.

In the open most paths end early, here and there among the lanes of a packet, and a packet costs the same for few as for
all. So the paths under way stand in one row, closed up when some end, of which the rear has as many as the packet has
lanes: these go on by one event, or new ones do while there are fewer (path regeneration and stream compaction: Novák,
Havran & Dachsbacher 2010, van Antwerpen 2011). What a path brings does not depend on its place in the row. For native
kernels without derivative backwards, which would have to know how many turns there are.
"""

from dataclasses import replace

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxrt.core.pytree import pytree
from jaxrt.core.records import Hit
from jaxrt.kernels.bits import each_of, leading, masks
from jaxrt.kernels.gather import part, put
from jaxrt.kernels.native import once
from jaxrt.shapes import find, surface_point
from jaxrt.transport.film import Plan, Run, camera_ray, is_native, numbers_of, pixel_of
from jaxrt.transport.path import Tables, Walk, arrive, depart, may_look, meets_light, walk_along

MOST = 32  # samples whose light is kept before it is summed; the fewer, the more often a row runs out


@pytree
class Paths:
    """Paths, or one."""

    walk: Walk  # in the row without `alive`, for all of it are
    hit: Array  # () int32 primitive that its ray hits
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

    def begin(sample: Array) -> tuple[Paths, Array]:
        def one(lane: Array) -> Paths:
            x, y = pixel_of(plan, tables, run, packet, lane)
            walk = walk_along(tables, camera_ray(plan, tables, numbers_of(plan, tables, run, sample, x, y), x, y), True)
            return Paths(replace(walk, alive=None), jnp.zeros_like(lane), lane, sample, jnp.ones_like(lane))

        return jax.vmap(one)(index), jnp.ones(lanes, bool)

    def go_on(row: Paths, start: Array, there: Array) -> tuple[Paths, Array]:
        def one(path: Paths, there: Array) -> tuple[Paths, Array]:
            k, walk, hit = path.event, replace(path.walk, alive=there), Hit(path.hit, there)
            numbers = numbers_of(plan, tables, run, path.sample, *pixel_of(plan, tables, run, packet, path.lane))
            point = once(surface_point)(tables.geometry, walk.ray, hit)
            walk = depart(tables, walk, hit, point, numbers(k))
            assert walk.alive is not None
            looks = walk.alive & ((k < plan.max_depth) | may_look(tables, walk))
            return replace(path, walk=replace(walk, alive=None), event=k + 1), looks

        return jax.vmap(one)(once(rear)(row, start), there)

    def rear(row: Paths, start: Array) -> Paths:
        return jax.tree.map(lambda x: part(x, start, lanes), row)

    def look(path: Paths, looks: Array) -> tuple[Paths, Array]:
        hit = once(find)(tables.geometry, path.walk.ray, looks)
        goes_on = hit.valid & (path.event <= plan.max_depth) & ~meets_light(tables, hit)
        return replace(path, walk=arrive(tables, path.walk, hit), hit=hit.index), goes_on

    def turn(state: State) -> State:
        fresh = (state.count < lanes) & (state.sample < end)
        start = jnp.where(fresh, state.count, jnp.maximum(state.count - lanes, 0))
        size = jnp.where(fresh, lanes, state.count - start)
        paths, looks = lax.cond(fresh, lambda: begin(state.sample), lambda: go_on(state.row, start, index < size))
        paths, goes_on = jax.vmap(look)(paths, looks)
        alive = masks(goes_on)
        drawn = _drawn(state.drawn, paths, first, leading(size, alive.size) & ~alive)
        paths, count = _closed_up(paths, alive)
        row = jax.tree.map(lambda x, new: put(x, new, start), state.row, paths)
        return State(row, start + count, state.sample + fresh.astype(jnp.int32), drawn)

    row = jax.tree.map(lambda x: jnp.zeros((2 * lanes, *x.shape[1:]), x.dtype), jax.eval_shape(begin, first)[0])
    state = State(row, jnp.int32(0), first, jnp.zeros((MOST * lanes, 3), tables.dtype))
    state = lax.while_loop(lambda state: (state.count > 0) | (state.sample < end), turn, state)
    return state.drawn.reshape(MOST, lanes, 3)


def _drawn(drawn: Array, paths: Paths, first: Array, ended: Array) -> Array:
    """Return what is drawn with what the paths have brought that have `ended`, as bits."""
    lanes = paths.lane.shape[0]

    def draw(i: Array, drawn: Array) -> tuple[Array]:
        place = (paths.sample[i] - first) * lanes + paths.lane[i]
        return (put(drawn, part(paths.walk.radiance, i, 1), place),)

    return each_of(draw, ended, drawn)[0]


def _closed_up(paths: Paths, alive: Array) -> tuple[Paths, Array]:
    """Return the paths with those in front that are `alive`, as bits, and how many these are."""
    count = jnp.sum(lax.population_count(alive), dtype=jnp.int32)
    front = leading(count, alive.size)

    def tell(i: Array, gaps: Array, n: Array) -> tuple[Array, Array]:
        return put(gaps, i[None], n), n + 1

    def fill(i: Array, paths: Paths, n: Array) -> tuple[Paths, Array]:
        return jax.tree.map(lambda x: put(x, part(x, i, 1), gaps[n]), paths), n + 1

    gaps = each_of(tell, front & ~alive, jnp.zeros_like(paths.lane), jnp.int32(0))[0]
    return each_of(fill, alive & ~front, paths, jnp.int32(0))[0], count
