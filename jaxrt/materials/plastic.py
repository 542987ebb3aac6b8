"""Plastic: colour under a coat of rough dielectric, whose facets are those of `conductor`.

Light that enters is scattered evenly beneath, and leaves or is thrown back into it by the coat's inner side, any number
of times (Saunderson 1942); both passages are refracted as by a smooth coat.
"""

import math
from typing import Annotated

import jax.numpy as jnp
from jax import Array

from jaxrt.description.fields import Albedo, Fraction, Ior
from jaxrt.description.kinds import material
from jaxrt.description.values import require
from jaxrt.materials.conductor import off_facets
from jaxrt.materials.facets import SMOOTHEST, Local, rough
from jaxrt.materials.glass import fresnel
from jaxrt.materials.lobes import TwoLobed

THINNEST = 1.05  # ior: of less, the coat's mean reflectance loses its digits


@material
class Plastic(TwoLobed):
    """A colour under a coat; `ior` is the coat's over what is outside."""

    albedo: Albedo
    roughness: Annotated[Fraction, rough("mirror")] = 0.3
    ior: Annotated[Ior, require(lambda x: x >= THINNEST, f"is below {THINNEST}: use the type diffuse")] = 1.5

    def lobes(self, o: Local) -> tuple[Array, Array]:
        """Return the coat's roughness, and the probability of its reflection; else light comes from beneath."""
        roughness, ior = self.kept()
        return roughness, self.chance(fresnel(o[2], ior)[0])

    def facts(self, o: Local, i: Local) -> tuple[tuple[Array, ...], Array]:
        """Return f cosθ of the coat, that of a white beneath that throws nothing back, and what does; and the pdf."""
        roughness, ior = self.kept()
        even = jnp.maximum(i[2], 0) / math.pi
        single, density, cos = off_facets(roughness, o, i)
        coat, out, back = (fresnel(each, ior)[0] for each in (cos, o[2], jnp.maximum(i[2], 0)))
        inner = 1 - (1 - mean_fresnel(ior)) / (ior * ior)  # what the coat throws back into the colour
        chance = self.chance(out)
        beneath = (1 - out) * (1 - back) / (ior * ior) * even
        return (coat * single, beneath, inner), chance * density + (1 - chance) * even

    def colour(self, *facts: Array) -> Array:
        """Return f cosθ (3,)."""
        coat, beneath, inner = facts
        return coat + self.albedo / (1 - self.albedo * inner) * beneath

    def chance(self, reflected: Array) -> Array:
        """Return the probability with which the coat's reflection is taken: about its share of what is reflected."""
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
