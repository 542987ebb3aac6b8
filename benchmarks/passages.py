"""How much light passes the rough coat of Mitsuba's plastic, by its documented formula: quadratures over its facets.

GGX with Smith's masking as if it were unrelated to shadowing; a facet refracts or reflects once. Mitsuba reads the
share that passes from 64 cosines, 0 to 1. Of what a coat throws back into the colour it takes the plain mean of 64
values, both ends among them, which is 1/64 less than the integral: its tables are made the same way here.
"""

from functools import cache

import numpy as np

from jaxrt.materials.directional import normals_seen

STEPS = 20  # of roughness, from 0 to 1
COUNT = 64  # of cosines
POINTS = 96  # of a quadrature, along each axis

Floats = np.ndarray


@cache
def tables(ior: float) -> tuple[Floats, Floats]:
    """Return cells (roughness, cosine, 2) of the share that comes in, and the share thrown back inside (roughness,)."""
    cosines = np.linspace(1e-6, 1, COUNT)
    rows = np.arange(STEPS + 1) / STEPS
    alphas = np.maximum(rows, 1 / STEPS) ** 2
    passed = np.array([[shares(alpha, cos, ior)[1] for cos in cosines] for alpha in alphas])
    back = [np.mean([2 * cos * shares(alpha, cos, 1 / ior)[0] for cos in cosines]) for alpha in alphas]
    return np.stack([passed[:, :-1], np.diff(passed, axis=1)], -1), np.asarray(back)


def shares(alpha: float, cos: float, eta: float) -> tuple[float, float]:
    """Return which shares of light are reflected and refracted, eta: index of the far side over the near one."""
    sin, normal = normals_seen(alpha, cos, POINTS)
    met = np.maximum(sin * normal[0] + cos * normal[2], 0)
    squared = met * met + (eta - 1) * (eta + 1)
    far = np.sqrt(np.maximum(squared, 0))  # cosine beyond, times eta
    across, along = (met - far) / (met + far), (eta * eta * met - far) / (eta * eta * met + far)
    reflectance = np.where(squared > 0, (across**2 + along**2) / 2, 1)
    up = 2 * met * normal[2] - cos
    down = cos / eta - (met - far) / eta * normal[2]
    reflected = np.where(up > 0, reflectance * _shown(alpha, up), 0)
    refracted = np.where((squared > 0) & (down > 0), (1 - reflectance) * _shown(alpha, down), 0)
    return float(reflected.mean()), float(refracted.mean())


def _shown(alpha: float, cos: Floats) -> Floats:
    """Return the share of facets that are not masked."""
    size = np.abs(cos)
    return 2 * size / (size + np.sqrt(alpha * alpha + (1 - alpha * alpha) * size * size))
