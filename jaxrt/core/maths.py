"""Vectors, safe roots and quotients, rotations, compensated sums: the only place with guards against 0/0 and √0."""

import math
from collections.abc import Sequence
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.typing import ArrayLike
from numpy.typing import NDArray

Number = TypeVar("Number", Array, NDArray[np.float64])
Parts = tuple[Array, Array, Array]  # a sum in three parts, each about a rounding error of the one before

TERMS = 9  # of series up to an angle of 1: the next is below the rounding of float64
FAR = 1e30  # distance of a ray that hits nothing: finite, so that masked arithmetic never makes a NaN (stability of AD)


def unit_roundoff(x: Array) -> float:
    """Return u, half the distance from 1 to the next number of x's dtype: 2⁻²⁴ for float32."""
    return float(jnp.finfo(x.dtype).eps) / 2


def dot(a: Array | Sequence[Array], b: Array | Sequence[Array]) -> Array:
    """Return a·b of two (3,) vectors, or of their coordinates.

    Written out: a matrix product may run in reduced precision on accelerators.
    """
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


def rigid(vertices: ArrayLike, rotvec: ArrayLike, shift: ArrayLike) -> Array:
    """Return vertices (…, 3), turned about the origin by |rotvec| radians about rotvec (3,), then moved by shift (3,).

    Exact where rotvec is 0, and smooth everywhere, at 0 too (Rodrigues 1840).
    """
    points = jnp.asarray(vertices)
    matrix = turn_less_one(jnp.asarray(rotvec, points.dtype))
    turned = points + turned_by(jnp.broadcast_to(matrix, (*points.shape, 3)), points)
    return turned + jnp.broadcast_to(jnp.asarray(shift, points.dtype), points.shape)


def turn_less_one(vector: Array) -> Array:
    """Return R − 1 (…, 3, 3) of rotation vectors (…, 3) in radians: what a turn adds to a point, exactly 0 for none."""
    x, y, z = jnp.moveaxis(vector, -1, 0)
    nothing = jnp.zeros_like(x)
    rows = (nothing, -z, y), (z, nothing, -x), (-y, x, nothing)
    axis = jnp.stack([jnp.stack(row, -1) for row in rows], -2)
    squared = x * x + y * y + z * z
    sine, versine = (factor[..., None, None] for factor in _coefficients(squared))
    one = jnp.broadcast_to(jnp.eye(3, dtype=vector.dtype), axis.shape)
    return sine * axis + versine * (vector[..., :, None] * vector[..., None, :] - squared[..., None, None] * one)


def turned_by(matrix: Array, points: Array) -> Array:
    """Return matrices (…, 3, 3) times points (…, 3), written out: products may have reduced precision elsewhere."""
    return jnp.sum(matrix * points[..., None, :], -1)


def _coefficients(squared: Array) -> tuple[Array, Array]:
    """Return sin θ/θ and (1 − cos θ)/θ² of θ², by their series in θ² up to θ = 1."""
    small = squared < 1
    near, angle = jnp.where(small, squared, 0), jnp.sqrt(jnp.where(small, 1, squared))
    half = jnp.sin(angle / 2) / angle
    sine = jnp.where(small, _series(near, 1), jnp.sin(angle) / angle)
    return sine, jnp.where(small, _series(near, 2), 2 * half * half)


def _series(x: Array, first: int) -> Array:
    """Return Σ (−x)ᵏ/(2k + first)!."""
    total = jnp.zeros_like(x)
    for k in reversed(range(TERMS)):
        total = 1 / math.factorial(2 * k + first) - x * total
    return total
