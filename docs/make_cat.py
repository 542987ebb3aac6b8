"""Make scenes/cat.obj: a sitting cat, as the surface where a blend of round shapes is zero.

Run `python docs/make_cat.py` from the project's root. Units: the cat is 20 high, stands on y = 0 and looks to +z.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
SPACING = 0.29  # of the grid; gives 26,000 faces
LOW, HIGH = np.array([-9.0, -1.0, -9.5]), np.array([9.0, 21.0, 9.5])


def ellipsoid(p: Floats, center: tuple[float, ...], radii: tuple[float, ...]) -> Floats:
    """Return about the distance of points (…, 3) to an ellipsoid, negative within."""
    q = (p - np.array(center)) / np.array(radii)
    k, slope = np.linalg.norm(q, axis=-1), np.linalg.norm(q / np.array(radii), axis=-1)
    return k * (k - 1) / np.maximum(slope, 1e-9)


def limb(p: Floats, a: tuple[float, ...], b: tuple[float, ...], ra: float, rb: float) -> Floats:
    """Return about the distance to a limb from `a` to `b` whose radius goes from `ra` to `rb`."""
    start, along = np.array(a), np.subtract(b, a)
    t = np.clip((p - start) @ along / (along @ along), 0, 1)
    return np.linalg.norm(p - start - t[..., None] * along, axis=-1) - (ra + (rb - ra) * t)


def blend(a: Floats, b: Floats, width: float) -> Floats:
    """Return the union of two shapes, rounded over `width` where they meet."""
    h = np.maximum(width - np.abs(a - b), 0) / width
    return np.minimum(a, b) - h * h * width / 4


def carve(a: Floats, b: Floats, width: float) -> Floats:
    """Return `a` without `b`, rounded over `width`."""
    return -blend(-a, b, width)


def tail(p: Floats) -> Floats:
    """Return about the distance to the tail, which lies around the cat's left side."""
    angles = np.radians(np.linspace(-95, 62, 24))
    height = 1.05 + 0.9 * np.linspace(0, 1, 24) ** 4
    reach = np.linspace(6.0, 7.0, 24) - 0.9 * np.linspace(0, 1, 24) ** 6
    spine = np.stack([reach * np.cos(angles), height, reach * np.sin(angles) * 0.95 - 0.8], -1)
    width = np.linspace(1.15, 0.7, 24)
    parts = [limb(p, *spine[i : i + 2], *width[i : i + 2]) for i in range(23)]
    return np.min(parts, axis=0)


def head(p: Floats, mirrored: Floats) -> Floats:
    """Return about the distance to the head."""
    d = ellipsoid(p, (0, 14.5, 2.9), (3.45, 2.85, 2.9))
    d = blend(d, ellipsoid(mirrored, (1.75, 13.6, 3.6), (1.75, 1.35, 1.5)), 1.0)
    d = blend(d, ellipsoid(mirrored, (0.62, 13.3, 5.55), (0.95, 0.75, 0.8)), 0.45)
    d = blend(d, ellipsoid(p, (0, 14.3, 5.3), (0.7, 1.3, 0.9)), 0.8)
    # Eyes in their sockets, then the nose
    d = carve(d, ellipsoid(mirrored, (1.35, 15.05, 5.75), (0.72, 0.62, 0.75)), 0.35)
    d = np.minimum(d, ellipsoid(mirrored, (1.3, 15.05, 5.1), (0.66, 0.58, 0.62)))
    d = blend(d, ellipsoid(p, (0, 13.95, 6.3), (0.42, 0.3, 0.3)), 0.15)
    ear = limb(mirrored, (1.95, 16.0, 2.7), (2.75, 19.6, 2.3), 1.45, 0.2)
    ear = carve(ear, limb(mirrored, (1.95, 16.4, 3.9), (2.7, 19.0, 2.9), 1.0, 0.1), 0.3)
    return blend(d, ear, 0.6)


def cat(p: Floats) -> Floats:
    """Return about the distance of points (…, 3) to the cat, negative within."""
    mirrored = np.concatenate([np.abs(p[..., :1]), p[..., 1:]], -1)
    d = ellipsoid(p, (0, 4.9, -1.9), (4.5, 4.9, 5.0))
    d = blend(d, limb(p, (0, 5.5, -0.4), (0, 11.6, 2.1), 4.0, 2.35), 2.0)
    d = blend(d, ellipsoid(p, (0, 9.0, 3.0), (2.3, 2.9, 1.9)), 1.2)
    thigh = ellipsoid(mirrored, (3.5, 3.6, -0.9), (1.9, 3.5, 3.6))
    d = blend(d, thigh, 0.7)
    d = blend(d, ellipsoid(mirrored, (3.7, 0.75, 2.9), (1.25, 0.95, 2.2)), 0.5)
    d = blend(d, limb(mirrored, (1.55, 8.6, 3.0), (1.5, 1.2, 4.3), 1.35, 1.0), 0.7)
    d = blend(d, ellipsoid(mirrored, (1.5, 0.75, 5.0), (1.2, 0.95, 1.6)), 0.4)
    toes = [ellipsoid(mirrored, (1.5 + x, 0.55, 6.2), (0.42, 0.6, 0.55)) for x in (-0.68, 0.0, 0.68)]
    d = blend(d, np.min(toes, axis=0), 0.2)
    d = blend(d, head(p, mirrored), 0.9)
    d = blend(d, tail(p), 0.35)
    # A flat sole
    return -blend(-d, p[..., 1], 0.3)


