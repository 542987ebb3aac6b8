"""Rough metal: facets that reflect once and more.

Fresnel's reflectance is Schlick's (1994), or that of a measured complex index. What one reflection loses between the
facets comes back by the lobe of Kulla and Conty (2017).
"""

import math
from typing import Annotated

import jax.numpy as jnp
from jax import Array

from jaxrt.core.maths import safe_divide, safe_sqrt
from jaxrt.description.fields import Albedo, Flag, Fraction, Rgb
from jaxrt.description.kinds import material
from jaxrt.materials.directional import lost, mean_lost
from jaxrt.materials.facets import SMOOTHEST, Local, facets, rough
from jaxrt.materials.lobes import TwoLobed
from jaxrt.materials.metals import Named


@material
class Conductor(TwoLobed):
    """A rough metal; `albedo` is what it reflects of light along the normal, or the factor of a measured one's."""

    albedo: Albedo = (1.0, 1.0, 1.0)
    roughness: Annotated[Fraction, rough("mirror")] = 0.3
    compensation: Flag = True
    eta: Rgb | None = None
    k: Rgb | None = None

    Table = Named

    def lobes(self, o: Local) -> tuple[Array, Array]:
        """Return the roughness, and the probability of one reflection; else there are more."""
        roughness = self.kept()
        return roughness, 1 - self.compensation * lost(roughness, o[2])[0]

    def facts(self, o: Local, i: Local) -> tuple[tuple[Array, ...], Array]:
        """Return f cosθ of one reflection and of more, without colour, and what this depends on; and the pdf."""
        roughness, above = self.kept(), jnp.maximum(i[2], 0)
        single, density, cos = off_facets(roughness, o, i)
        loss, mean, more = losses(roughness, o[2], above)
        loss = self.compensation * loss
        return (single, cos, mean, more), (1 - loss) * density + loss * above / math.pi

    def colour(self, *facts: Array) -> Array:
        """Return f cosθ (3,)."""
        single, cos, mean, more = facts
        straight, coat = self.albedo, schlick(self.albedo, cos)
        if self.eta is not None and self.k is not None:
            is_measured = self.eta > 0
            below, over = ((self.eta + sign) ** 2 + self.k * self.k for sign in (-1, 1))
            straight = jnp.where(is_measured, self.albedo * (below / over), straight)
            coat = jnp.where(is_measured, self.albedo * conducted(cos, self.eta, self.k), coat)
        return coat * single + self.compensation * more_than_once(straight, mean) * more

    def kept(self) -> Array:
        """Return the roughness, no less than there may be: fits step beyond."""
        return jnp.maximum(self.roughness, SMOOTHEST)


def off_facets(roughness: Array, o: Local, i: Local) -> tuple[Array, Array, Array]:
    """Return f cosθ of one reflection without Fresnel's factor, its density, and the cosine at which facets meet it."""
    h = o[0] + i[0], o[1] + i[1], o[2] + i[2]
    value, density, squared = facets(roughness * roughness, h, o[2], jnp.maximum(i[2], 0))
    return value, jnp.where(h[2] > 0, density, 0), safe_sqrt(squared) / 2


def losses(roughness: Array, cos_o: Array, cos_i: Array) -> tuple[Array, Array, Array]:
    """Return what one reflection loses of light from `o`, and on average, and f cosθ of all that without its colour."""
    (loss, back), mean = lost(roughness, cos_o, cos_i), mean_lost(roughness)
    return loss, mean, loss * back * cos_i * (1 - mean) / (math.pi * mean)


def more_than_once(albedo: Array, mean: Array) -> Array:
    """Return the colour (3,) of light that is reflected more than once. mean: share that one reflection loses."""
    tint = albedo + (1 - albedo) / 21  # Schlick's reflectance, averaged
    return tint * tint / (1 - tint * mean)


def conducted(cos: Array, eta: Array, k: Array) -> Array:
    """Return the reflectance (3,) of unpolarised light by a metal of index eta + ik (Born & Wolf 1999, §14.2)."""
    square, sin_squared = cos * cos, 1 - cos * cos
    real = eta * eta - k * k - sin_squared
    size = safe_sqrt(real * real + 4 * eta * eta * k * k)
    twice = cos * safe_sqrt(2 * (size + real))
    perpendicular = safe_divide(size + square - twice, size + square + twice)
    first, second = square * size + sin_squared * sin_squared, twice * sin_squared
    return perpendicular * (1 + safe_divide(first - second, first + second)) / 2


def schlick(albedo: Array, cos: Array) -> Array:
    """Return the reflectance at an angle of that cosine of what reflects `albedo` along the normal (Schlick 1994)."""
    rest = jnp.maximum(1 - cos, 0)
    return albedo + (1 - albedo) * (rest * rest * rest * rest * rest)
