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
from jax.extend.core import ClosedJaxpr, Primitive
from jax.interpreters import ad, batching, mlir

from jaxrt.batches import one_by_one

Leaves = list[Array]
Shapes = tuple[jax.ShapeDtypeStruct, ...]


class Pair(NamedTuple):
    """A linear function and its transpose, of lists of arrays: f(constants, x) -> y, linear in x."""

    forward: Callable[[Leaves, Leaves], Leaves]
    transpose: Callable[[Leaves, Leaves], Leaves]
    x: Shapes
    y: Shapes
    together: tuple[int, int]  # how many arguments of a batch share one evaluation, forward and transposed

    def swapped(self) -> "Pair":
        """Return the transpose with its own transpose."""
        return Pair(self.transpose, self.forward, self.y, self.x, self.together[::-1])

    def of_many(self, n: int) -> "Pair":
        """Return the function of n linear arguments at once."""
        x, y = (tuple(jax.ShapeDtypeStruct((n, *one.shape), one.dtype) for one in side) for side in (self.x, self.y))
        forward, transpose = map(_of_many, (self.forward, self.transpose), self.together)
        return Pair(forward, transpose, x, y, self.together)


def apply_linear(pair: Pair, constants: Sequence[Array], x: Sequence[Array], devices: ClosedJaxpr) -> Leaves:
    """Return pair.forward(constants, x), whose derivative in x is itself and whose transpose is pair.transpose.

    Batches over x alone share the work that x does not enter; batches over constants run one after the other.
    Derivatives in the constants are those of pair.forward itself. The functions are traced where they are compiled and
    not before; devices: any program that runs on their devices, by which JAX finds them.
    """
    return _linear.bind(*constants, *x, pair=pair, n=len(constants), devices=devices)


_linear = Primitive("linear_with_transpose")
_linear.multiple_results = True


def _evaluate(*operands: Array, pair: Pair, n: int, devices: ClosedJaxpr) -> Leaves:
    return pair.forward(list(operands[:n]), list(operands[n:]))


def _result(*operands: Any, pair: Pair, n: int, devices: ClosedJaxpr) -> list[Any]:
    return [jax.core.ShapedArray(y.shape, y.dtype) for y in pair.y]


_linear.def_impl(lambda *operands, **params: jax.jit(partial(_evaluate, **params))(*operands))
_linear.def_abstract_eval(_result)
mlir.register_lowering(_linear, mlir.lower_fun(_evaluate, multiple_results=True))


def _differentiate(
    primals: Sequence[Array], tangents: Sequence[Any], *, pair: Pair, n: int, devices: ClosedJaxpr
) -> tuple[Leaves, Leaves]:
    y = _linear.bind(*primals, pair=pair, n=n, devices=devices)
    parts = []
    if any(type(t) is not ad.Zero for t in tangents[n:]):
        x = [ad.instantiate_zeros(t) for t in tangents[n:]]
        parts.append(_linear.bind(*primals[:n], *x, pair=pair, n=n, devices=devices))
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


def _transpose(
    cotangents: Sequence[Any], *operands: Any, pair: Pair, n: int, devices: ClosedJaxpr
) -> list[Array | None]:
    y = [ad.instantiate_zeros(ct) for ct in cotangents]
    x = _linear.bind(*operands[:n], *y, pair=pair.swapped(), n=n, devices=devices)
    wanted = [ad.is_undefined_primal(operand) for operand in operands[n:]]
    none: list[Array | None] = [None] * n
    return none + [value if want else None for value, want in zip(x, wanted, strict=True)]


ad.primitive_transposes[_linear] = _transpose


def _batch(
    operands: Sequence[Array], dims: Sequence[Any], *, pair: Pair, n: int, devices: ClosedJaxpr
) -> tuple[Leaves, list[int]]:
    mapped = [d is not batching.not_mapped for d in dims]
    if any(mapped[:n]):
        # Other constants
        return one_by_one(partial(_linear.bind, pair=pair, n=n, devices=devices), operands, dims)
    size = next(o.shape[d] for o, d, m in zip(operands, dims, mapped, strict=True) if m)
    x = [
        jnp.moveaxis(o, d, 0) if m else jnp.broadcast_to(o, (size, *o.shape))
        for o, d, m in zip(operands[n:], dims[n:], mapped[n:], strict=True)
    ]
    y = _linear.bind(*operands[:n], *x, pair=pair.of_many(size), n=n, devices=devices)
    return y, [0] * len(y)


def _of_many(f: Callable[[Leaves, Leaves], Leaves], together: int) -> Callable[[Leaves, Leaves], Leaves]:
    """Return f for a batch of linear arguments, in groups of `together` that share the constants' work."""

    def many(constants: Leaves, x: Leaves) -> Leaves:
        if 1 < x[0].shape[0] <= together:
            return jax.vmap(lambda x: f(constants, x))(x)
        return lax.map(lambda x: f(constants, x), x, batch_size=together if together > 1 else None)

    return many


batching.primitive_batchers[_linear] = _batch