def surface_net(values: Floats) -> tuple[Floats, NDArray[np.int64]]:
    """Return vertices (v, 3) in grid steps and quads (q, 4) where values (i, j, k) change sign (Gibson 1998).

    One vertex for each cell that the surface crosses, one quad for each edge of the grid that it crosses.
    """
    total, count = np.zeros((*(n - 1 for n in values.shape), 3)), np.zeros(tuple(n - 1 for n in values.shape))
    edges = []
    for axis in range(3):
        a, b = np.moveaxis(values, axis, 0)[:-1], np.moveaxis(values, axis, 0)[1:]
        along = np.argwhere((a < 0) != (b < 0))
        va, vb = a[tuple(along.T)], b[tuple(along.T)]
        grid = np.insert(along[:, 1:], axis, along[:, 0], axis=1)
        place = grid.astype(float)
        place[:, axis] += va / (va - vb)
        u, v = (axis + 1) % 3, (axis + 2) % 3
        cells = []
        for du, dv in ((-1, -1), (0, -1), (0, 0), (-1, 0)):
            cell = grid.copy()
            cell[:, u] += du
            cell[:, v] += dv
            np.add.at(total, tuple(cell.T), place)
            np.add.at(count, tuple(cell.T), 1)
            cells.append(cell)
        quads = np.stack(cells, 1)
        edges.append(np.where((va < 0)[:, None, None], quads, quads[:, ::-1]))
    number = np.cumsum(count.ravel() > 0).reshape(count.shape) - 1
    return total[count > 0] / count[count > 0][:, None], number[tuple(np.moveaxis(np.concatenate(edges), -1, 0))]


def onto_surface(vertices: Floats, steps: int = 4) -> Floats:
    """Return the vertices moved onto the zero of `cat` by Newton's method along its gradient."""
    h = 1e-4 * np.eye(3)
    for _ in range(steps):
        slope = np.stack([(cat(vertices + e) - cat(vertices - e)) / 2e-4 for e in h], -1)
        vertices = vertices - cat(vertices)[:, None] * slope / np.maximum(np.sum(slope**2, -1, keepdims=True), 0.25)
    return vertices


def relax(vertices: Floats, quads: NDArray[np.int64]) -> Floats:
    """Return the vertices, each halfway to the mean of its neighbours."""
    total, count = np.zeros_like(vertices), np.zeros(len(vertices))
    for a, b in ((i, (i + step) % 4) for i in range(4) for step in (1, 3)):
        np.add.at(total, quads[:, a], vertices[quads[:, b]])
        np.add.at(count, quads[:, a], 1)
    return (vertices + total / count[:, None]) / 2


def make_cat(spacing: float = SPACING) -> tuple[Floats, NDArray[np.int64]]:
    """Return vertices (v, 3) and faces (n, 3) of the cat; each quad is cut along its shorter diagonal."""
    axes = [np.arange(low, high, spacing) for low, high in zip(LOW, HIGH, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1)
    vertices, quads = surface_net(cat(grid))
    vertices = LOW + vertices * spacing
    for _ in range(3):
        vertices = onto_surface(relax(vertices, quads))
    a, b, c, d = (vertices[quads[:, i]] for i in range(4))
    shorter = np.linalg.norm(a - c, axis=-1) <= np.linalg.norm(b - d, axis=-1)
    one, other = quads[:, [0, 1, 2, 0, 2, 3]], quads[:, [0, 1, 3, 1, 2, 3]]
    return vertices, np.where(shorter[:, None], one, other).reshape(-1, 3)


def save_obj(path: Path, vertices: Floats, faces: NDArray[np.int64]) -> None:
    """Write an OBJ file with three decimals."""
    rows = [f"v {x:.3f} {y:.3f} {z:.3f}\n" for x, y, z in (vertices + 0.0).tolist()]
    rows += [f"f {a} {b} {c}\n" for a, b, c in (faces + 1).tolist()]
    path.write_text("# A sitting cat, made by docs/make_cat.py\n" + "".join(rows))


if __name__ == "__main__":
    target = Path("scenes/cat.obj")
    vertices, faces = make_cat()
    save_obj(target, vertices, faces)
    print(f"{target}: {len(vertices)} vertices, {len(faces)} faces, {target.stat().st_size / 1e6:.1f} MB")
