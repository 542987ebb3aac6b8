"""The walks of many rays at the same time, as accelerators want it: at each turn each ray does what it is at.

Were each ray to loop over nodes and then over leaves, all would wait at every leaf for the one that is longest under
way. Here a ray waits at the end alone.
"""

from functools import partial

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxrt.shapes.search.boxes import Tree
from jaxrt.shapes.search.walk import (
    NONE,
    State,
    at_leaf,
    at_node,
    descend,
    found,
    going,
    pop,
    ray_rows,
    start,
    tests_of,
    visit,
)


def walk_side_by_side(any_hit: bool, tree: Tree, o: Array, d: Array, farthest: Array) -> tuple[Array, Array]:
    """Return (distance, face) of rays (lanes, 3), each as `walk_alone` finds it."""
    # Number by number: a row would be taken apart anew at each turn
    rays = [list(x.T) for x in jax.vmap(partial(ray_rows, tree.balls))(o, d)]

    def turn(w: State, ray: list[Array], places: list[Array]) -> State:
        boxes, leaf = tests_of(any_hit, tree, ray, places)
        below = descend(tree, boxes, w)
        # What stands above the top of a stack does not matter: it is written in any case, or all stacks were copied
        w = _where(at_node(w), below, w)._replace(stack=below.stack)
        w = _where(at_leaf(w), visit(leaf, w), w)
        w = _where((w.code == NONE) & (w.top >= 0), pop(w), w)
        return _where(going(w), w, _done(w))

    def begin(farthest: Array) -> State:
        w = start(tree, farthest)
        return _where(farthest > 0, w, _done(w))

    end = lax.while_loop(
        lambda w: jnp.any(w.code != NONE), lambda w: jax.vmap(turn)(w, *rays), jax.vmap(begin)(farthest)
    )
    return found(end, farthest)


def _where(chosen: Array, a: State, b: State) -> State:
    """Return one of two walks, that of the stack of both."""
    picked = [jnp.where(chosen, x, y) for x, y in zip(a._replace(stack=a.top), b._replace(stack=b.top), strict=True)]
    return State(*picked)._replace(stack=b.stack)


def _done(w: State) -> State:
    return w._replace(code=jnp.int32(NONE), top=jnp.int32(-1))
