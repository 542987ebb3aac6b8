"""Derivatives in texels without a table of them for each lookup: what was read, and the derivative in that.

The derivative of a lookup in the whole table is 0 but in four rows. As JAX adds such tables up, a sample of a packet
would run over all texels many times. Here a lookup has a mark, zeros that it seems to depend on, and the derivative "in
the mark" tells the rows, their weights and the derivative in the colour: `add_marks` adds these to one table, in order.
"""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxrt.core.maths import kahan_add
from jaxrt.kernels.gather import add_at_once, take
from jaxrt.kernels.native import in_native

Tap = tuple[Array, Array]  # () int32 row of a table, and its weight ()

TAPS = 4  # of a lookup, at most
WIDTH = 3 * TAPS + 3  # numbers of a mark: rows in two parts each, their weights, three channels
PART = 4096  # of a row's number, since float32 counts to 2^24 alone


def mix(texels: Array, taps: Sequence[Tap]) -> Array:
    """Return the sum (3,) of rows of a table (n, 3), by their weights."""
    # One by one: of an array of rows, XLA's CPU backend would find each anew for each channel
    return _weighed([take(texels, row) for row, _ in taps], taps)


def _weighed(colors: list[Array], taps: Sequence[Tap]) -> Array:
    parts = [weight * color for color, (_, weight) in zip(colors, taps, strict=True)]
    return sum(parts[1:], parts[0])


@jax.custom_vjp
def read(texels: Array, taps: list[Tap], mark: Array) -> Array:
    """Return what `mix` does, of up to `TAPS`. No derivative is taken in the table."""
    return mix(texels, taps)


def _forward(texels: Array, taps: list[Tap], mark: Array) -> tuple[Array, tuple[list[Tap], list[Array]]]:
    colors = [take(texels, row) for row, _ in taps]
    return _weighed(colors, taps), (taps, colors)


def _backward(kept: tuple[list[Tap], list[Array]], change: Array) -> tuple[None, list[Any], Array]:
    taps, colors = kept
    told = [(row // PART, row % PART, weight) for row, weight in taps]
    told += [(jnp.zeros_like(change[0]),) * 3] * (TAPS - len(taps))
    numbers = [part.astype(change.dtype) for parts in zip(*told, strict=True) for part in parts]
    slopes = [(np.zeros((), jax.dtypes.float0), jnp.sum(color * change)) for color in colors]
    return None, slopes, jnp.concatenate([jnp.stack(numbers), change])


read.defvjp(_forward, _backward)


def add_marks(sums: Array, marks: Array) -> Array:
    """Return the sums (n, 6) of a table's derivative, compensated, with those of lookups added.

    sums: totals, then compensations: in one array, which is then changed in place. marks: (k, 15) derivatives.
    """
    rows = marks[:, :4].astype(jnp.int32) * PART + marks[:, 4:8].astype(jnp.int32)

    def add(k: Array, sums: Array) -> Array:
        mark, tap = k // 4, k % 4
        own = lax.dynamic_slice_in_dim(sums, rows[mark, tap], 1)
        new = jnp.concatenate(kahan_add(own[:, :3], own[:, 3:], marks[mark, 8 + tap] * marks[mark, None, 12:]), -1)
        return lax.dynamic_update_slice_in_dim(sums, new, rows[mark, tap], 0)

    if in_native():
        # One after the other
        return lax.fori_loop(0, 4 * marks.shape[0], add, sums)
    told = marks[:, 8:12, None] * marks[:, None, 12:]
    more = add_at_once(told.reshape(-1, 3), rows.ravel(), sums.shape[0])
    return jnp.concatenate(kahan_add(sums[:, :3], sums[:, 3:], more), -1)
