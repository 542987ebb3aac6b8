"""Rows of a table, with a derivative that native kernels can compute backwards.

JAX transposes an indexed read to a scatter, which has no native form on a CPU. There it becomes a loop that adds to one
row after the other: in order, so that sums do not depend on chance.
"""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxrt.kernels.internals import Zero, operation
from jaxrt.kernels.native import in_native, in_wide

FEW = 64  # rows: of so many, each of a wide kernel's is the sum of all that may be its own: none waits for another


def part(table: Array, start: Array, size: int) -> Array:
    """Return `size` rows of a table (n, …) from `start` on, which is no less than 0; without derivative backwards."""
    return lax.dynamic_slice_in_dim(table, start, size, allow_negative_indices=False)


def put(table: Array, rows: Array, start: Array) -> Array:
    """Return a table with other rows from `start` on, which is no less than 0; without derivative backwards."""
    return lax.dynamic_update_slice_in_dim(table, rows, start, 0, allow_negative_indices=False)


def take(table: Array, i: Array) -> Array:
    """Return table[i], i being int32 in range, of any shape; differentiable in the table (n, …)."""
    # The one row that there is can be read without an index
    return table[0] if table.shape[0] == 1 and i.ndim == 0 else _take.bind(table, i)


def _rows(table: Array, i: Array) -> Array:
    return table.at[i].get(mode="promise_in_bounds")


def _add_rows(rows: Array, i: Array, *, n: int) -> Array:
    """Return the table (n, …) that holds in each row the sum of all `rows` with its index."""
    cells = rows.shape[i.ndim :]
    if not in_native():
        return add_at_once(rows.reshape(-1, *cells), i.ravel(), n)
    rows, i = rows.reshape(-1, 1, *cells), i.ravel()

    def add(k: Array, table: Array) -> Array:
        total = lax.dynamic_slice_in_dim(table, i[k], 1) + rows[k]
        return lax.dynamic_update_slice_in_dim(table, total, i[k], 0)

    return lax.fori_loop(0, i.size, add, jnp.zeros((n, *cells), rows.dtype))


def add_at_once(rows: Array, i: Array, n: int) -> Array:
    """Return the table (n, …) of sums of rows (k, …) by their index (k,), for what is no native kernel.

    One after the other, accelerators took minutes.
    """
    if n > FEW or not in_wide():
        return jnp.zeros((n, *rows.shape[1:]), rows.dtype).at[i].add(rows, mode="promise_in_bounds")
    own = jnp.expand_dims(i[:, None] == jnp.arange(n, dtype=i.dtype)[None], tuple(range(2, rows.ndim + 1)))
    return jnp.sum(jnp.where(own, rows[:, None], 0), 0)


def _shape(table: Any, i: Any) -> Any:
    return table.update(shape=(*i.shape, *table.shape[1:]))


def _differentiate(primals: Sequence[Array], tangents: Sequence[Any]) -> tuple[Array, Any]:
    y, change = _take.bind(*primals), tangents[0]
    if type(change) is Zero:
        return y, Zero(jax.typeof(y).to_tangent_aval())
    return y, _take.bind(change, primals[1])


def _transpose(cotangent: Any, table: Any, i: Array) -> list[Any]:
    if type(cotangent) is Zero:
        return [Zero(table.aval), None]
    return [_add_rows(cotangent, i, n=table.aval.shape[0]), None]


def _batch(operands: Sequence[Array], dims: Sequence[Any]) -> tuple[Array, int]:
    (table, i), (table_dim, i_dim) = operands, dims
    if table_dim is None:
        return _take.bind(table, jnp.moveaxis(i, i_dim, 0)), 0
    if i_dim is None:
        return _take.bind(jnp.moveaxis(table, table_dim, -1), i), i.ndim + table.ndim - 2
    # All tables below one another
    table, i = jnp.moveaxis(table, table_dim, 0), jnp.moveaxis(i, i_dim, 0)
    many, n = table.shape[:2]
    first = (n * jnp.arange(many, dtype=i.dtype)).reshape(many, *[1] * (i.ndim - 1))
    return _take.bind(table.reshape(many * n, *table.shape[2:]), i + first), 0


_take = operation("take", _rows, _shape, _batch, _differentiate, _transpose, several=False)
