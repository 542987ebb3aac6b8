"""Lambertian reflection, two-sided: f = albedo/π."""

from jax import Array

from jaxrt.core.pytree import pytree
from jaxrt.core.sampling import sample_cosine_hemisphere


@pytree
class Diffuse:
    """The scene's diffuse materials."""

    albedo: Array  # (n, 3) in [0, 1]


def sample_diffuse(albedo: Array, normal: Array, u: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return (direction, weight) about `normal`, the side that the ray came from; weight = f cosθ / pdf = albedo."""
    return sample_cosine_hemisphere(normal, u), albedo
