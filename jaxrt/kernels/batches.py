"""Batches of an operation whose evaluations do not go side by side."""

from collections.abc import Callable, Sequence
from typing import Any

import jax.numpy as jnp
from jax import Array, lax


def one_by_one(
    operation: Callable[..., list[Array]], operands: Sequence[Array], dims: Sequence[Any]
) -> tuple[list[Array], list[int]]:
    """Return operation(*operands) for each member of a batch, and along which axis: a rule for `internals.operation`.

    dims: the axis of the batch in each operand, None where they share one.
    """
    mapped = [dim is not None for dim in dims]
    batch = [jnp.moveaxis(o, dim, 0) for o, dim, m in zip(operands, dims, mapped, strict=True) if m]

    def one(batch: list[Array]) -> list[Array]:
        values = iter(batch)
        return operation(*(next(values) if m else o for o, m in zip(operands, mapped, strict=True)))

    y = lax.map(one, batch)
    return y, [0] * len(y)
