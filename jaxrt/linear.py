"""A linear function given together with its transpose, closed under JAX's transformations.

JAX would transpose a native kernel operation by operation, storing what every packet computed, and leave the kernel
doing so. Here the transpose is a kernel of its own, and JAX is told that the two belong together.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax
from jax.extend.core import ClosedJaxpr, Primitive, jaxpr_as_fun
from jax.interpreters import ad, batching, mlir

TOGETHER = 16  # linear arguments of a batch that share one evaluation of what they have in common

Leaves = list[Array]


class Pair(NamedTuple):
    """A linear function and its transpose, of lists of arrays: f(constants, x) -> y, linear in x."""

    forward: Callable[[Leaves, Leaves], Leaves]
    transpose: Callable[[Leaves, Leaves], Leaves]

    def swapped(self) -> "Pair":
        """Return the transpose with its own transpose."""
        return Pair(self.transpose, self.forward)


def apply_linear(pair: Pair, constants: Sequence[Array], x: Sequence[Array]) -> Leaves:
    """Return pair.forward(constants, x), whose derivative in x is itself and whose transpose is pair.transpose.

    Batches over x alone share the work that x does not enter; batches over constants run one after the other.
    Derivatives in the constants are those of pair.forward itself.
    """
    return _bind([*constants, *x], pair, len(constants))


def _bind(operands: Sequence[Array], pair: Pair, n: int) -> Leaves:
    # The traced function goes along, for JAX to see which devices it runs on
    program = jax.make_jaxpr(lambda *operands: pair.forward(list(operands[:n]), list(operands[n:])))(*operands)
    return _linear.bind(*operands, pair=pair, n=n, program=program)


_linear = Primitive("linear_with_transpose")
_linear.multiple_results = True


def _evaluate(*operands: Array, pair: Pair, n: int, program: ClosedJaxpr) -> Leaves:
    return jaxpr_as_fun(program)(*operands)


_linear.def_impl(lambda *operands, **params: jax.jit(partial(_evaluate, **params))(*operands))
_linear.def_abstract_eval(lambda *operands, program, **params: program.out_avals)
mlir.register_lowering(_linear, mlir.lower_fun(_evaluate, multiple_results=True))


def _differentiate(primals: Sequence[Array], tangents: Sequence[Any], *, pair: Pair, n: int, program: ClosedJaxpr) -> tuple[Leaves, Leaves]:
    y = _linear.bind(*primals, pair=pair, n=n, program=program)
    parts = []
    if any(type(t) is not ad.Zero for t in tangents[n:]):
        x = [ad.instantiate_zeros(t) for t in tangents[n:]]
        parts.append(_linear.bind(*primals[:n], *x, pair=pair, n=n, program=program))
    moved = [i for i in range(n) if type(tangents[i]) is not ad.Zero]
    if moved:

        def moved_constants(*values: Array) -> Leaves:
            constants = list(primals[:n])
            for i, value in zip(moved, values, strict=True):
                constants[i] = value
            return pair.forward(constants, list(primals[n:]))

        parts.append(jax.jvp(moved_constants, [primals[i] for i in moved], [tangents[i] for i in moved])[1])
    return y, [sum(terms[1:], terms[0]) for terms in zip(*parts, strict=True)]


ad.primitive_jvps[_linear] = _differentiate


def _transpose(cotangents: Sequence[Any], *operands: Any, pair: Pair, n: int, program: ClosedJaxpr) -> list[Array | None]:
    y = [ad.instantiate_zeros(ct) for ct in cotangents]
    x = _bind([*operands[:n], *y], pair.swapped(), n)
    wanted = [ad.is_undefined_primal(operand) for operand in operands[n:]]
    return [None] * n + [value if want else None for value, want in zip(x, wanted, strict=True)]


ad.primitive_transposes[_linear] = _transpose


def _batch(operands: Sequence[Array], dims: Sequence[Any], *, pair: Pair, n: int, program: ClosedJaxpr) -> tuple[Leaves, list[int]]:
    mapped = [d is not batching.not_mapped for d in dims]
    size = next(o.shape[d] for o, d, is_mapped in zip(operands, dims, mapped, strict=True) if is_mapped)
    moved = [jnp.moveaxis(o, d, 0) if is_mapped else o for o, d, is_mapped in zip(operands, dims, mapped, strict=True)]
    if any(mapped[:n]):
        # Other constants: one after the other
        batch = [o for o, is_mapped in zip(moved, mapped, strict=True) if is_mapped]

        def one(batch: Leaves) -> Leaves:
            values = iter(batch)
            chosen = [next(values) if is_mapped else o for o, is_mapped in zip(moved, mapped, strict=True)]
            return _linear.bind(*chosen, pair=pair, n=n, program=program)

        y = lax.map(one, batch)
    else:
        x = [o if m else jnp.broadcast_to(o, (size, *o.shape)) for o, m in zip(moved[n:], mapped[n:], strict=True)]
        y = _bind([*moved[:n], *x], Pair(*map(_of_many, pair)), n)
    return y, [0] * len(y)


def _of_many(f: Callable[[Leaves, Leaves], Leaves]) -> Callable[[Leaves, Leaves], Leaves]:
    """Return f for a batch of linear arguments, in groups that share the constants' work."""

    def many(constants: Leaves, x: Leaves) -> Leaves:
        if x[0].shape[0] <= TOGETHER:
            return jax.vmap(lambda x: f(constants, x))(x)
        return lax.map(lambda x: f(constants, x), x, batch_size=TOGETHER)

    return many


batching.primitive_batchers[_linear] = _batch
