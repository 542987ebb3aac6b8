"""The walk of one ray through the tree of a mesh, one step at a time, its steps counted."""

from collections.abc import Callable
from functools import partial
from unittest.mock import patch

import jax.numpy as jnp
from jax import Array, lax

from jaxrt.shapes.search import walk
from jaxrt.shapes.search.boxes import Tree

State = tuple[walk.State, Array, Array]
Change = Callable[[walk.State], walk.State]


def visits(
    any_hit: bool,
    tree: Tree,
    o: Array,
    d: Array,
    farthest: Array,
    before: Change = lambda w: w,
    most: int = 2**31 - 1,
) -> tuple[Array, Array]:
    """Return how many nodes, also those returned to, and leaves (2,) a ray visits; and levels () of the stack in use.

    before: is done to the walk before each step. most: steps that it ends after.
    """
    counted = partial(_counted, before, most)
    with patch.object(walk, "walk", counted):
        return walk.walk_alone(any_hit, tree, *walk.ray_rows(tree.balls, o, d), farthest)


def _counted(
    before: Change, most: int, tree: Tree, boxes: Callable, leaf: Callable, farthest: Array
) -> tuple[Array, Array]:
    steps = partial(walk.descend, tree, boxes), partial(walk.visit, leaf), walk.pop

    def step(state: State) -> State:
        w, counts, levels = state
        kind = jnp.where(w.code >= 0, 0, jnp.where(w.code != walk.NONE, 1, 2))
        w = lax.switch(kind, steps, before(w))
        return w, counts + (kind == jnp.arange(2)).astype(jnp.int32), jnp.maximum(levels, w.top + 1)

    def going(state: State) -> Array:
        return walk.going(state[0]) & (jnp.sum(state[1]) < most)

    start = walk.start(tree, farthest), jnp.zeros(2, jnp.int32), jnp.int32(0)
    return lax.while_loop(going, step, start)[1:]
