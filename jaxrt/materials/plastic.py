"""Plastic: colour under a coat of rough dielectric, whose facets are those of `conductor`.

Light that enters is scattered evenly beneath, and leaves or is thrown back into it by the coat's inner side, any number
of times (Saunderson 1942); both passages are refracted as by a smooth coat.
"""

import math
from typing import Annotated

import jax.numpy as jnp
from jax import Array, lax

from jaxrt.core.maths import dot, normalize, reflect, safe_divide
from jaxrt.core.records import SurfacePoint
from jaxrt.core.sampling import sample_cosine_hemisphere
from jaxrt.description.fields import Albedo, Fraction, Ior
from jaxrt.description.kinds import material
from jaxrt.description.values import require
from jaxrt.materials.conductor import ROUGH, SMOOTHEST, facets, visible_normal
from jaxrt.materials.glass import fresnel

THINNEST = 1.05  # ior: of less, the coat's mean reflectance loses its digits


@material
class Plastic:
    """A colour under a coat; `ior` is the coat's over what is outside."""

    albedo: Albedo
    roughness: Annotated[Fraction, require(lambda x: x >= SMOOTHEST, ROUGH)] = 0.3
    ior: Annotated[Ior, require(lambda x: x >= THINNEST, f"is below {THINNEST}: use the type diffuse")] = 1.5

    def sample(self, surface: SurfacePoint, wo: Array, u: tuple[Array, Array]) -> tuple[Array, Array]:
        """Return (direction, weight): off a facet of the coat, or from beneath it."""
        roughness, ior = self.kept()
        normal = surface.facing(wo)
        coat = self.coat(dot(normal, wo), ior)
        held = lax.stop_gradient(coat)
        first = u[0] < held
        stretched = jnp.where(first, safe_divide(u[0], held), (u[0] - held) / (1 - held)), u[1]
        facet = visible_normal(roughness * roughness, normal, wo, stretched)
        wi = jnp.where(first, reflect(wo, facet), sample_cosine_hemisphere(normal, stretched))
        value, pdf = self.evaluate(surface, wo, wi)
        # The choice is held; its probability is differentiated
        share = jnp.where(first, safe_divide(coat, held), (1 - coat) / (1 - held))
        return wi, safe_divide(value * share, pdf * jnp.ones_like(value))

    def evaluate(self, surface: SurfacePoint, wo: Array, wi: Array) -> tuple[Array, Array]:
        """Return (f cosθ, pdf) of a direction."""
        roughness, ior = self.kept()
        normal = surface.facing(wo)
        cos_o, cos_i = dot(normal, wo), jnp.maximum(dot(normal, wi), 0)
        half = normalize(wo + wi)
        single, density = facets(roughness * roughness, normal, half, cos_o, cos_i)
        reflected = fresnel(jnp.maximum(dot(half, wo), 0), ior)[0] * single
        passed = (1 - fresnel(cos_o, ior)[0]) * (1 - fresnel(cos_i, ior)[0])
        inner = 1 - (1 - mean_fresnel(ior)) / (ior * ior)  # what the coat throws back into the colour
        beneath = self.albedo / (1 - self.albedo * inner) * (passed / (ior * ior) * cos_i / math.pi)
        coat = self.coat(cos_o, ior)
        return reflected + beneath, coat * density + (1 - coat) * cos_i / math.pi

    def coat(self, cos: Array, ior: Array) -> Array:
        """Return the probability with which the coat's reflection is taken: about its share of what is reflected."""
        reflected = fresnel(cos, ior)[0]
        return reflected / (reflected + (1 - reflected) * jnp.mean(self.albedo) + 1e-3)

    def kept(self) -> tuple[Array, Array]:
        """Return roughness and ior, no less than there may be: fits step beyond."""
        return jnp.maximum(self.roughness, SMOOTHEST), jnp.maximum(self.ior, THINNEST)


def mean_fresnel(ior: Array) -> Array:
    """Return Fresnel's reflectance of light from everywhere, weighed by the cosine (Walsh 1926). ior: () > 1."""
    n, square = ior, ior * ior
    difference, total = square - 1, square + 1
    return (
        0.5
        + (n - 1) * (3 * n + 1) / (6 * (n + 1) ** 2)
        + square * difference**2 / total**3 * jnp.log((n - 1) / (n + 1))
        - 2 * n**3 * (square + 2 * n - 1) / (total * (square**2 - 1))
        + 8 * square**2 * (square**2 + 1) / (total * (square**2 - 1) ** 2) * jnp.log(n)
    )
