"""A Gaussian, cut off at three standard deviations."""

import math

import jax.numpy as jnp
from jax import Array, lax

SIGMAS = 6.0  # standard deviations from end to end
WITHIN = math.erf(SIGMAS / 2 / math.sqrt(2))  # share of the whole Gaussian


def place(u: Array) -> Array:
    """Return the place in [-½, ½] that a number in [0, 1) is drawn to."""
    x = lax.erf_inv(WITHIN * (2 * u - 1)) * (math.sqrt(2) / SIGMAS)
    return jnp.clip(x, -0.5, 0.5)


def weight(x: Array) -> Array:
    """Return the density there, 0 beyond the ends."""
    density = jnp.exp(-0.5 * (SIGMAS * x) ** 2) * (SIGMAS / (math.sqrt(2 * math.pi) * WITHIN))
    return jnp.where(jnp.abs(x) <= 0.5, density, 0)
