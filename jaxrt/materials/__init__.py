"""All materials of a scene behind `scatter`.

Materials are numbered by kind: diffuse, then mirror, then glass; numbers past the last are sphere lights. A kind that
the scene lacks is None, and its code is then not there.
"""

import jax.numpy as jnp
from jax import Array

from jaxrt.core.maths import dot
from jaxrt.core.pytree import pytree
from jaxrt.kernels.gather import take
from jaxrt.materials.diffuse import Diffuse, sample_diffuse
from jaxrt.materials.glass import Glass, sample_glass
from jaxrt.materials.mirror import Mirror, sample_mirror

__all__ = ["Diffuse", "Glass", "Materials", "Mirror", "Scattering", "scatter"]


@pytree
class Materials:
    """The materials of a scene by kind."""

    diffuse: Diffuse | None
    mirror: Mirror | None
    glass: Glass | None

    @property
    def counts(self) -> tuple[int, int, int]:
        """Number of diffuse, mirror and glass materials."""
        return (
            0 if self.diffuse is None else self.diffuse.albedo.shape[0],
            0 if self.mirror is None else self.mirror.albedo.shape[0],
            0 if self.glass is None else self.glass.ior.shape[0],
        )


@pytree
class Scattering:
    """How light leaves a point along the path: the next direction, and what direct light would be worth."""

    direction: Array  # (3,) unit
    weight: Array  # (3,) f cosθ / pdf of the direction
    albedo: Array | None  # (3,) of the diffuse reflection, 0 at other surfaces; None in scenes without any
    diffuse: Array  # () bool
    specular: Array  # () bool, mirror or glass


def scatter(materials: Materials, row: Array, normal: Array, wo: Array, u: tuple[Array, Array]) -> Scattering:
    """Return the scattering at a surface of material `row`; all weights are 0 at a sphere light, which absorbs.

    normal: (3,) outward unit normal. wo: (3,) unit direction to where the path came from.
    """
    a, b, c = materials.counts
    direction, weight, albedo = normal, jnp.zeros_like(normal), None
    facing = jnp.where(dot(wo, normal) < 0, -normal, normal)
    if materials.diffuse is not None:
        albedo = jnp.where(row < a, take(materials.diffuse.albedo, jnp.clip(row, 0, a - 1)), 0)
        direction, weight = sample_diffuse(albedo, facing, u)
    if materials.mirror is not None:
        tint = take(materials.mirror.albedo, jnp.clip(row - a, 0, b - 1))
        is_mirror = (row >= a) & (row < a + b)
        direction, weight = _select(is_mirror, sample_mirror(tint, wo, normal), (direction, weight))
    if materials.glass is not None:
        ior = take(materials.glass.ior, jnp.clip(row - a - b, 0, c - 1))
        is_glass = (row >= a + b) & (row < a + b + c)
        refracted, share = sample_glass(ior, wo, normal, u[0])
        direction, weight = _select(is_glass, (refracted, share * jnp.ones_like(normal)), (direction, weight))
    return Scattering(direction, weight, albedo, row < a, (row >= a) & (row < a + b + c))


def _select(use: Array, first: tuple[Array, Array], second: tuple[Array, Array]) -> tuple[Array, Array]:
    return jnp.where(use, first[0], second[0]), jnp.where(use, first[1], second[1])
