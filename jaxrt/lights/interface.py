"""What a light answers.

A light that is delta shines from single directions, so that no scattered ray finds it. It answers

    sample(point, u) -> direction (3,), distance (), irradiance (3,) at right angles to the direction, W·m⁻²

and at infinity says `jnp.inf` for the distance. One that has a `position` shines from there: the edges of its shadows
are known then. A light that is not delta is at infinity, seen by rays that meet nothing else, and answers

    sample(point, u) -> direction (3,)
    pdf(direction) -> density () per steradian, positive wherever light comes from
    emitted(direction) -> radiance (3,) W·sr⁻¹·m⁻²

Directions are unit vectors that point to the light, u is two numbers in [0, 1). A light may tell its `power`, in W·sr⁻¹
of a lamp, all channels, by which it is chosen; else it is looked at as often as the others are on average.

Spherical lights, which have a place and yet are hit by rays, answer in their place `picked`, for the picture, and
`attached`, for derivatives; and `radiance`.
"""

from typing import Any

import jax.numpy as jnp
from jax import Array, lax

from jaxrt.core.maths import FAR, safe_divide, unit_roundoff

Pair = tuple[Array, Array]
Sample = tuple[Array, Array, Array]  # direction (3,), distance (), irradiance (3,)


def picked(light: Any, point: Array, u: Pair, share: Array, attached: bool) -> Sample:
    """Return a sample of a light that gets this share of all samples; irradiance is divided by it.

    attached: with derivatives that are right and of bounded variance, where a kind tells both apart.
    """
    if hasattr(light, "picked"):
        return light.attached(point, u, share) if attached else light.picked(point, u, share)
    if not light.is_delta:
        # The directions that are looked at do not move with the light
        direction = lax.stop_gradient(light.sample(point, u))
        density = lax.stop_gradient(light.pdf(direction)) * share
        return (
            direction,
            jnp.full_like(share, FAR),
            light.emitted(direction) * safe_divide(jnp.ones_like(share), density),
        )
    direction, distance, irradiance = light.sample(point, u)
    distance = jnp.minimum(distance, FAR).astype(share.dtype)
    rounding = 8 * unit_roundoff(point) * (jnp.sum(jnp.abs(point)) + 2 * distance)
    return direction, distance - rounding, irradiance / share
