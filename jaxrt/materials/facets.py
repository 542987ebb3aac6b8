"""Rough surfaces as facets: normals distributed as by Trowbridge and Reitz (1975, "GGX") with α = roughness².

They mask and shadow each other as by Smith in Heitz's height-correlated form (2014), and are drawn among those that are
seen (Dupuy & Benyoub 2023). Directions here are three numbers, the last one along the normal; what all channels share
is computed `once`, not for each.
"""

import math
from collections.abc import Sequence

import jax.numpy as jnp
from jax import Array, lax

from jaxrt.core.maths import safe_divide, safe_sqrt
from jaxrt.core.records import SurfacePoint
from jaxrt.core.samplers import LAST
from jaxrt.core.sampling import frame_of, sincos_2pi
from jaxrt.description.values import require
from jaxrt.kernels.native import once

SMOOTHEST = 0.05
LEAST = 1e-12  # keeps quotients finite where nothing is scattered

Local = tuple[Array, Array, Array]


def rough(smooth: str) -> object:
    """Return what a roughness must be; `smooth` names the type of what is smoother."""
    return require(lambda x: x >= SMOOTHEST, f"is below {SMOOTHEST}: use {SMOOTHEST} or more, or the type {smooth}")


class Faceted:
    """What materials of facets share. One tells where light `turn`s to; its `facts` and `colour` tell how much does."""

    def turn(self, o: Local, u: tuple[Array, Array]) -> tuple[Local, Array]:
        """Return a direction, and the chance of the lobe that it is from over the same without derivative."""
        raise NotImplementedError

    def facts(self, o: Local, i: Local) -> tuple[tuple[Array, ...], Array]:
        """Return what all channels share of light that goes from one direction to the other, and its pdf."""
        raise NotImplementedError

    def colour(self, *facts: Array) -> Array:
        """Return f cosθ (3,)."""
        raise NotImplementedError

    def numbers(self, o: Local, i: Local, coin: Array) -> tuple[Array, Array]:
        """Return numbers for which light turns to `i`; the coin in [0, 1) picks one of its lobes by their shares."""
        raise NotImplementedError

    def normal_at(self, surface: SurfacePoint, wo: Array) -> Array:
        """Return the normal along which directions are told."""
        return surface.facing(wo)

    def sample(self, surface: SurfacePoint, wo: Array, u: tuple[Array, Array]) -> tuple[Array, Array]:
        """Return (direction, weight)."""
        return self.draw(surface, wo, u)[:2]

    def draw(self, surface: SurfacePoint, wo: Array, u: tuple[Array, Array]) -> tuple[Array, Array, Array]:
        """Return (direction, weight, pdf).

        The material's own fields move f alone; the surface moves the direction with its normal, and the chance of the
        lobe that was chosen.
        """
        normal = self.normal_at(surface, wo)
        (o,) = once(_along)(normal, wo)
        i, share = once(type(self).turn)(lax.stop_gradient(self), o, u)
        facts, pdf = once(_facts)(self, o, i)
        value = self.colour(*facts)
        return once(_back)(normal, i), value * safe_divide(share, pdf), pdf

    def evaluate(self, surface: SurfacePoint, wo: Array, wi: Array) -> tuple[Array, Array]:
        """Return (f cosθ, pdf) of a direction."""
        o, i = once(_along)(self.normal_at(surface, wo), wo, wi)
        facts, pdf = once(_facts)(self, o, i)
        return self.colour(*facts), pdf

    def numbers_toward(self, surface: SurfacePoint, wo: Array, wi: Array, coin: Array) -> tuple[Array, Array]:
        """Return numbers that draw a direction. coin: as of `numbers`."""
        o, i = once(_along)(self.normal_at(surface, wo), wo, wi)
        return once(type(self).numbers)(self, o, i, coin)


def _facts(one: Faceted, o: Local, i: Local) -> tuple[tuple[Array, ...], Array]:
    """Return the facts, and the pdf without derivative in the material's own fields."""
    return one.facts(o, i)[0], lax.stop_gradient(one).facts(o, i)[1]


def _along(normal: Array, *directions: Array) -> list[Local]:
    """Return directions (3,) along the normal's frame."""
    t, b, n = _axes(normal)
    return [(inner(t, v), inner(b, v), inner(n, v)) for v in map(_components, directions)]


def _back(normal: Array, i: Local) -> Array:
    """Return the direction (3,) of one along the normal's frame."""
    return jnp.stack([inner(i, column) for column in zip(*_axes(normal), strict=True)])


