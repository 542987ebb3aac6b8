"""A function without derivative as one indivisible operation.

Where JAX takes a derivative, it divides every function that it passes into what can be known now and what cannot, loop
by loop, even one that can be known whole. That costs more than tracing it. An operation is left as it is.
"""

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jax import Array, lax
from jax.extend.core import ClosedJaxpr, Primitive, jaxpr_as_fun
from jax.interpreters import batching, mlir

Result = TypeVar("Result")


def sealed(f: Callable[..., Result], *operands: Any) -> Result:
    """Return f(*operands), through which no derivative passes. Batches run one after the other."""
    operands = lax.stop_gradient(operands)
    program, result = jax.make_jaxpr(f, return_shape=True)(*operands)
    values = _sealed.bind(*jax.tree.leaves(operands), program=program)
    return jax.tree.unflatten(jax.tree.structure(result), values)


_sealed = Primitive("sealed")
_sealed.multiple_results = True


def _evaluate(*operands: Array, program: ClosedJaxpr) -> list[Array]:
    return jaxpr_as_fun(program)(*operands)


_sealed.def_impl(_evaluate)
_sealed.def_abstract_eval(lambda *operands, program: list(program.out_avals))
mlir.register_lowering(_sealed, mlir.lower_fun(_evaluate, multiple_results=True))


def _batch(operands: Sequence[Array], dims: Sequence[Any], *, program: ClosedJaxpr) -> tuple[list[Array], list[int]]:
    mapped = [dim is not batching.not_mapped for dim in dims]
    batch = [jnp.moveaxis(o, dim, 0) for o, dim, m in zip(operands, dims, mapped, strict=True) if m]

    def one(batch: list[Array]) -> list[Array]:
        values = iter(batch)
        chosen = [next(values) if m else o for o, m in zip(operands, mapped, strict=True)]
        return _sealed.bind(*chosen, program=program)

    y = lax.map(one, batch)
    return y, [0] * len(y)


batching.primitive_batchers[_sealed] = _batch
