"""Möller and Trumbore's test of a ray and a triangle: fewer operations, but rays leak through edges."""

import jax.numpy as jnp
from jax import Array

from jaxrt.core.maths import FAR
from jaxrt.shapes.edges import Corner


def hit_distance(corners: list[Corner]) -> Array:
    """Return the distance to the face, FAR if missed; corners as in `jaxrt.shapes.edges.hit_distance`.

    Möller and Trumbore, "Fast, minimum storage ray/triangle intersection", JGT 2(1), 1997, with the ray along +z.
    """
    (x0, y0, z0, *_), (x1, y1, z1, *_), (x2, y2, z2, *_) = corners
    ax, ay, bx, by = x1 - x0, y1 - y0, x2 - x0, y2 - y0
    det = ax * by - ay * bx
    inverse = 1 / jnp.where(det == 0, 1, det)
    beta, gamma = (y0 * bx - x0 * by) * inverse, (x0 * ay - y0 * ax) * inverse
    t = z0 + beta * (z1 - z0) + gamma * (z2 - z0)
    return jnp.where((det != 0) & (beta >= 0) & (gamma >= 0) & (beta + gamma <= 1) & (t > 0), t, FAR)


def hit_distance_undivided(corners: list[Corner]) -> Array:
    """Return the same with its one division at the end, where it costs least: the fairest form to compare with."""
    (x0, y0, z0, *_), (x1, y1, z1, *_), (x2, y2, z2, *_) = corners
    ax, ay, bx, by = x1 - x0, y1 - y0, x2 - x0, y2 - y0
    det = ax * by - ay * bx
    size, side = jnp.abs(det), jnp.where(det < 0, -1, 1).astype(x0.dtype)
    beta, gamma = side * (y0 * bx - x0 * by), side * (x0 * ay - y0 * ax)
    depth = size * z0 + beta * (z1 - z0) + gamma * (z2 - z0)
    hit = (size > 0) & (beta >= 0) & (gamma >= 0) & (beta + gamma <= size) & (depth > 0)
    return jnp.where(hit, depth, FAR) / jnp.where(hit, size, 1)
