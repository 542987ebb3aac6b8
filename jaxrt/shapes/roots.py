"""Where a ray meets a sphere, right for walls of radius 1e6 and for small far balls: plain arithmetic on any shape.

With f = o − c and b = f·d, the roots of t² + 2bt + (f·f − r²) = 0 lose their digits in two places, and each has two
forms of which one is good.

* The power f·f − r² of the origin cancels when a huge sphere passes close by. With k = c·c − r² rounded once
  (`exact_power`), o·(o − 2c) + k is as exact as the coordinates themselves. Spheres with r > |c|/2 use it: for any
  point p on such a sphere its rounding error exceeds that of the usual form by a small factor at most, and by 1/r near
  the origin it is far below. Others use f·f − r².
* The discriminant is b² − power near the sphere, and r² − |f − b d|² far from it (Haines et al., Ray Tracing Gems
  2019, ch. 7), where b² would cancel.

The smaller root comes from the larger one by t₁t₂ = power.

Points are read by coordinate, so that a loop over spheres may keep those of many rays apart: of rays that lie point by
point it would shuffle the numbers at each sphere anew, which takes as long as the rest.
"""

from collections.abc import Sequence

import jax.numpy as jnp
from jax import Array

from jaxrt.core.maths import FAR, dot

Point = Array | Sequence[Array]  # (3,), or its coordinates
Sphere = tuple[Point, Array, Point, Point, Array]  # center, radius, base, shift, constant


def power_of(row: Sphere, p: Point) -> Array:
    """Return |p − c|² − r² of a point p, in the form that is exact for this sphere."""
    center, _, base, shift, constant = row
    return dot(_minus(p, base), _minus(_minus(p, center), shift)) + constant


def roots_of(row: Sphere, origin: Point, direction: Point) -> tuple[Array, Array, Array]:
    """Return (b, power, discriminant) of the quadratic for the distance along a ray."""
    radius = row[1]
    f = _minus(origin, row[0])
    b = dot(f, direction)
    power = power_of(row, origin)
    away = _minus(f, [b * x for x in direction])
    near = b * b < radius * radius
    return b, power, jnp.where(near, b * b - power, radius * radius - dot(away, away))


def root_distance(row: Sphere, origin: Point, direction: Point) -> Array:
    """Return the smallest positive distance to the sphere, FAR if there is none. No derivative is taken of it."""
    return smallest(*roots_of(row, origin, direction))


def smallest(b: Array, power: Array, discriminant: Array) -> Array:
    """Return the smallest positive root, of what `roots_of` finds; FAR if there is none."""
    larger = jnp.abs(b) + jnp.sqrt(jnp.maximum(discriminant, 0))
    hit = (discriminant > 0) & ((power < 0) | (b < 0))
    chord_ahead = (power < 0) & (b < 0)
    return jnp.where(hit, jnp.where(chord_ahead, larger, jnp.abs(power) / larger), FAR)


def _minus(a: Point, b: Point) -> list[Array]:
    return [x - y for x, y in zip(a, b, strict=True)]
