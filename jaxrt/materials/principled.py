"""The metallic-roughness material of glTF 2.0 (Khronos 2021, appendix B): metal and coated colour in shares."""

import math
from typing import Annotated

import jax.numpy as jnp
from jax import Array

from jaxrt.description.fields import Albedo, Flag, Fraction
from jaxrt.description.kinds import material
from jaxrt.materials.conductor import losses, more_than_once, off_facets, schlick
from jaxrt.materials.directional import lost
from jaxrt.materials.facets import SMOOTHEST, Local, rough
from jaxrt.materials.lobes import TwoLobed

COAT = 0.04  # reflected along the normal by an index of 1.5


@material
class Principled(TwoLobed):
    """A colour under a coat where `metallic` is 0, a metal of that colour where it is 1."""

    albedo: Albedo
    metallic: Fraction = 0.0
    roughness: Annotated[Fraction, rough("mirror or diffuse")] = 0.5
    compensation: Flag = True

    def lobes(self, o: Local) -> tuple[Array, Array]:
        """Return the roughness, and the probability of facets; else light is scattered beneath or between these."""
        roughness, straight, even = self.kept()
        return roughness, _chance(straight, even, lost(roughness, o[2])[0], o[2])

    def facts(self, o: Local, i: Local) -> tuple[tuple[Array, ...], Array]:
        """Return f cosθ of facets and of what is even, without colour, and what these depend on; and the pdf."""
        roughness, straight, even = self.kept()
        above = jnp.maximum(i[2], 0)
        single, density, cos = off_facets(roughness, o, i)
        loss, mean, more = losses(roughness, o[2], above)
        chance, flat = _chance(straight, even, loss, o[2]), above / math.pi
        return (single, flat, cos, mean, more), chance * density + (1 - chance) * flat

    def colour(self, *facts: Array) -> Array:
        """Return f cosθ (3,)."""
        single, flat, cos, mean, more = facts
        _, straight, even = self.kept()
        coat = schlick(straight, cos)
        return coat * single + (1 - coat) * even * flat + self.compensation * more_than_once(straight, mean) * more

    def kept(self) -> tuple[Array, Array, Array]:
        """Return the roughness, what is reflected along the normal, and the colour beneath."""
        return (
            jnp.maximum(self.roughness, SMOOTHEST),
            COAT + self.metallic * (self.albedo - COAT),
            (1 - self.metallic) * self.albedo,
        )


def _chance(straight: Array, even: Array, loss: Array, cos: Array) -> Array:
    """Return the probability with which a facet's reflection is taken: about its share of what is reflected."""
    coat = schlick(jnp.mean(straight), cos)
    return (1 - loss) * coat / (coat + jnp.mean(even) * (1 - coat))
