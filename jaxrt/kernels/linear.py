"""A linear function given together with its transpose, closed under JAX's transformations.

JAX would transpose a native kernel operation by operation, storing what every packet computed, and leave the kernel
doing so. Here the transpose is a kernel of its own, and JAX is told that the two belong together.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple, Protocol

import jax
import jax.numpy as jnp
from jax import Array, lax
from jax.extend.core import ClosedJaxpr, Primitive

from jaxrt.kernels.batches import one_by_one
from jaxrt.kernels.internals import ShapedArray, Zero, instantiate_zeros, is_undefined_primal, operation

Leaves = list[Array]
Shapes = tuple[jax.ShapeDtypeStruct, ...]


class Pair(Protocol):
    """A linear function and its transpose, of lists of arrays: f(constants, x) -> y, linear in x.

    Equal where it computes the same, so that what has been compiled for one is found again for the other.
    """

    @property
    def x(self) -> Shapes:
        """Shapes of the linear arguments."""

    @property
    def y(self) -> Shapes:
        """Shapes of the results."""

    @property
    def together(self) -> tuple[int, int]:
        """How many arguments of a batch share one evaluation, forward and transposed."""

    def parted(self, moved: Sequence[int]) -> "Sequence[tuple[Pair, list[int]]]":
        """Return the numbers of the constants that move, each with the pair whose derivative in them is wanted."""

    def forward(self, constants: Leaves, x: Leaves) -> Leaves:
        """Return y."""

    def transpose(self, constants: Leaves, y: Leaves) -> Leaves:
        """Return x."""


class _Swapped(NamedTuple):
    """The transpose with its own transpose."""

    pair: Pair

    @property
    def x(self) -> Shapes:
        return self.pair.y

    @property
    def y(self) -> Shapes:
        return self.pair.x

    @property
    def together(self) -> tuple[int, int]:
        return self.pair.together[::-1]

    def parted(self, moved: Sequence[int]) -> Sequence[tuple[Pair, list[int]]]:
        return [(_Swapped(pair), numbers) for pair, numbers in self.pair.parted(moved)]

    def forward(self, constants: Leaves, x: Leaves) -> Leaves:
        return self.pair.transpose(constants, x)

    def transpose(self, constants: Leaves, y: Leaves) -> Leaves:
        return self.pair.forward(constants, y)


class _Many(NamedTuple):
    """The function of n linear arguments at once."""

    pair: Pair
    n: int

    @property
    def x(self) -> Shapes:
        return _stacked(self.pair.x, self.n)

    @property
    def y(self) -> Shapes:
        return _stacked(self.pair.y, self.n)

    @property
    def together(self) -> tuple[int, int]:
        return self.pair.together

    def parted(self, moved: Sequence[int]) -> Sequence[tuple[Pair, list[int]]]:
        return [(_Many(pair, self.n), numbers) for pair, numbers in self.pair.parted(moved)]

    def forward(self, constants: Leaves, x: Leaves) -> Leaves:
        return _in_groups(partial(self.pair.forward, constants), x, self.together[0])

    def transpose(self, constants: Leaves, y: Leaves) -> Leaves:
        return _in_groups(partial(self.pair.transpose, constants), y, self.together[1])


def _stacked(shapes: Shapes, n: int) -> Shapes:
    return tuple(jax.ShapeDtypeStruct((n, *one.shape), one.dtype) for one in shapes)


def apply_linear(pair: Pair, constants: Sequence[Array], x: Sequence[Array], devices: ClosedJaxpr) -> Leaves:
    """Return pair.forward(constants, x), whose derivative in x is itself and whose transpose is pair.transpose.

    Batches over x alone share the work that x does not enter; batches over constants run one after the other.
    Derivatives in the constants are those of the forward functions that pair.parted has for them. The functions are
    traced where they are compiled and not before; devices: any program that runs on their devices, by which JAX finds
    them.
    """
    return _linear.bind(*constants, *x, pair=pair, n=len(constants), devices=devices)


def _evaluate(*operands: Array, pair: Pair, n: int, devices: ClosedJaxpr) -> Leaves:
    return pair.forward(list(operands[:n]), list(operands[n:]))


def _result(*operands: Any, pair: Pair, n: int, devices: ClosedJaxpr) -> list[Any]:
    return [ShapedArray(y.shape, y.dtype) for y in pair.y]


def _differentiate(
    primals: Sequence[Array], tangents: Sequence[Any], *, pair: Pair, n: int, devices: ClosedJaxpr
) -> tuple[Leaves, Leaves]:
    y = _linear.bind(*primals, pair=pair, n=n, devices=devices)
    parts = []
    if any(type(t) is not Zero for t in tangents[n:]):
        x = [instantiate_zeros(t) for t in tangents[n:]]
        parts.append(_linear.bind(*primals[:n], *x, pair=pair, n=n, devices=devices))
    moved = [i for i in range(n) if type(tangents[i]) is not Zero]
    for part, numbers in pair.parted(moved) if moved else ():

        def moved_constants(*values: Array, part: Pair = part, numbers: list[int] = numbers) -> Leaves:
            constants = list(primals[:n])
            for i, value in zip(numbers, values, strict=True):
                constants[i] = value
            return part.forward(constants, list(primals[n:]))

        change = jax.jvp(moved_constants, [primals[i] for i in numbers], [tangents[i] for i in numbers])[1]
        parts.append(_forwards.bind(*change))
    return y, [sum(terms[1:], terms[0]) for terms in zip(*parts, strict=True)]


def _transpose(
    cotangents: Sequence[Any], *operands: Any, pair: Pair, n: int, devices: ClosedJaxpr
) -> list[Array | None]:
    y = [instantiate_zeros(ct) for ct in cotangents]
    x = _linear.bind(*operands[:n], *y, pair=_swapped(pair), n=n, devices=devices)
    wanted = [is_undefined_primal(operand) for operand in operands[n:]]
    none: list[Array | None] = [None] * n
    return none + [value if want else None for value, want in zip(x, wanted, strict=True)]


def _swapped(pair: Pair) -> Pair:
    return pair.pair if isinstance(pair, _Swapped) else _Swapped(pair)


def _batch(
    operands: Sequence[Array], dims: Sequence[Any], *, pair: Pair, n: int, devices: ClosedJaxpr
) -> tuple[Leaves, list[int]]:
    mapped = [d is not None for d in dims]
    if any(mapped[:n]):
        # Other constants
        return one_by_one(partial(_linear.bind, pair=pair, n=n, devices=devices), operands, dims)
    size = next(o.shape[d] for o, d, m in zip(operands, dims, mapped, strict=True) if m)
    x = [
        jnp.moveaxis(o, d, 0) if m else jnp.broadcast_to(o, (size, *o.shape))
        for o, d, m in zip(operands[n:], dims[n:], mapped[n:], strict=True)
    ]
    y = _linear.bind(*operands[:n], *x, pair=_Many(pair, size), n=n, devices=devices)
    return y, [0] * len(y)


def _in_groups(f: Callable[[Leaves], Leaves], x: Leaves, together: int) -> Leaves:
    """Return f for a batch of linear arguments, in groups of `together` that share the constants' work."""
    if 1 < x[0].shape[0] <= together:
        return jax.vmap(f)(x)
    return lax.map(f, x, batch_size=together if together > 1 else None)


def _refuse(*_: Any) -> Sequence[Any]:
    raise ValueError(
        "render: second derivatives are taken forwards only: write jax.hessian(f) or jax.jacfwd(jax.grad(f)), not "
        "jax.grad or jax.jacrev of a derivative"
    )


def _keep(*operands: Array) -> Leaves:
    return list(operands)


def _keep_batch(operands: Sequence[Array], dims: Sequence[Any]) -> tuple[Leaves, Sequence[Any]]:
    return _forwards.bind(*operands), dims


def _keep_differentiate(primals: Sequence[Array], tangents: Sequence[Any]) -> tuple[Leaves, Leaves]:
    return _forwards.bind(*primals), _forwards.bind(*map(instantiate_zeros, tangents))


# What has no transpose, said in words: JAX would name a loop that the caller has not written
_forwards: Primitive = operation("forwards", _keep, _keep, _keep_batch, _keep_differentiate, _refuse)

_linear: Primitive = operation(
    "linear_with_transpose",
    _evaluate,
    _result,
    _batch,
    _differentiate,
    _transpose,
    eager=jax.jit(_evaluate, static_argnames=("pair", "n", "devices")),
)
