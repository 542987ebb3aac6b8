"""Leaving a surface by a fixed distance: too little for large scenes, too much for small ones."""

from jax import Array

from jaxrt.core.maths import dot, sign_or_one
from jaxrt.core.records import Ray, SurfacePoint

EPSILON = 1e-4  # scene units, as many a renderer has it


def leave(point: SurfacePoint, direction: Array) -> Ray:
    """Return the ray from a surface point, its origin moved along the normal by the same amount in every scene."""
    return Ray(point.position + EPSILON * sign_or_one(dot(point.normal, direction)) * point.normal, direction)
