"""Pictures: each place takes from the four texels around it, more from the nearer."""

import jax.numpy as jnp
from jax import Array, lax


def taps(uv: Array, size: tuple[Array, Array], clamp: Array) -> list[tuple[Array, Array]]:
    """Return four rows (), of a picture's texels one after another, each with its weight: bilinear interpolation.

    uv: (2,), of which (0, 0) is the picture's lower left corner. size: rows and columns. clamp: () whether the border's
    texels go on beyond, where otherwise the picture begins anew.
    """
    height, width = size
    within = jnp.where(clamp, jnp.clip(uv, 0, 1), uv - lax.stop_gradient(jnp.floor(uv)))
    columns = _two(within[0] * width.astype(uv.dtype), width, clamp)
    lines = _two((1 - within[1]) * height.astype(uv.dtype), height, clamp)
    return [(line * width + column, a * b) for line, a in lines for column, b in columns]


def _two(place: Array, count: Array, clamp: Array) -> list[tuple[Array, Array]]:
    """Return the two texels of a line of `count` whose middles are around a place, each with its share."""
    place = place - 0.5
    floor = lax.stop_gradient(jnp.floor(place))
    first, share = floor.astype(jnp.int32), place - floor
    before, beyond = jnp.where(clamp, 0, count - 1), jnp.where(clamp, count - 1, 0)
    second = jnp.where(first + 1 < count, first + 1, beyond)
    return [(jnp.where(first < 0, before, first), 1 - share), (second, share)]
