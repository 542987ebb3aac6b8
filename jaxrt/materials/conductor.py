"""Rough metal: facets that reflect once and more.

Fresnel's reflectance is Schlick's (1994). What one reflection loses between the facets comes back by the lobe of Kulla
and Conty (2017).
"""

import math
from typing import Annotated

import jax.numpy as jnp
from jax import Array

from jaxrt.core.maths import safe_sqrt
from jaxrt.description.fields import Albedo, Fraction
from jaxrt.description.kinds import material
from jaxrt.materials.directional import lost, mean_lost
from jaxrt.materials.facets import SMOOTHEST, Faceted, Local, facets, pick, rough, turned


@material
class Conductor(Faceted):
    """A rough metal; `albedo` is what it reflects of light along the normal."""

    albedo: Albedo
    roughness: Annotated[Fraction, rough("mirror")] = 0.3

    def turn(self, o: Local, u: tuple[Array, Array]) -> tuple[Local, Array]:
        """Return a direction off a facet that is seen, or else of the lobe of more reflections."""
        roughness = self.kept()
        first, left, share = pick(1 - lost(roughness, o[2])[0], u[0])
        return turned(roughness * roughness, o, first, (left, u[1])), share

    def parts(self, o: Local, i: Local) -> tuple[Array, Array]:
        """Return (f cosθ, pdf) of a direction."""
        roughness, above = self.kept(), jnp.maximum(i[2], 0)
        once, density, cos = off_facets(roughness, o, i)
        loss, more = more_than_once(self.albedo, roughness, o[2], above)
        return schlick(self.albedo, cos) * once + more, (1 - loss) * density + loss * above / math.pi

    def kept(self) -> Array:
        """Return the roughness, no less than there may be: fits step beyond."""
        return jnp.maximum(self.roughness, SMOOTHEST)


def off_facets(roughness: Array, o: Local, i: Local) -> tuple[Array, Array, Array]:
    """Return f cosθ of one reflection without Fresnel's factor, its density, and the cosine at which facets meet it."""
    h = o[0] + i[0], o[1] + i[1], o[2] + i[2]
    once, density, squared = facets(roughness * roughness, h, o[2], jnp.maximum(i[2], 0))
    return once, jnp.where(h[2] > 0, density, 0), safe_sqrt(squared) / 2


def more_than_once(albedo: Array, roughness: Array, cos_o: Array, cos_i: Array) -> tuple[Array, Array]:
    """Return the share of light from `o` that is not reflected once, and f cosθ (3,) of what reflects it more often."""
    (loss, back), mean = lost(roughness, cos_o, cos_i), mean_lost(roughness)
    tint = albedo + (1 - albedo) / 21  # Schlick's reflectance, averaged
    tint = tint * tint / (1 - tint * mean)
    return loss, tint * (loss * back * cos_i * (1 - mean) / (math.pi * mean))


def schlick(albedo: Array, cos: Array) -> Array:
    """Return the reflectance at an angle of that cosine of what reflects `albedo` along the normal (Schlick 1994)."""
    rest = jnp.maximum(1 - cos, 0)
    return albedo + (1 - albedo) * (rest * rest * rest * rest * rest)
