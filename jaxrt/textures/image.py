"""Pictures: each place takes from the four texels around it, more from the nearer."""

import jax.numpy as jnp
from jax import Array, lax


def taps(uv: Array, size: tuple[Array, Array], clamp: Array) -> tuple[Array, Array]:
    """Return rows (4,), of a picture's texels one after another, and weights (4,): bilinear interpolation.

    uv: (2,), of which (0, 0) is the picture's lower left corner. size: rows and columns. clamp: () whether the border's
    texels go on beyond, where otherwise the picture begins anew.
    """
    height, width = size
    within = jnp.where(clamp, jnp.clip(uv, 0, 1), uv - lax.stop_gradient(jnp.floor(uv)))
    columns, across = _two(within[0] * width.astype(uv.dtype), width, clamp)
    lines, down = _two((1 - within[1]) * height.astype(uv.dtype), height, clamp)
    rows = lines[:, None] * width + columns[None]
    return rows.ravel(), (down[:, None] * across[None]).ravel()


def _two(place: Array, count: Array, clamp: Array) -> tuple[Array, Array]:
    """Return the two texels (2,) of a line of `count` whose middles are around a place, and the share of each."""
    place = place - 0.5
    first = lax.stop_gradient(jnp.floor(place))
    share = place - first
    both = first.astype(jnp.int32) + jnp.arange(2, dtype=jnp.int32)
    before, beyond = jnp.where(clamp, 0, count - 1), jnp.where(clamp, count - 1, 0)
    return jnp.where(both < 0, before, jnp.where(both >= count, beyond, both)), jnp.stack([1 - share, share])