def _axes(normal: Array) -> tuple[Sequence[Array], Sequence[Array], Sequence[Array]]:
    n = _components(normal)
    return (*frame_of(*n), n)


def _components(v: Array) -> Local:
    return v[0], v[1], v[2]


def pick(chance: Array, u: Array) -> tuple[Array, Array, Array]:
    """Return whether the first of two lobes is chosen, what is left of u in [0, 1), and the chance of the choice over
    the same without derivative."""
    held = lax.stop_gradient(chance)
    first = u < held
    taken = jnp.where(first, chance, 1 - chance)
    return first, jnp.where(first, u, u - held) / lax.stop_gradient(taken), taken / lax.stop_gradient(taken)


def picking(chance: Array, first: Array, left: Array) -> Array:
    """Return the u of which `pick` leaves so much."""
    return jnp.clip(jnp.where(first, left * chance, chance + left * (1 - chance)), 0, LAST)


def turned(alpha: Array, o: Local, first: Array, u: tuple[Array, Array]) -> Local:
    """Return a direction off a facet that is seen, or else one of a lobe as the cosine."""
    facet, even = _visible_normal(alpha, o, u)
    x, y, z = (jnp.where(first, a, b) for a, b in zip(mirrored(o, facet), even, strict=True))
    return x, y, z


def visible_normal(alpha: Array, o: Local, u: tuple[Array, Array]) -> Local:
    """Return the normal of a facet that is seen: on a cap of the hemisphere that facets are stretched to."""
    return _visible_normal(alpha, o, u)[0]


def _visible_normal(alpha: Array, o: Local, u: tuple[Array, Array]) -> tuple[Local, Local]:
    """Return it, and a direction with density cosθ/π from the same numbers."""
    x, y, z = _unit(alpha * o[0], alpha * o[1], o[2])
    height = 1 - u[1] * (1 + z)
    ring = safe_sqrt(1 - height * height)
    cos, sin = sincos_2pi(u[0])
    facet = _unit(alpha * (ring * cos + x), alpha * (ring * sin + y), height + z)
    flat = safe_sqrt(1 - u[1])
    return facet, (flat * cos, flat * sin, safe_sqrt(u[1]))


def numbers_of_normal(alpha: Array, o: Local, facet: Local) -> tuple[Array, Array]:
    """Return the numbers for which `visible_normal` is a facet's: that mirrors the stretched eye onto the cap."""
    eye, across = _unit(alpha * o[0], alpha * o[1], o[2]), _unit(facet[0], facet[1], alpha * facet[2])
    x, y, height = mirrored(eye, across)
    return _share_of_turn(y, x), jnp.clip(safe_divide(1 - height, 1 + eye[2]), 0, 1)


def numbers_of_even(i: Local) -> tuple[Array, Array]:
    """Return the numbers for which the lobe as the cosine has a direction."""
    return _share_of_turn(i[1], i[0]), jnp.clip(i[2] * i[2], 0, 1)


def _share_of_turn(y: Array, x: Array) -> Array:
    turn = jnp.arctan2(y, x) / (2 * math.pi)
    return turn - jnp.floor(turn)


def _unit(x: Array, y: Array, z: Array) -> Local:
    shrink = lax.rsqrt(jnp.maximum(x * x + y * y + z * z, LEAST))
    return x * shrink, y * shrink, z * shrink


def mirrored(o: Local, facet: Local) -> Local:
    """Return where a facet mirrors light to."""
    double = 2 * inner(o, facet)
    x, y, z = (double * m - w for m, w in zip(facet, o, strict=True))
    return x, y, z


def inner(a: Sequence[Array], b: Sequence[Array]) -> Array:
    """Return a·b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def facets(alpha: Array, h: Local, cos_o: Array, cos_i: Array) -> tuple[Array, Array, Array]:
    """Return f cosθ without Fresnel's factor, the density of the mirrored normals that are seen, and |h|².

    h: along the facet's normal, of any length: both directions together, the second times the index of its side.
    """
    squared, flat = alpha * alpha, h[0] * h[0] + h[1] * h[1]  # 1 − cos² would lose what small angles are
    upright = h[2] * h[2]
    peak = (flat + upright) / jnp.maximum(squared * upright + flat, LEAST)
    far_o, far_i = (jnp.sqrt(squared + (1 - squared) * cos * cos) for cos in (cos_o, cos_i))
    distribution = squared * peak * peak / (2 * math.pi)
    value = distribution * cos_i / jnp.maximum(cos_o * far_i + cos_i * far_o, LEAST)
    return value, distribution / (cos_o + far_o), flat + upright
