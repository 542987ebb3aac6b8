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


def icosphere(subdivisions):
    """Return (vertices, faces) of a unit sphere of 20·4ᵏ faces, seen counter-clockwise from outside."""
    g = (1 + 5**0.5) / 2
    plane = [(-1, g), (1, g), (-1, -g), (1, -g)]
    vertices = np.array([(a, b, 0) for a, b in plane] + [(0, a, b) for a, b in plane] + [(b, 0, a) for a, b in plane])
    vertices = vertices / np.linalg.norm(vertices, axis=1, keepdims=True)
    distance = np.linalg.norm(vertices[:, None] - vertices, axis=-1)
    near = np.isclose(distance, np.sort(distance[0])[1])
    faces = [
        (a, b, c) for a in range(12) for b in range(12) for c in range(12) if near[a, b] and near[b, c] and near[c, a]
    ]
    faces = np.array([f for f in faces if f[0] == min(f) and np.linalg.det(vertices[list(f)]) > 0])
    for _ in range(subdivisions):
        edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        edges, rows = np.unique(np.sort(edges, 1), axis=0, return_inverse=True)
        middle = vertices[edges].sum(1)
        a, b, c = len(vertices) + rows.reshape(3, -1)
        x, y, z = faces.T
        vertices = np.concatenate([vertices, middle / np.linalg.norm(middle, axis=1, keepdims=True)])
        faces = np.concatenate([np.stack(f, 1) for f in ((x, a, c), (y, b, a), (z, c, b), (a, b, c))])
    return vertices, faces


def soup(corners):
    """Return (vertices, faces) of triangles (m, 3, 3) that share no vertex."""
    return corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)


def exponential(n):
    """Return n triangles, each half as large and half as far from the origin as the one before."""
    return soup(np.float32([[1, 0, 0], [1, 0.5, 0], [1, 0, 0.5]]) * 0.75 ** np.arange(n)[:, None, None])


def coplanar_quads(n):
    """Return a square of n·n quads in the plane y = 0."""
    x, z = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
    vertices = np.stack([x, 0 * x, z], -1).reshape(-1, 3) / n
    a = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    return vertices, np.concatenate([np.stack(f, 1) for f in ((a, a + 1, a + n + 1), (a + 1, a + n + 2, a + n + 1))])


def diagonals(rng, n):
    """Return n long thin triangles along the diagonals of the unit cube."""
    a = rng.uniform(0, 0.1, (n, 3))
    b = a + np.sign(rng.uniform(-1, 1, (n, 3))) * rng.uniform(0.8, 1, (n, 1))
    return soup(np.stack([a, b, b + rng.uniform(-0.01, 0.01, (n, 3))], 1))
