"""The quadratic of a ray and a sphere as textbooks have it: fine for spheres of the scene's own size, no others."""

import jax.numpy as jnp
from jax import Array

from jaxrt.core.maths import FAR, dot, safe_sqrt
from jaxrt.core.records import Ray
from jaxrt.shapes.roots import Row


def _half_roots(row: Row, ray: Ray) -> tuple[Array, Array]:
    """Return (b, b² − (f·f − r²)) of t² + 2bt + f·f − r² = 0, f = o − c."""
    f = ray.origin - row[0]
    b = dot(f, ray.direction)
    return b, b * b - (dot(f, f) - row[1] * row[1])


def distance(row: Row, ray: Ray) -> Array:
    """Return the smallest positive distance to the sphere, FAR if there is none."""
    b, discriminant = _half_roots(row, ray)
    root = jnp.sqrt(jnp.maximum(discriminant, 0))
    near, far = -b - root, root - b
    return jnp.where(discriminant < 0, FAR, jnp.where(near > 0, near, jnp.where(far > 0, far, FAR)))


def distance_to_surface(row: Row, ray: Ray) -> Array:
    """Return the same, differentiable, and finite where the ray misses."""
    b, discriminant = _half_roots(row, ray)
    root = safe_sqrt(discriminant)
    return jnp.where(-b - root > 0, -b - root, root - b)


def stay(row: Row, p: Array) -> Array:
    """Return p as it is: o + t d is where the ray has met the sphere."""
    return p
