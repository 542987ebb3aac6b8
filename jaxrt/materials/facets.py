"""Rough surfaces as facets: normals distributed as by Trowbridge and Reitz (1975, "GGX") with α = roughness².

They mask and shadow each other as by Smith in Heitz's height-correlated form (2014), and are drawn among those that are
seen (Dupuy & Benyoub 2023). Directions here are three numbers, the last one along the normal.
"""

import math
from collections.abc import Sequence

import jax.numpy as jnp
from jax import Array, lax

from jaxrt.core.maths import safe_divide, safe_sqrt
from jaxrt.core.records import SurfacePoint
from jaxrt.core.sampling import frame_of, sincos_2pi
from jaxrt.description.values import require

SMOOTHEST = 0.05
LEAST = 1e-12  # keeps quotients finite where nothing is scattered

Local = tuple[Array, Array, Array]


def rough(smooth: str) -> object:
    """Return what a roughness must be; `smooth` names the type of what is smoother."""
    return require(lambda x: x >= SMOOTHEST, f"is below {SMOOTHEST}: use {SMOOTHEST} or more, or the type {smooth}")


class Faceted:
    """What materials of facets share. One tells where light `turn`s to, and the `parts` of it that go there."""

    def turn(self, o: Local, u: tuple[Array, Array]) -> tuple[Local, Array]:
        """Return a direction, and the chance of the lobe that it is from over the same without derivative."""
        raise NotImplementedError

    def parts(self, o: Local, i: Local) -> tuple[Array, Array]:
        """Return (f cosθ, pdf) of a direction."""
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
        held, axes = lax.stop_gradient(self), _axes(self.normal_at(surface, wo))
        o = _along(axes, wo)
        i, share = held.turn(o, u)
        value, pdf = self.parts(o, i)[0], held.parts(o, i)[1]
        wi = jnp.stack([inner(i, column) for column in zip(*axes, strict=True)])
        return wi, value * safe_divide(share, pdf), pdf

    def evaluate(self, surface: SurfacePoint, wo: Array, wi: Array) -> tuple[Array, Array]:
        """Return (f cosθ, pdf) of a direction."""
        axes = _axes(self.normal_at(surface, wo))
        return self.parts(_along(axes, wo), _along(axes, wi))


def _axes(normal: Array) -> tuple[Sequence[Array], ...]:
    n = _components(normal)
    return (*frame_of(*n), n)


def _along(axes: tuple[Sequence[Array], ...], direction: Array) -> Local:
    components = _components(direction)
    x, y, z = (inner(axis, components) for axis in axes)
    return x, y, z


def _components(v: Array) -> Local:
    return v[0], v[1], v[2]


def pick(chance: Array, u: Array) -> tuple[Array, Array, Array]:
    """Return whether the first of two lobes is chosen, what is left of u in [0, 1), and the chance of the choice over
    the same without derivative."""
    held = lax.stop_gradient(chance)
    first = u < held
    taken = jnp.where(first, chance, 1 - chance)
    return first, jnp.where(first, u, u - held) / lax.stop_gradient(taken), taken / lax.stop_gradient(taken)


def turned(alpha: Array, o: Local, first: Array, u: tuple[Array, Array]) -> Local:
    """Return a direction off a facet that is seen, or else one of a lobe as the cosine."""
    facet, even = _visible_normal(alpha, o, u)
    return tuple(jnp.where(first, a, b) for a, b in zip(mirrored(o, facet), even, strict=True))  # type: ignore[return-value]


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
