"""Rough metal: microfacets, once reflected and more.

Normals are distributed as by Trowbridge and Reitz (1975, "GGX") with α = roughness², masked and shadowed as by Smith in
Heitz's height-correlated form (2014), and drawn among those that are seen (Dupuy & Benyoub 2023). Fresnel's reflectance
is Schlick's (1994). What one reflection loses between the facets comes back by the lobe of Kulla and Conty (2017).
"""

import math
from typing import Annotated

import jax.numpy as jnp
from jax import Array, lax

from jaxrt.core.maths import dot, normalize, reflect, safe_divide, safe_sqrt
from jaxrt.core.records import SurfacePoint
from jaxrt.core.sampling import around, sample_cosine_hemisphere
from jaxrt.description.fields import Albedo, Fraction
from jaxrt.description.kinds import material
from jaxrt.description.values import require
from jaxrt.materials.directional import mean_albedo, reflected_once

SMOOTHEST = 0.05
ROUGH = f"is below {SMOOTHEST}: use {SMOOTHEST} or more, or the type mirror"


@material
class Conductor:
    """A rough metal; `albedo` is what it reflects of light along the normal."""

    albedo: Albedo
    roughness: Annotated[Fraction, require(lambda x: x >= SMOOTHEST, ROUGH)] = 0.3

    def sample(self, surface: SurfacePoint, wo: Array, u: tuple[Array, Array]) -> tuple[Array, Array]:
        """Return (direction, weight): off a facet that is seen, or else the lobe of more reflections."""
        roughness, normal = self.kept(), surface.facing(wo)
        once = reflected_once(roughness, dot(normal, wo))
        held = lax.stop_gradient(once)
        first = u[0] < held
        stretched = jnp.where(first, u[0] / held, safe_divide(u[0] - held, 1 - held)), u[1]
        facet = visible_normal(roughness * roughness, normal, wo, stretched)
        wi = jnp.where(first, reflect(wo, facet), sample_cosine_hemisphere(normal, stretched))
        value, pdf = self.evaluate(surface, wo, wi)
        # The choice is held; its probability is differentiated
        share = jnp.where(first, once / held, safe_divide(1 - once, 1 - held))
        return wi, safe_divide(value * share, pdf * jnp.ones_like(value))

    def evaluate(self, surface: SurfacePoint, wo: Array, wi: Array) -> tuple[Array, Array]:
        """Return (f cosθ, pdf) of a direction."""
        roughness, normal = self.kept(), surface.facing(wo)
        cos_o, cos_i = dot(normal, wo), dot(normal, wi)
        above = jnp.maximum(cos_i, 0)
        half = normalize(wo + wi)
        single, density = facets(roughness * roughness, normal, half, cos_o, above)
        fresnel = self.albedo + (1 - self.albedo) * jnp.maximum(1 - dot(half, wo), 0) ** 5
        once, back = reflected_once(roughness, cos_o), reflected_once(roughness, above)
        mean = mean_albedo(roughness)
        tint = self.albedo + (1 - self.albedo) / 21  # Schlick's reflectance, averaged
        tint = tint * tint * mean / (1 - tint * (1 - mean))
        more = safe_divide((1 - once) * (1 - back), math.pi * (1 - mean)) * above
        return fresnel * single + tint * more, once * density + (1 - once) * above / math.pi

    def kept(self) -> Array:
        """Return the roughness, no less than there may be: fits step beyond."""
        return jnp.maximum(self.roughness, SMOOTHEST)


def visible_normal(alpha: Array, normal: Array, wo: Array, u: tuple[Array, Array]) -> Array:
    """Return the normal of a facet that `wo` sees: on a cap of the hemisphere that facets are stretched to."""
    cos = dot(normal, wo)
    stretched = normalize(alpha * (wo - cos * normal) + cos * normal)
    height = 1 - u[1] * (1 + dot(normal, stretched))
    cap = around(normal, safe_sqrt(1 - height * height), height, u[0]) + stretched
    above = dot(normal, cap)
    return normalize(alpha * (cap - above * normal) + above * normal)


def facets(alpha: Array, normal: Array, half: Array, cos_o: Array, cos_i: Array) -> tuple[Array, Array]:
    """Return f cosθ without Fresnel's factor, and the density of `visible_normal`'s reflections.

    half: (3,) unit, between both directions.
    """
    squared, upright = alpha * alpha, dot(normal, half)
    across = half - upright * normal  # 1 − cos² would lose what small angles are
    spread = squared * upright * upright + dot(across, across)
    distribution = jnp.where(upright > 0, safe_divide(squared, math.pi * spread * spread), 0)
    far_o, far_i = (safe_sqrt(squared + (1 - squared) * cos * cos) for cos in (cos_o, cos_i))
    value = safe_divide(distribution * cos_i, 2 * (cos_o * far_i + cos_i * far_o))
    return value, safe_divide(distribution, 2 * (cos_o + far_o))
