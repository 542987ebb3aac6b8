"""A spherical light sampled by area: half of the samples fall on its far side, and near ones count for too much."""

import jax.numpy as jnp
from jax import Array

from jaxrt.core.maths import dot, normalize, safe_divide, safe_sqrt, unit_roundoff
from jaxrt.core.records import LightSample
from jaxrt.core.sampling import sample_uniform_sphere
from jaxrt.kernels.gather import take
from jaxrt.lights import LightTable, pick


def sample_light(table: LightTable, point: Array, u: tuple[Array, Array]) -> LightSample:
    """Return a light sample for a point, its place uniform on the whole of the sphere.

    Irradiance: radiance I/(πr²) · cosθ_y/d² · area 4πr², over the light's probability.
    """
    lights = table.lights
    assert lights.position is not None and lights.intensity is not None and lights.radius is not None
    light, share, u0 = pick(table.pick, u[0])
    center, intensity, radius = (take(field, light) for field in (lights.position, lights.intensity, lights.radius))
    normal = sample_uniform_sphere((u0, u[1]))
    toward = center + radius * normal - point
    squared = dot(toward, toward)
    direction, distance = normalize(toward), safe_sqrt(squared)
    facing = jnp.maximum(-dot(normal, direction), 0)
    rounding = 8 * unit_roundoff(point) * (jnp.sum(jnp.abs(center)) + radius + distance)
    return LightSample(direction, distance - rounding, intensity * safe_divide(4 * facing, squared * share), light)
