"""Closed meshes as (m, 3, 3) float32 corners, and points to aim at on their edges and vertices."""

import numpy as np


def star_mesh(rng, rings, scale=1.0, offset=0.0):
    """Return a sphere of 2·rings·(rings − 1) triangles whose vertices have random distances from `offset`.

    After Triangle.Watertight of pbrt: a star, so that every ray from the middle meets the surface.
    """
    theta, phi = np.meshgrid(np.arange(rings + 1) / rings * np.pi, np.arange(rings) / rings * 2 * np.pi, indexing="ij")
    points = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
    radius = rng.uniform(0.5, 2, theta.shape)
    radius[0], radius[-1] = radius[0, 0], radius[-1, 0]
    points = points * radius[..., None]
    points[0], points[-1] = [0, 0, radius[0, 0]], [0, 0, -radius[-1, 0]]
    points = (points * scale + offset).astype(np.float32)
    faces = []
    for i in range(rings):
        for j in range(rings):
            a, b = points[i, j], points[i + 1, j]
            c, d = points[i + 1, (j + 1) % rings], points[i, (j + 1) % rings]
            faces += [[a, b, c]] if i < rings - 1 else []
            faces += [[a, c, d]] if i > 0 else []
    return np.asarray(faces, np.float32)


def aim_at_edges(rng, mesh, n):
    """Return n random points (n, 3) on edges, float64."""
    face, k = rng.integers(0, len(mesh), n), rng.integers(0, 3, n)
    a, b = mesh[face, k].astype(float), mesh[face, (k + 1) % 3].astype(float)
    return a + rng.uniform(0, 1, (n, 1)) * (b - a)


def aim_at_vertices(rng, mesh, n):
    """Return n random vertices (n, 3)."""
    return mesh[rng.integers(0, len(mesh), n), rng.integers(0, 3, n)].astype(float)
