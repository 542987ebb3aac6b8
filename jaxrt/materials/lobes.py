"""Materials of two lobes: facets that are seen mirror light, or else it goes on evenly, as the cosine."""

import math

import jax.numpy as jnp
from jax import Array

from jaxrt.materials.facets import (
    Faceted,
    Local,
    facets,
    numbers_of_even,
    numbers_of_normal,
    pick,
    picking,
    turned,
)


class TwoLobed(Faceted):
    """What these share. One tells the roughness of its facets, and their chance."""

    def lobes(self, o: Local) -> tuple[Array, Array]:
        """Return the roughness, and the probability with which a facet's reflection is taken."""
        raise NotImplementedError

    def turn(self, o: Local, u: tuple[Array, Array]) -> tuple[Local, Array]:
        """Return a direction off a facet that is seen, or else one of the even lobe."""
        roughness, chance = self.lobes(o)
        first, left, share = pick(chance, u[0])
        return turned(roughness * roughness, o, first, (left, u[1])), share

    def numbers(self, o: Local, i: Local, coin: Array) -> tuple[Array, Array]:
        """Return numbers for which light turns to `i`; the coin in [0, 1) picks one of both lobes by their shares."""
        roughness, chance = self.lobes(o)
        alpha, h = roughness * roughness, (o[0] + i[0], o[1] + i[1], o[2] + i[2])
        above = jnp.maximum(i[2], 0)
        sharp, even = chance * facets(alpha, h, o[2], above)[1], (1 - chance) * above / math.pi
        first = coin * (sharp + even) < sharp
        off_facet, evenly = numbers_of_normal(alpha, o, h), numbers_of_even(i)
        left, u1 = (jnp.where(first, a, b) for a, b in zip(off_facet, evenly, strict=True))
        return picking(chance, first, left), u1
