"""A function without derivative as one indivisible operation.

Where JAX takes a derivative, it divides every function that it passes into what can be known now and what cannot, loop
by loop, even one that can be known whole. That costs more than tracing it. An operation is left as it is.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, TypeVar

import jax
from jax import Array, lax
from jax.extend.core import ClosedJaxpr, jaxpr_as_fun

from jaxrt.kernels.batches import one_by_one
from jaxrt.kernels.internals import operation

Result = TypeVar("Result")


def sealed(f: Callable[..., Result], *operands: Any) -> Result:
    """Return f(*operands), through which no derivative passes. Batches run one after the other."""
    operands = lax.stop_gradient(operands)
    program, result = jax.make_jaxpr(f, return_shape=True)(*operands)
    values = _sealed.bind(*jax.tree.leaves(operands), program=program)
    return jax.tree.unflatten(jax.tree.structure(result), values)


def _evaluate(*operands: Array, program: ClosedJaxpr) -> list[Array]:
    return jaxpr_as_fun(program)(*operands)


def _result(*operands: Any, program: ClosedJaxpr) -> list[Any]:
    return list(program.out_avals)


def _batch(operands: Sequence[Array], dims: Sequence[Any], *, program: ClosedJaxpr) -> tuple[list[Array], list[int]]:
    return one_by_one(partial(_sealed.bind, program=program), operands, dims)


_sealed = operation("sealed", _evaluate, _result, _batch)
