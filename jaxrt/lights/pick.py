"""Which light a sample looks at: chosen by power."""

import jax.numpy as jnp
from jax import Array, lax

from jaxrt.core.maths import unit_roundoff


def shares_of(power: Array) -> Array | None:
    """Return the cumulative shares (n,) of lights of such powers (n,); None where there is one. No derivative.

    Equal where all are dark.
    """
    return None if power.shape[0] == 1 else jnp.cumsum(share_by_power(power)).at[-1].set(1)


def share_by_power(power: Array) -> Array:
    """Return the shares (n,) of lights of such powers (n,). No derivative."""
    power = lax.stop_gradient(power)
    power = jnp.where(jnp.sum(power) > 0, power, 1)
    # A light of no power keeps a small chance, so that its intensity has a derivative
    return 0.99 * power / jnp.sum(power) + 0.01 / power.shape[0]


def pick(shares: Array | None, u: Array) -> tuple[Array, Array, Array]:
    """Return (light, its probability, the number u made uniform again)."""
    if shares is None:
        return jnp.int32(0), jnp.ones_like(u), u
    cumulative = shares.astype(u.dtype)
    light = jnp.minimum(jnp.sum(u >= cumulative).astype(jnp.int32), cumulative.shape[0] - 1)
    below = jnp.where(light > 0, cumulative[jnp.maximum(light - 1, 0)], 0)
    share = cumulative[light] - below
    return light, share, jnp.clip((u - below) / share, 0, 1 - 2 * unit_roundoff(u))
