"""Rough glass: facets that reflect or refract once (Walter, Marschner, Li & Torrance 2007).

Light that meets facets more than once is lost, and the more the rougher it is.
"""

from typing import Annotated

import jax.numpy as jnp
from jax import Array

from jaxrt.core.maths import safe_divide, safe_sqrt, sign_or_one
from jaxrt.core.records import SurfacePoint
from jaxrt.description.fields import Absorption, Fraction, Ior
from jaxrt.description.kinds import material
from jaxrt.description.values import require
from jaxrt.materials.facets import (
    SMOOTHEST,
    Faceted,
    Local,
    facets,
    inner,
    mirrored,
    numbers_of_normal,
    pick,
    picking,
    rough,
    visible_normal,
)
from jaxrt.materials.glass import fresnel

FAINTEST = 1.05  # ior, or its inverse: of less, facets hardly turn light, and scatter it to within one direction


@material
class RoughGlass(Faceted):
    """A rough dielectric; `ior` is inside over outside, `absorption` what is lost inside per unit of length."""

    ior: Annotated[
        Ior,
        require(lambda x: not 1 / FAINTEST < x < FAINTEST, f"is within {FAINTEST} of 1: use the type glass"),
    ]
    roughness: Annotated[Fraction, rough("glass")] = 0.3
    absorption: Absorption | None = None

    transmits = True

    def normal_at(self, surface: SurfacePoint, wo: Array) -> Array:
        """Return the outward normal: directions tell on which side they are."""
        return surface.shading

    def turn(self, o: Local, u: tuple[Array, Array]) -> tuple[Local, Array]:
        """Return a direction reflected or refracted by a facet that is seen."""
        alpha, eta, side, o = self.seen(o)
        first, left, share = pick(_chance(alpha, o, eta), u[0])
        facet = visible_normal(alpha, o, (left, u[1]))
        cos = inner(o, facet)
        squared = (cos * cos + (eta - 1) * (eta + 1)) / (eta * eta)
        along = cos / eta - safe_sqrt(squared)
        reflected, refracted = mirrored(o, facet), tuple(along * m - w / eta for m, w in zip(facet, o, strict=True))
        passes = ~first & (squared > 0)
        x, y, z = (jnp.where(passes, a, b) for a, b in zip(refracted, reflected, strict=True))
        # What is reflected wholly, or to the wrong side, is lost
        kept = jnp.where(first, z > 0, passes & (z < 0))
        return (x, y, side * z), jnp.where(kept, share, 0)

    def numbers(self, o: Local, i: Local, coin: Array) -> tuple[Array, Array]:
        """Return numbers for which light turns to `i`, of which there is but one pair."""
        alpha, eta, side, o = self.seen(o)
        i = (i[0], i[1], side * i[2])
        scale = jnp.where(i[2] < 0, eta, 1)
        h = o[0] + scale * i[0], o[1] + scale * i[1], o[2] + scale * i[2]
        up = sign_or_one(h[2])
        u0, u1 = numbers_of_normal(alpha, o, (up * h[0], up * h[1], up * h[2]))
        return picking(_chance(alpha, o, eta), i[2] >= 0, u0), u1

    def facts(self, o: Local, i: Local) -> tuple[tuple[Array, ...], Array]:
        """Return f cosθ, and the pdf; radiance that passes changes by the square of the index."""
        alpha, eta, side, o = self.seen(o)
        i = (i[0], i[1], side * i[2])
        passes = i[2] < 0
        scale = jnp.where(passes, eta, 1)
        h = o[0] + scale * i[0], o[1] + scale * i[1], o[2] + scale * i[2]
        single, density, squared = facets(alpha, h, o[2], jnp.abs(i[2]))
        up, length = sign_or_one(h[2]), safe_sqrt(squared)
        cos_o, cos_i = (up * safe_divide(inner(each, h), length) for each in (o, i))
        reflectance = fresnel(jnp.maximum(cos_o, 0), eta)[0]
        spread = jnp.where(passes, safe_divide(-4 * cos_o * cos_i, squared), 1)
        faced = (cos_o > 0) & (passes == (cos_i < 0))
        share, chance = reflectance, _chance(alpha, o, eta)
        share, chance = (jnp.where(passes, 1 - each, each) for each in (share, chance))
        value = jnp.where(faced, single * share * spread, 0)
        return (value,), jnp.where(faced, density * chance * spread * scale * scale, 0)

    def colour(self, *facts: Array) -> Array:
        """Return f cosθ (3,)."""
        return facts[0] * jnp.ones(3, facts[0].dtype)

    def seen(self, o: Local) -> tuple[Array, Array, Array, Local]:
        """Return α, the index of the far side over the near one, the side, and `o` as if from above it."""
        side = sign_or_one(o[2])
        ior = jnp.where(self.ior < 1, jnp.minimum(self.ior, 1 / FAINTEST), jnp.maximum(self.ior, FAINTEST))
        roughness = jnp.maximum(self.roughness, SMOOTHEST)
        eta = jnp.where(side > 0, ior, 1 / ior)
        return roughness * roughness, eta, side, (o[0], o[1], side * o[2])


def _chance(alpha: Array, o: Local, eta: Array) -> Array:
    """Return the probability with which reflection is taken: about its share, nearer to a half the rougher it is.

    Facets that are seen turn to the eye; beyond the critical angle many let light pass, before it many do not.
    """
    steep, flat = (fresnel(jnp.minimum(o[2] + turn * alpha, 1), eta)[0] for turn in (0.2, 1.5))
    unsure = 0.04 + 0.7 * alpha
    return (unsure + (1 - unsure) * (steep + flat)) / 2
