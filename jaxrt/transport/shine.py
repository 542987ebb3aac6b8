"""The derivative backwards in what shines: in lights and sky, which change what a path brings, and not where it goes.

So nothing of a path has to be kept until its last event: each event's part is found as the path comes by.
"""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxrt.transport.film import Plan, Run, camera_ray, numbers_of, pixels_of
from jaxrt.transport.path import Tables, Walk, last_look, next_event, walk_along

Values = dict[int, Array]


def pull_light(
    plan: Plan,
    scene_with: Callable[[Values], tuple[Tables, Run]],
    values: Values,
    sample: Array,
    packet: Array,
    weights: Array,
    attached: bool,
) -> Values:
    """Return the derivative of a sum over the packet's pixels, of weights (lanes, 3) times one sample, in the values.

    scene_with: gives tables, of which no path depends on the values, and the run. attached: as of `sample_packet`.
    """
    tables, run = scene_with(values)
    x, y = pixels_of(plan, tables, run, packet)

    def begin(x: Array, y: Array) -> Walk:
        return walk_along(tables, camera_ray(plan, tables, numbers_of(plan, tables, run, sample, x, y), x, y), True)

    def event(k: Array, state: tuple[Walk, Values]) -> tuple[Walk, Values]:
        walks, total = state

        def one(tables: Tables, walk: Walk, x: Array, y: Array) -> Walk:
            return next_event(tables, walk, numbers_of(plan, tables, run, sample, x, y)(k), attached)

        def brought(values: Values) -> tuple[Array, Walk]:
            onward = jax.vmap(partial(one, scene_with(values)[0]))(walks, x, y)
            return onward.radiance, onward

        _, pull, onward = jax.vjp(brought, values, has_aux=True)
        return onward, jax.tree.map(jnp.add, total, pull(weights)[0])

    def seen(values: Values) -> Array:
        return jax.vmap(partial(last_look, scene_with(values)[0]))(walks)

    start = jax.vmap(begin)(x, y), jax.tree.map(jnp.zeros_like, values)
    walks, total = lax.fori_loop(1, plan.max_depth + 1, event, start)
    return jax.tree.map(jnp.add, total, jax.vjp(seen, values)[1](weights)[0])
