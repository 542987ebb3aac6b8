"""The window of Blackman and Harris, of four terms (Harris 1978)."""

import math

import jax.numpy as jnp
from jax import Array, lax

from jaxrt.core.sampling import sincos_2pi

TERMS = 0.35875, 0.48829, 0.14128, 0.01168
STEPS = 10  # of Newton's method: to 1e-6 of the density's whole


def place(u: Array) -> Array:
    """Return the place in [-½, ½] that a number in [0, 1) is drawn to."""
    wanted = u - 0.5

    def nearer(_: Array, x: Array) -> Array:
        return jnp.clip(x - (_below(x) - wanted) / _density(x), -0.5, 0.5)

    # From within: the density falls outwards, so that no step goes too far
    x: Array = lax.fori_loop(0, STEPS, nearer, TERMS[0] * wanted)
    return x


def weight(x: Array) -> Array:
    """Return the density there, 0 beyond the ends."""
    inside = jnp.abs(x) <= 0.5
    return jnp.where(inside, _density(jnp.where(inside, x, 0)), 0)


def _turn(x: Array) -> tuple[Array, Array]:
    cos, sin = sincos_2pi(x + 0.5)
    return -cos, -sin


def _density(x: Array) -> Array:
    a0, a1, a2, a3 = TERMS
    cos, _ = _turn(x)
    # Cosines of twice and thrice the angle
    return (a0 + a1 * cos + a2 * (2 * cos * cos - 1) + a3 * cos * (4 * cos * cos - 3)) / a0


def _below(x: Array) -> Array:
    """Return the share of the density between the middle and a place, negative to the left."""
    a0, a1, a2, a3 = TERMS
    cos, sin = _turn(x)
    return x + sin * (a1 + a2 * cos + a3 * (4 * cos * cos - 1) / 3) / (2 * math.pi * a0)
