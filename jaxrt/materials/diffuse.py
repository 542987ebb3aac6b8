"""Lambertian reflection, two-sided: f = albedo/π."""

import math

import jax.numpy as jnp
from jax import Array

from jaxrt.core.maths import dot
from jaxrt.core.records import SurfacePoint
from jaxrt.core.sampling import pdf_cosine_hemisphere, sample_cosine_hemisphere
from jaxrt.description.fields import Albedo
from jaxrt.description.kinds import material


@material
class Diffuse:
    """A Lambertian surface."""

    albedo: Albedo

    is_lambertian = True

    def sample(self, surface: SurfacePoint, wo: Array, u: tuple[Array, Array]) -> tuple[Array, Array]:
        """Return (direction, weight) on the side that the ray came from; weight = f cosθ / pdf = albedo."""
        return sample_cosine_hemisphere(surface.facing(wo), u), self.albedo

    def evaluate(self, surface: SurfacePoint, wo: Array, wi: Array) -> tuple[Array, Array]:
        """Return (f cosθ, pdf) of a direction."""
        cos = jnp.maximum(dot(surface.facing(wo), wi), 0)
        return self.albedo * (cos / math.pi), pdf_cosine_hemisphere(cos)
