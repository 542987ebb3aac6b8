"""How densely light samples look at a light: what scattered rays that may find it are weighed against."""

import jax.numpy as jnp
from jax import Array, lax

from jaxrt.core.maths import dot, safe_divide
from jaxrt.core.sampling import cone_of_sphere, pdf_cone
from jaxrt.kernels.gather import take
from jaxrt.lights import LightTable, row_of, share_at


def light_density(table: LightTable, light: Array, point: Array, direction: Array) -> Array:
    """Return the density () per steradian with which `sample_light` sends a ray from a point to light number `light`.

    It is the same all over the cone that a sphere light fills, and 0 from inside and for lights that no ray finds. No
    derivative.
    """
    density, lights = jnp.zeros_like(point[0]), table.lights
    if lights.radius is not None:
        n = lights.radius.shape[0]
        row = jnp.clip(light, 0, n - 1)
        away, radius = point - take(lights.position, row), take(lights.radius, row)
        s2 = safe_divide(radius * radius, dot(away, away))
        density = jnp.where((s2 < 1) & (light < n), pdf_cone(cone_of_sphere(s2)), 0)
    for kind, first, n in lights.skies():
        own = row_of(kind, jnp.clip(light - first, 0, n - 1)).pdf(direction)
        density = jnp.where((light >= first) & (light < first + n), own, density)
    return lax.stop_gradient(density * share_at(table, jnp.clip(light, 0, lights.count - 1), point))
