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
"""

import jax.numpy as jnp
from jax import Array

from jaxrt.core.maths import FAR, dot
from jaxrt.core.records import Ray

Row = tuple[Array, Array, Array, Array, Array]  # center, radius, base, shift, constant


def power_of(row: Row, p: Array) -> Array:
    """Return |p − c|² − r² of a point p, in the form that is exact for this sphere."""
    center, _, base, shift, constant = row
    return dot(p - base, p - center - shift) + constant


def roots_of(row: Row, ray: Ray) -> tuple[Array, Array, Array]:
    """Return (b, power, discriminant) of the quadratic for the distance along the ray."""
    radius = row[1]
    f = ray.origin - row[0]
    b = dot(f, ray.direction)
    power = power_of(row, ray.origin)
    away = f - b * ray.direction
    near = b * b < radius * radius
    return b, power, jnp.where(near, b * b - power, radius * radius - dot(away, away))


def root_distance(row: Row, ray: Ray) -> Array:
    """Return the smallest positive distance to the sphere, FAR if there is none. No derivative is taken of it."""
    b, power, discriminant = roots_of(row, ray)
    larger = jnp.abs(b) + jnp.sqrt(jnp.maximum(discriminant, 0))
    hit = (discriminant > 0) & ((power < 0) | (b < 0))
    chord_ahead = (power < 0) & (b < 0)
    return jnp.where(hit, jnp.where(chord_ahead, larger, jnp.abs(power) / larger), FAR)
