"""Perfect mirror, two-sided."""

from jax import Array

from jaxrt.core.maths import dot
from jaxrt.core.pytree import pytree


@pytree
class Mirror:
    """The scene's mirror materials."""

    albedo: Array  # (n, 3) share of each channel that is reflected, in [0, 1]


def reflect(wo: Array, normal: Array) -> Array:
    """Return the mirror direction of `wo`, both pointing away from the surface; either sign of the normal."""
    return 2 * dot(wo, normal) * normal - wo


def sample_mirror(albedo: Array, wo: Array, normal: Array) -> tuple[Array, Array]:
    """Return (direction, weight) of the one direction a mirror has."""
    return reflect(wo, normal), albedo
