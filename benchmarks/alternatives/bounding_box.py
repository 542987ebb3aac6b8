"""One box around all triangles: the first remedy against brute force, and no more than that.

A packet of rays that all miss the box tests no triangle; one ray that meets it makes them test all.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array, lax

from jaxrt.core.records import Ray
from jaxrt.shapes.triangle import TriangleTable, find_triangle, occluded_by_triangle

TINY = 1e-20  # least size of a direction component, for its reciprocal alone


class Box(NamedTuple):
    """A box, fixed before the kernel is compiled."""

    low: tuple[float, ...]
    high: tuple[float, ...]


def find_in_box(box: Box, table: TriangleTable, ray: Ray, farthest: Array) -> tuple[Array, Array]:
    """Return what `find_triangle` returns."""
    nothing = farthest, jnp.int32(-1)

    # A loop of no turn or one: for many rays at once a condition would compute both its branches. It reads what it
    # carries, or the compiler would search before the loop
    def search(_: Array, best: tuple[Array, Array]) -> tuple[Array, Array]:
        return find_triangle(table, ray, best[0])

    return lax.fori_loop(0, _meets(box, ray, farthest), search, nothing)


def occluded_in_box(box: Box, table: TriangleTable, ray: Ray, farthest: Array) -> Array:
    """Return what `occluded_by_triangle` returns."""

    def search(_: Array, blocked: Array) -> Array:
        return occluded_by_triangle(table, ray, jnp.where(blocked, 0, farthest))

    return lax.fori_loop(0, _meets(box, ray, farthest), search, jnp.zeros((), bool))


def _meets(box: Box, ray: Ray, farthest: Array) -> Array:
    """Return 1 where the ray meets the box nearer than `farthest`, else 0 (slab test)."""
    enter, leave = jnp.zeros_like(farthest), farthest
    for axis in range(3):
        d, o = ray.direction[axis], ray.origin[axis]
        slope = 1 / jnp.where(jnp.abs(d) < TINY, TINY, d)
        a, b = (box.low[axis] - o) * slope, (box.high[axis] - o) * slope
        enter, leave = jnp.maximum(enter, jnp.minimum(a, b)), jnp.minimum(leave, jnp.maximum(a, b))
    return (enter <= leave).astype(jnp.int32)
