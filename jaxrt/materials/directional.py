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


def lost(roughness: Array, *cosines: Array) -> tuple[Array, ...]:
    """Return the shares () of light at angles of these cosines, 0 to 1, that one reflection does not send out."""
    cells, _ = _cells()
    i, u = _cell(roughness)
    shares = []
    for cos in cosines:
        j, v = _cell(jnp.sqrt(jnp.maximum(cos, 1e-6)))
        a, b, c, d = take(jnp.asarray(cells, u.dtype), (COUNT - 1) * i + j)
        shares.append(a + b * v + u * (c + d * v))
    return tuple(shares)


def mean_lost(roughness: Array) -> Array:
    """Return `lost` of light from everywhere, weighed by the cosine."""
    _, means = _cells()
    i, u = _cell(roughness)
    a, b = take(jnp.asarray(means, u.dtype), i)
    return a + b * u


def _cell(x: Array) -> tuple[Array, Array]:
    """Return the cell of 0 to 1 in which x lies, and where in it."""
    place = jnp.minimum(x, 1) * (COUNT - 1)
    i = jnp.minimum(lax.stop_gradient(place).astype(jnp.int32), COUNT - 2)
    return i, place - i.astype(place.dtype)


@cache
def _cells() -> tuple[Floats, Floats]:
    """Return the coefficients of bilinear cells (cells, 4), and those of linear cells of means (cells, 2)."""
    table, means = (1 - array for array in _tables())
    low, high = table[:-1], table[1:]
    a, b = low[:, :-1], low[:, 1:] - low[:, :-1]
    c, d = high[:, :-1] - a, high[:, 1:] - high[:, :-1] - b
    return np.stack([a, b, c, d], -1).reshape(-1, 4), np.stack([means[:-1], np.diff(means)], -1)


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
    sin, normal = normals_seen(alpha, cos, POINTS)
    out = 2 * (sin * normal[0] + cos * normal[2]) * normal[2] - cos  # cosine of what is reflected
    far_o, far_i = (np.sqrt(alpha**2 + (1 - alpha**2) * c * c) for c in (cos, out))
    shares = np.where(out > 0, out * (cos + far_o) / np.maximum(cos * far_i + out * far_o, 1e-12), 0)
    return float(shares.mean())


def normals_seen(alpha: float, cos: float, points: int) -> tuple[float, Floats]:
    """Return a direction's sine, and normals (3, points, points) of facets, each as likely as seen from there."""
    u, v = np.meshgrid(*2 * [(np.arange(points) + 0.5) / points], indexing="ij")
    sin = np.sqrt(1 - cos * cos)
    x, z = np.array([alpha * sin, cos]) / np.hypot(alpha * sin, cos)
    height = 1 - v * (1 + z)
    ring = np.sqrt(np.maximum(1 - height * height, 0))
    normal = np.stack([alpha * (ring * np.cos(2 * np.pi * u) + x), alpha * ring * np.sin(2 * np.pi * u), height + z])
    return sin, normal / np.linalg.norm(normal, axis=0)
