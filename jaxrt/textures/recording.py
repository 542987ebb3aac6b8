"""Derivatives in texels without a table of them for each lookup: what was read, and the derivative in that.

The derivative of a lookup in the whole table is 0 but in four rows. As JAX adds such tables up, a sample of a packet
would run over all texels many times. Here a lookup has a mark, zeros that it seems to depend on, and the derivative "in
the mark" tells the rows, their weights and the derivative in the colour: `add_marks` adds these to one table, in order.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxrt.core.maths import kahan_add
from jaxrt.kernels.gather import take

WIDTH = 15  # numbers of a mark: four rows in two parts each, their weights, three channels
PART = 4096  # of a row's number, since float32 counts to 2^24 alone


def mix(colors: Array, weights: Array) -> Array:
    """Return the sum (3,) of colours (4, 3) by weights (4,); not as a matrix product, whose bits accelerators drop."""
    return jnp.sum(weights[:, None] * colors, 0)


@jax.custom_vjp
def read(texels: Array, rows: Array, weights: Array, mark: Array) -> Array:
    """Return the sum (3,) of rows (4,) of a table (n, 3), by weights (4,). No derivative is taken in the table."""
    return mix(take(texels, rows), weights)


def _forward(texels: Array, rows: Array, weights: Array, mark: Array) -> tuple[Array, tuple[Array, Array, Array]]:
    colors = take(texels, rows)
    return mix(colors, weights), (rows, weights, colors)


def _backward(kept: tuple[Array, Array, Array], change: Array) -> tuple[None, np.ndarray, Array, Array]:
    rows, weights, colors = kept
    parts = jnp.concatenate([rows // PART, rows % PART]).astype(change.dtype)
    slopes = jnp.sum(colors * change[None], -1)
    return None, np.zeros(rows.shape, jax.dtypes.float0), slopes, jnp.concatenate([parts, weights, change])


read.defvjp(_forward, _backward)


def add_marks(sums: Array, marks: Array) -> Array:
    """Return the sums (n, 6) of a table's derivative, compensated, with those of lookups added, one after the other.

    sums: totals, then compensations: in one array, which is then changed in place. marks: (k, 15) derivatives.
    """
    rows = marks[:, :4].astype(jnp.int32) * PART + marks[:, 4:8].astype(jnp.int32)

    def add(k: Array, sums: Array) -> Array:
        mark, tap = k // 4, k % 4
        own = lax.dynamic_slice_in_dim(sums, rows[mark, tap], 1)
        new = jnp.concatenate(kahan_add(own[:, :3], own[:, 3:], marks[mark, 8 + tap] * marks[mark, None, 12:]), -1)
        return lax.dynamic_update_slice_in_dim(sums, new, rows[mark, tap], 0)

    return lax.fori_loop(0, 4 * marks.shape[0], add, sums)
