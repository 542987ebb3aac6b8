"""How densely light samples look at a sphere light: what scattered rays that may hit it are weighed against."""

import jax.numpy as jnp
from jax import Array, lax

from jaxrt.core.maths import dot, safe_divide
from jaxrt.core.sampling import cone_of_sphere, pdf_cone
from jaxrt.kernels.gather import take
from jaxrt.lights import LightTable


def light_density(table: LightTable, light: Array, point: Array) -> Array:
    """Return the density () per steradian with which `sample_light` sends a ray from a point to light number `light`.

    It is the same all over the cone that a sphere light fills, and 0 from inside and for point lights. No derivative.
    """
    lights = table.lights
    if lights.radius is None:
        return jnp.zeros_like(point[0])
    n = lights.radius.shape[0]
    row = jnp.clip(light, 0, n - 1)
    away, radius = point - take(lights.position, row), take(lights.radius, row)
    s2 = safe_divide(radius * radius, dot(away, away))
    density = pdf_cone(cone_of_sphere(s2))
    if table.pick is not None:
        shares = table.pick.astype(point.dtype)
        density = density * (take(shares, row) - jnp.where(row > 0, take(shares, jnp.maximum(row - 1, 0)), 0))
    return lax.stop_gradient(jnp.where((s2 < 1) & (light < n), density, 0))
