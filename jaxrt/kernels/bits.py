"""Lanes of a packet, or faces of a leaf, as the bits of one integer, and a loop over those that are set."""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
from jax import Array, lax

WORD = 32  # bits of an integer


def mask(bits: Array) -> Array:
    """Return booleans (…, n) as the bits of integers (…), n up to 32."""
    number = lax.broadcasted_iota(jnp.int32, bits.shape, bits.ndim - 1)
    return jnp.sum(jnp.where(bits, 1 << number, 0), -1, dtype=jnp.int32)


def masks(bits: Array) -> Array:
    """Return booleans (n,) as the bits of integers (⌈n/32⌉,)."""
    return mask(jnp.pad(bits, (0, -bits.size % WORD)).reshape(-1, WORD))


def leading(n: Array, words: int) -> Array:
    """Return integers (words,) of whose bits the first n are set."""
    own = jnp.clip(n - WORD * jnp.arange(words, dtype=jnp.int32), 0, WORD)
    return jnp.where(own < WORD, (1 << jnp.minimum(own, WORD - 1)) - 1, -1)


def each(one: Callable[..., tuple[Any, ...]], bits: Array, *found: Any) -> tuple[Any, ...]:
    """Return what is found after one(number, *found) for each bit that is set."""

    def body(state: tuple[Any, ...]) -> tuple[Any, ...]:
        bits, *found = state
        return bits & (bits - 1), *one(31 - lax.clz(bits & -bits), *found)

    return lax.while_loop(lambda state: state[0] != 0, body, (bits, *found))[1:]


def each_of(one: Callable[..., tuple[Any, ...]], words: Array, *found: Any) -> tuple[Any, ...]:
    """Return what is found after one(number, *found) for each bit of several integers that is set, in order."""

    def of_word(w: Array, found: tuple[Any, ...]) -> tuple[Any, ...]:
        return each(lambda bit, *found: one(WORD * w + bit, *found), words[w], *found)

    return lax.fori_loop(0, words.size, of_word, found)
