"""Ray intersections in long double NumPy, straight from the definitions: the truth for float32."""

import numpy as np

WIDE = np.longdouble


def unit_vectors(rng, n):
    v = rng.normal(size=(n, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def directions(origins, targets):
    """Return float32 unit vectors (n, 3) from float32 origins to targets."""
    v = np.asarray(targets, float) - origins
    return (v / np.linalg.norm(v, axis=1, keepdims=True)).astype(np.float32)


def dot(a, b):
    return np.sum(a * b, axis=-1)


def sphere_distances(origin, direction, center, radius):
    """Return (distance, depth): inf where missed, and how far inside the limb it passes."""
    o, d, c, r = (np.asarray(x, WIDE) for x in (origin, direction, center, radius))
    f = o - c
    a, b = dot(d, d), dot(f, d)
    away = f - (b / a)[..., None] * d
    discriminant = (r * r - dot(away, away)) * a
    q = -(b + np.where(b < 0, -1, 1) * np.sqrt(np.maximum(discriminant, 0)))
    power = dot(f, f) - r * r
    roots = np.sort(np.stack([q / a, power / np.where(q == 0, 1, q)]), axis=0)
    t = np.where(roots[0] > 0, roots[0], np.where(roots[1] > 0, roots[1], np.inf))
    return np.where(discriminant > 0, t, np.inf), r - np.sqrt(dot(away, away))


def triangle_distances(origin, direction, corners):
    """Return (distance, smallest barycentric coordinate); inf where missed. corners: (..., 3 corners, 3)."""
    o, d, v = (np.asarray(x, WIDE) for x in (origin, direction, corners))
    a, e1, e2 = v[..., 0, :], v[..., 1, :] - v[..., 0, :], v[..., 2, :] - v[..., 0, :]
    p, s = np.cross(d, e2), o - a
    det = dot(e1, p)
    det = np.where(det == 0, np.nan, det)
    beta, q = dot(s, p) / det, np.cross(s, e1)
    gamma, t = dot(d, q) / det, dot(e2, q) / det
    least = np.minimum(np.minimum(beta, gamma), 1 - beta - gamma)
    return np.where((least >= 0) & (t > 0), t, np.inf), least
