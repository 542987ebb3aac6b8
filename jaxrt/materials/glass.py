"""Smooth dielectric: Snell's law, total internal reflection, Fresnel's equations, one lobe picked by a number."""

import jax.numpy as jnp
from jax import Array, lax

from jaxrt.core.maths import dot, grad_only, reflect, safe_sqrt
from jaxrt.core.records import SurfacePoint
from jaxrt.description.fields import Absorption, Ior
from jaxrt.description.kinds import material


@material
class Glass:
    """A smooth dielectric; `ior` is inside over outside, `absorption` what is lost inside per unit of length."""

    ior: Ior
    absorption: Absorption | None = None

    is_delta = True
    transmits = True

    def sample(self, surface: SurfacePoint, wo: Array, u: tuple[Array, Array]) -> tuple[Array, Array]:
        """Return (direction, weight) of reflection or refraction, see `sample_glass`."""
        direction, weight = sample_glass(self.ior, wo, surface.shading, u[0])
        return direction, weight * jnp.ones_like(wo)


def fresnel(cos_i: Array, eta: Array) -> tuple[Array, Array]:
    """Return (reflectance, cosine of the refracted angle) for unpolarised light at a smooth boundary.

    cos_i: () cosine of incidence, >= 0. eta: () refractive index of the far side over the near side.
    Beyond the critical angle reflectance is 1, the cosine 0, and all derivatives 0 (Born & Wolf 1999, §1.5.2).
    """
    # 1 − sin²θ_t, without the cancellation of 1 − (1 − cos²)/η² at grazing angles and near η = 1
    squared = (cos_i * cos_i + (eta - 1) * (eta + 1)) / (eta * eta)
    cos_t = safe_sqrt(squared)
    total = squared <= 0
    # Where both cosines vanish (grazing, eta = 1) the quotients are 0/0: replace their denominators first
    parallel = jnp.where(total, 1, eta * cos_i + cos_t)
    perpendicular = jnp.where(total, 1, cos_i + eta * cos_t)
    r_parallel = (eta * cos_i - cos_t) / parallel
    r_perpendicular = (cos_i - eta * cos_t) / perpendicular
    reflectance = (r_parallel * r_parallel + r_perpendicular * r_perpendicular) / 2
    return jnp.where(total, 1, reflectance), cos_t


def sample_glass(ior: Array, wo: Array, normal: Array, u: Array) -> tuple[Array, Array]:
    """Return (direction, weight) of reflection or refraction, picked by `u` with probability equal to its share.

    normal: (3,) outward unit normal, from inside (ior) to outside (1). The weight is 1 for reflection, and for
    refraction 1/eta², since radiance changes by the square of the index (Veach 1997, §5.2). It carries the derivative
    of the share over the probability, the probability and the choice being held fixed.
    """
    cos_o = dot(wo, normal)
    entering = cos_o >= 0
    eta = jnp.where(entering, ior, 1 / ior)
    facing = jnp.where(entering, normal, -normal)
    cos_i = jnp.abs(cos_o)
    reflectance, cos_t = fresnel(cos_i, eta)
    reflected = lax.stop_gradient(u < reflectance)
    share = jnp.where(reflected, reflectance, 1 - reflectance)
    weight = 1 + grad_only(share / lax.stop_gradient(jnp.where(share > 0, share, 1)))
    refraction = (cos_i / eta - cos_t) * facing - wo / eta
    direction = jnp.where(reflected, reflect(wo, facing), refraction)
    return direction, weight * jnp.where(reflected, 1, 1 / (eta * eta))
