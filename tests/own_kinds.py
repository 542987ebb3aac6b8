"""Kinds that jaxrt does not have, for tests: a Lambertian surface that is not told to be one, and a glossy one."""

import math

import jax.numpy as jnp

from jaxrt.kinds import (
    Albedo,
    Positive,
    around,
    dot,
    material,
    numbers_of_direction,
    pdf_cosine_hemisphere,
    reflect,
    safe_sqrt,
    sample_cosine_hemisphere,
)


@material
class Chalk:
    """As diffuse, by its own `evaluate`."""

    albedo: Albedo

    def sample(self, surface, wo, u):
        return sample_cosine_hemisphere(surface.facing(wo), u), self.albedo

    def evaluate(self, surface, wo, wi):
        cos = jnp.maximum(dot(surface.facing(wo), wi), 0)
        return self.albedo * (cos / math.pi), pdf_cosine_hemisphere(cos)

    def numbers_toward(self, surface, wo, wi, coin):
        return numbers_of_direction(surface.facing(wo), wi)


@material
class Phong:
    """A lobe about the mirror direction, f = albedo (n + 2)/2π cosⁿα (Lafortune & Willems 1994)."""

    albedo: Albedo
    exponent: Positive = 20.0

    def sample(self, surface, wo, u):
        facing = surface.facing(wo)
        axis = reflect(wo, facing)
        cos = u[1] ** (1 / (self.exponent + 1))
        wi = around(axis, safe_sqrt(1 - cos * cos), cos, u[0])
        return wi, self.albedo * ((self.exponent + 2) / (self.exponent + 1) * jnp.maximum(dot(facing, wi), 0))

    def evaluate(self, surface, wo, wi):
        facing = surface.facing(wo)
        cos = jnp.maximum(dot(facing, wi), 0)
        lobe = jnp.maximum(dot(reflect(wo, facing), wi), 0) ** self.exponent / (2 * math.pi)
        return self.albedo * ((self.exponent + 2) * lobe * cos), (self.exponent + 1) * lobe
