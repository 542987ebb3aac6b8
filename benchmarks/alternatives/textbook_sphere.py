"""The quadratic of a ray and a sphere as textbooks have it: fine for spheres of the scene's own size, no others."""

import jax.numpy as jnp
from jax import Array

from jaxrt.core.maths import FAR, dot, safe_sqrt
from jaxrt.core.records import Ray
from jaxrt.shapes.roots import Point, Sphere


def _half_roots(row: Sphere, origin: Point, direction: Point) -> tuple[Array, Array]:
    """Return (b, b² − (f·f − r²)) of t² + 2bt + f·f − r² = 0, f = o − c."""
    f = [o - c for o, c in zip(origin, row[0], strict=True)]
    b = dot(f, direction)
    return b, b * b - (dot(f, f) - row[1] * row[1])


def distance(row: Sphere, origin: Point, direction: Point) -> Array:
    """Return the smallest positive distance to the sphere, FAR if there is none."""
    b, discriminant = _half_roots(row, origin, direction)
    root = jnp.sqrt(jnp.maximum(discriminant, 0))
    near, far = -b - root, root - b
    return jnp.where(discriminant < 0, FAR, jnp.where(near > 0, near, jnp.where(far > 0, far, FAR)))


def distance_to_surface(row: Sphere, ray: Ray) -> Array:
    """Return the same, differentiable, and finite where the ray misses."""
    b, discriminant = _half_roots(row, ray.origin, ray.direction)
    root = safe_sqrt(discriminant)
    return jnp.where(-b - root > 0, -b - root, root - b)


def stay(row: Sphere, p: Array) -> Array:
    """Return p as it is: o + t d is where the ray has met the sphere."""
    return p
