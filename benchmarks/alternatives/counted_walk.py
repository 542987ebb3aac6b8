"""The walk of one ray through the tree of a mesh, one step at a time, its steps counted."""

from collections.abc import Callable
from unittest.mock import patch

import jax.numpy as jnp
from jax import Array, lax

from jaxrt.shapes import walk
from jaxrt.shapes.boxes import Tree

State = tuple[walk._State, Array]


def visits(any_hit: bool, tree: Tree, o: Array, d: Array, farthest: Array) -> Array:
    """Return how many nodes, also those returned to, and how many leaves (2,) a ray visits."""
    with patch.object(walk, "walk", _counted):
        return walk.walk_alone(any_hit, tree, *walk.ray_rows(o, d), farthest)[0]


def _counted(tree: Tree, boxes: Callable, leaf: Callable, farthest: Array) -> tuple[Array, None]:
    def descend(w: walk._State) -> walk._State:
        return walk._descend(tree, boxes, w)

    def visit(w: walk._State) -> walk._State:
        return walk._visit(leaf, w)

    def step(state: State) -> State:
        w, counts = state
        kind = jnp.where(w.code >= 0, 0, jnp.where(w.code != walk.NONE, 1, 2))
        return lax.switch(kind, (descend, visit, walk._pop), w), counts + (kind == jnp.arange(2))

    start = walk._start(tree, farthest), jnp.zeros(2, jnp.int32)
    return lax.while_loop(lambda state: walk._going(state[0]), step, start)[1], None
