"""Meshes as people have them: a body as a scanner sees it, of uneven faces and with thin parts, and a knot.

They are dearer to search than smooth round things of even faces: rays meet more boxes that overlap.
"""

import numpy as np

from benchmarks.mesh_rays import bumpy_sphere

LIMBS = 7  # ears, legs, a tail: of radius about .1 where the body has 1
FACES = 69_451  # of the body: as many as a well-known scan has


def scan(faces: int = FACES, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Return (vertices, faces) of a body with limbs, rough, of uneven faces, and open below like most scans."""
    rng = np.random.default_rng(seed)
    subdivisions = int(np.ceil(np.log(faces / 20) / np.log(4)))
    v, f = bumpy_sphere(subdivisions)
    v = _unit(v)
    # Uneven: vertices moved by up to a third of an edge
    edge = np.linalg.norm(v[f[0, 0]] - v[f[0, 1]])
    v = _unit(v + edge / 3 * rng.uniform(-1, 1, v.shape))
    axes = _unit(rng.normal(size=(LIMBS, 3)) + [0, 0.5, 0])
    lengths, sharpness = rng.uniform(0.5, 1.3, LIMBS), rng.uniform(40, 160, LIMBS)
    # Drawn towards the limbs, which would else have few faces, and long ones
    for axis in axes:
        near = np.exp(12 * (v @ axis - 1))[:, None]
        v = _unit(v - 0.35 * near * (v - (v @ axis)[:, None] * axis))
    radius = 1 + np.exp(sharpness * (v @ axes.T - 1)) @ lengths
    radius = radius + 0.12 * _waves(v, rng, 3, 6) + 0.004 * _waves(v, rng, 25, 40)
    body = v * [0.8, 1.0, 0.7] * radius[:, None]
    # The lowest faces are where it stood
    heights = body[f].mean(1)[:, 1]
    kept = np.sort(np.argsort(-heights)[:faces])
    used, rows = np.unique(f[kept], return_inverse=True)
    return body[used], rows.reshape(-1, 3)


def torus_knot(across: int = 40, along: int = 240) -> tuple[np.ndarray, np.ndarray]:
    """Return (vertices, faces) of a (2, 3) torus knot's tube: 2·across·along faces, 19,200 by default."""
    t = 2 * np.pi * np.arange(along) / along
    ring = 1 + 0.45 * np.cos(3 * t)
    line = np.stack([ring * np.cos(2 * t), 0.45 * np.sin(3 * t), ring * np.sin(2 * t)], -1)
    tangent = _unit(np.roll(line, -1, 0) - np.roll(line, 1, 0))
    side = _unit(np.cross(tangent, [0, 1, 0]))
    up = np.cross(side, tangent)
    a = 2 * np.pi * np.arange(across) / across
    tube = np.cos(a)[None, :, None] * side[:, None] + np.sin(a)[None, :, None] * up[:, None]
    here = np.arange(along * across).reshape(along, across)
    ahead, beside, beyond = (np.roll(here, shift, (0, 1)) for shift in ((-1, 0), (0, -1), (-1, -1)))
    faces = np.stack([np.stack([here, ahead, beside], -1), np.stack([ahead, beyond, beside], -1)]).reshape(-1, 3)
    return (line[:, None] + 0.2 * tube).reshape(-1, 3), faces


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def _waves(v: np.ndarray, rng: np.random.Generator, least: float, most: float) -> np.ndarray:
    """Return the mean of waves of random directions over points (n, 3): relief of any fineness."""
    k = _unit(rng.normal(size=(24, 3))) * rng.uniform(least, most, (24, 1))
    return np.sin(v @ k.T + rng.uniform(0, 2 * np.pi, 24)).mean(1) * 24**0.5
