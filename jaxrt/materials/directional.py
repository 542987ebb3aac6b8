"""What rough surfaces of perfect reflectance reflect of light from one direction in one reflection: tables.

They are quadratures of GGX with Smith's height-correlated masking, made when a scene first has a rough material: 16
values of roughness by 16 of the square root of the cosine. Between them is read linearly, within .008 for cosines above
.05.
"""

from functools import cache

import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from numpy.typing import NDArray

from jaxrt.kernels.gather import take

COUNT = 16
POINTS = 64  # of the quadrature, along each axis

Floats = NDArray[np.float64]


def reflected_once(roughness: Array, cos: Array) -> Array:
    """Return the share () of light at an angle of that cosine, 0 to 1, that leaves after one reflection."""
    table, _ = _tables()
    i, u = _cell(roughness)
    j, v = _cell(jnp.sqrt(jnp.clip(cos, 1e-6, 1)))
    cells, first = jnp.asarray(table.ravel(), u.dtype), COUNT * i + j
    below, above = (take(cells, first + k) * (1 - v) + take(cells, first + k + 1) * v for k in (0, COUNT))
    return below * (1 - u) + above * u


def mean_albedo(roughness: Array) -> Array:
    """Return `reflected_once` of light from everywhere, weighed by the cosine."""
    _, means = _tables()
    i, u = _cell(roughness)
    cells = jnp.asarray(means, u.dtype)
    return take(cells, i) * (1 - u) + take(cells, i + 1) * u


def _cell(x: Array) -> tuple[Array, Array]:
    """Return the cell of 0 to 1 in which x lies, and where in it."""
    place = jnp.clip(x, 0, 1) * (COUNT - 1)
    i = jnp.minimum(lax.stop_gradient(place).astype(jnp.int32), COUNT - 2)
    return i, place - i.astype(place.dtype)


@cache
def _tables() -> tuple[Floats, Floats]:
    """Return the table (roughness, √cosine), and its means over the hemisphere, weighed by the cosine."""
    roots = np.linspace(0, 1, COUNT)
    smooth = np.ones(COUNT)
    table = np.stack([smooth, *([_albedo(r * r, max(c * c, 1e-4)) for c in roots] for r in roots[1:])])
    fine = (np.arange(4096) + 0.5) / 4096
    means = [np.mean(2 * fine * np.interp(np.sqrt(fine), roots, row)) for row in table]
    return table, np.asarray(means)


def _albedo(alpha: float, cos: float) -> float:
    """Return the albedo in one direction, by midpoints over normals that are seen."""
    u, v = np.meshgrid(*2 * [(np.arange(POINTS) + 0.5) / POINTS], indexing="ij")
    sin = np.sqrt(1 - cos * cos)
    x, z = np.array([alpha * sin, cos]) / np.hypot(alpha * sin, cos)
    height = 1 - v * (1 + z)
    ring = np.sqrt(np.maximum(1 - height * height, 0))
    normal = np.stack([alpha * (ring * np.cos(2 * np.pi * u) + x), alpha * ring * np.sin(2 * np.pi * u), height + z])
    normal /= np.linalg.norm(normal, axis=0)
    out = 2 * (sin * normal[0] + cos * normal[2]) * normal[2] - cos  # cosine of what is reflected
    far_o, far_i = (np.sqrt(alpha**2 + (1 - alpha**2) * c * c) for c in (cos, out))
    shares = np.where(out > 0, out * (cos + far_o) / np.maximum(cos * far_i + out * far_o, 1e-12), 0)
    return float(shares.mean())
