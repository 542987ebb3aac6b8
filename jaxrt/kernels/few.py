"""What few lanes of a packet need, computed for those alone.

A `where` computes what it chooses from for all lanes. Here those that need it are gone through one by one, so that a
packet costs what its own lanes ask for: less, while these are fewer than one in as many as a CPU computes at once. For
native kernels without derivative backwards, which would have to know how often a loop turns.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array, lax
from jax.custom_batching import custom_vmap

from jaxrt.kernels.bits import each_of, masks
from jaxrt.kernels.gather import part, put
from jaxrt.kernels.native import in_native, in_stages


def where_needed(f: Callable[..., Any], needed: Array, *operands: Any) -> Any:
    """Return f(*operands) where () bool `needed`, else zeros."""
    if not in_native():
        return _chosen(f, needed, *operands)
    chosen = custom_vmap(partial(_chosen, f))

    @chosen.def_vmap
    def rule(size: int, batched: Any, needed: Array, *operands: Any) -> Any:
        flags = jax.tree.leaves(batched[1:])
        needs = jnp.broadcast_to(needed, (size,))
        results = _one_by_one(f, flags, needs, operands)
        return results, jax.tree.map(lambda _: True, results)

    return chosen(needed, *operands)


def where_any(needed: Array, f: Callable[..., Any], otherwise: Callable[..., Any], *operands: Any) -> Any:
    """Return f(*operands), or otherwise(*operands) if no lane of a native kernel's packet is `needed`, () bool.

    What f gives lanes that do not need it must not matter. The operands must be all that both read.
    """
    if not in_native():
        return f(*operands)
    one = custom_vmap(lambda needed, *operands: f(*operands))

    @one.def_vmap
    def rule(size: int, batched: Any, needed: Array, *operands: Any) -> Any:
        axes = tuple(jax.tree.map(lambda flag: 0 if flag else None, one) for one in batched[1:])

        def of_all(g: Callable[..., Any]) -> Callable[..., Any]:
            return lambda *operands: jax.vmap(g, in_axes=axes, axis_size=size)(*operands)

        results = lax.cond(jnp.any(needed), of_all(f), of_all(otherwise), *operands)
        return results, jax.tree.map(lambda _: True, results)

    return one(needed, *operands)


def _chosen(f: Callable[..., Any], needed: Array, *operands: Any) -> Any:
    return jax.tree.map(lambda x: jnp.where(needed, x, 0), f(*operands))


def _one_by_one(f: Callable[..., Any], flags: list[bool], needed: Array, operands: Any) -> Any:
    """Return the results of all lanes. flags: of what each lane has of its own, leaf by leaf of the operands."""
    leaves, structure = jax.tree.flatten(operands)

    def one(lane: Array) -> Any:
        own = [part(x, lane, 1)[0] if flag else x for x, flag in zip(leaves, flags, strict=True)]
        return in_stages(f)(*jax.tree.unflatten(structure, own))

    def keep(lane: Array, results: Any) -> tuple[Any]:
        return (jax.tree.map(lambda rows, row: put(rows, row[None], lane), results, one(lane)),)

    shapes = jax.eval_shape(one, jnp.int32(0))
    nothing = jax.tree.map(lambda x: jnp.zeros((needed.size, *x.shape), x.dtype), shapes)
    return each_of(keep, masks(needed), nothing)[0]
