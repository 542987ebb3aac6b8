"""The nearest of a few shapes, and whether any is near: in a loop, or of a wide packet all shapes at the same time."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxrt.kernels.native import in_wide

Tests = Callable[[Array], list[tuple[Array, Array]]]  # of the turn of a loop: number and distance of some shapes


def nearest_of(turns: int, tests: Tests, farthest: Array) -> tuple[Array, Array]:
    """Return (distance, number) of the first of the nearest shapes, closer than `farthest`; that and −1 if none is."""

    def closer(turn: Array, best: tuple[Array, Array]) -> tuple[Array, Array]:
        for i, t in tests(turn):
            nearer = t < best[0]
            best = jnp.where(nearer, t, best[0]), jnp.where(nearer, i, best[1])
        return best

    if not in_wide():
        return lax.fori_loop(0, turns, closer, (farthest, jnp.int32(-1)))
    numbers, distances = _all(turns, tests)
    # As in the loop, what is no number is no hit
    distances = jnp.where(distances < farthest, distances, jnp.inf)
    nearest = jnp.min(distances)
    found = nearest < farthest
    return jnp.where(found, nearest, farthest), jnp.where(found, numbers[jnp.argmin(distances)], -1)


def any_of(turns: int, tests: Tests, farthest: Array, skip: Array | None = None) -> Array:
    """Return whether any shape but number `skip` is closer than `farthest`."""

    def near(i: Array, t: Array) -> Array:
        return t < farthest if skip is None else (t < farthest) & (i != skip)

    def blocks(turn: Array, blocked: Array) -> Array:
        for i, t in tests(turn):
            blocked = blocked | near(i, t)
        return blocked

    if not in_wide():
        return lax.fori_loop(0, turns, blocks, jnp.zeros((), bool))
    return jnp.any(near(*_all(turns, tests)))


def _all(turns: int, tests: Tests) -> tuple[Array, Array]:
    """Return numbers and distances (n,) of all shapes, in order."""
    found = jax.vmap(tests)(jnp.arange(turns, dtype=jnp.int32))
    numbers, distances = (jnp.stack(each, -1).ravel() for each in zip(*found, strict=True))
    return numbers, distances
