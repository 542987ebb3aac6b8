"""Least and largest numbers in few instructions: none of these passes a NaN on, so there must be none."""

import jax.numpy as jnp
from jax import Array, lax


def least(a: Array, b: Array | float) -> Array:
    """Return the lesser: one instruction, where jnp.minimum takes three to pass a NaN on."""
    return jnp.where(a < b, a, b)


def most(a: Array, b: Array | float) -> Array:
    """Return the greater."""
    return jnp.where(a > b, a, b)


def bits(x: Array) -> Array:
    """Return non-negative floats as integers of the same order; negative floats become negative."""
    return lax.bitcast_convert_type(x, jnp.int32 if x.dtype == jnp.float32 else jnp.int64)


def floats(words: Array) -> Array:
    """Return the floats whose `bits` these are."""
    return lax.bitcast_convert_type(words, jnp.float32 if words.dtype == jnp.int32 else jnp.float64)


def smallest(v: Array) -> Array:
    """Return the least along the last axis. As integers, since a loop over floats is not vectorised."""
    return floats(_mirrored(jnp.min(_mirrored(bits(v)), -1)))


def largest(v: Array) -> Array:
    """Return the greatest along the last axis."""
    return floats(_mirrored(jnp.max(_mirrored(bits(v)), -1)))


def _mirrored(words: Array) -> Array:
    """Return integers in the order of the floats whose bits they are, negative ones too; its own inverse."""
    return words ^ ((words >> (8 * words.dtype.itemsize - 1)) & jnp.iinfo(words.dtype).max)


def least_of_eight(row: Array) -> Array:
    """Return the least of (8,) in three steps, one after the other, instead of seven."""
    half = least(row[:4], row[4:])
    quarter = least(half[:2], half[2:])
    return least(quarter[0], quarter[1])
