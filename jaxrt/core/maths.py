"""Vectors, safe roots and quotients, compensated sums: the only place with guards against 0/0 and √0."""

from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from numpy.typing import NDArray

Number = TypeVar("Number", Array, NDArray[np.float64])
Parts = tuple[Array, Array, Array]  # a sum in three parts, each about a rounding error of the one before

FAR = 1e30  # distance of a ray that hits nothing: finite, so that masked arithmetic never makes a NaN (stability of AD)


def unit_roundoff(x: Array) -> float:
    """Return u, half the distance from 1 to the next number of x's dtype: 2⁻²⁴ for float32."""
    return float(jnp.finfo(x.dtype).eps) / 2


def dot(a: Array, b: Array) -> Array:
    """Return a·b of two (3,) vectors. Written out: a matrix product may run in reduced precision on accelerators."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Array, b: Array) -> Array:
    """Return a×b of two (3,) vectors."""
    return jnp.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def safe_sqrt(x: Array) -> Array:
    """Return √max(x, 0) with derivative 0, instead of infinity or NaN, where x <= 0."""
    positive = x > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, x, 1)), 0)


def safe_divide(a: Array, b: Array) -> Array:
    """Return a/b, and 0 with derivative 0 where b == 0."""
    nonzero = b != 0
    return jnp.where(nonzero, a / jnp.where(nonzero, b, 1), 0)


def normalize(v: Array) -> Array:
    """Return v/|v| of a (3,) vector, also where |v|² would under- or overflow; 0 for v = 0."""
    # Scaling by the largest component cancels in the quotient, so it needs no derivative
    largest = lax.stop_gradient(jnp.max(jnp.abs(v)))
    nonzero = largest > 0
    w = v / jnp.where(nonzero, largest, 1)
    return w * jnp.where(nonzero, lax.rsqrt(jnp.where(nonzero, dot(w, w), 1)), 1)


def sign_or_one(x: Array) -> Array:
    """Return -1 where x < 0 and 1 elsewhere: never the 0 that `jnp.sign` gives, which would erase a normal."""
    return jnp.where(x < 0, -1, 1).astype(x.dtype)


@jax.custom_jvp
def grad_only(x: Array) -> Array:
    """Return 0 with the derivative of x: adds a derivative to an expression without touching its value."""
    return jnp.zeros_like(x)


@grad_only.defjvp
def _grad_only_jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    return jnp.zeros_like(primals[0]), tangents[0]


def kahan_add(total: Array, compensation: Array, x: Array) -> tuple[Array, Array]:
    """Return (total, compensation) after adding x with Kahan's compensated summation (Kahan 1965).

    A plain float32 sum of ones stops at 16 777 216; this one is right to about 2u for 1/u² terms.
    """
    y = x - compensation
    t = total + y
    return t, (t - total) - y


def two_sum(a: Number, b: Number) -> tuple[Number, Number]:
    """Return a + b, rounded, and what the rounding left out, exactly (Knuth 1969)."""
    total = a + b
    share = total - a
    return total, (a - (total - share)) + (b - share)


def add_exactly(parts: Parts, x: Array) -> Parts:
    """Return parts whose sum is that of `parts` and x: exact while the terms lie within 72 bits (float32).

    So the sum does not depend on the order of the terms, nor on how they are divided into partial sums.
    """
    high, rest = two_sum(parts[0], x)
    middle, rest = two_sum(parts[1], rest)
    return high, middle, parts[2] + rest


def rounded(parts: Parts) -> Array:
    """Return the number nearest to the sum of the parts."""
    return parts[0] + (parts[1] + parts[2])


def face_forward(normal: Array, wo: Array) -> Array:
    """Return the normal, turned to the side that `wo` points to."""
    return jnp.where(dot(normal, wo) < 0, -normal, normal)


def reflect(wo: Array, normal: Array) -> Array:
    """Return the mirror direction of `wo`, both pointing away from the surface; either sign of the normal."""
    return 2 * dot(wo, normal) * normal - wo
