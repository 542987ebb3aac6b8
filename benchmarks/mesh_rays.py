"""Meshes, rays and a room for the comparison of searches: NumPy only, for both halves."""

import tomllib
from pathlib import Path

import numpy as np

LIGHT = (2.0, 3.0, 1.5)
TILE = 8  # pixels across
# Kinds of rays: the arrays that hold them, and whether any hit will do
KINDS = {
    "camera": ("camera", False),
    "shadow": ("shadow", True),
    "close camera": ("close_camera", False),
    "close shadow": ("close_shadow", True),
    "incoherent": ("incoherent", False),
    "incoherent any": ("incoherent", True),
}
OPEN = ("scan", "knot")  # meshes of the open scene, see `scans`
CLOSE = 18.0  # view of the close camera, over the root of the number of faces: half the other's at 1,280 faces


def bumpy_sphere(subdivisions: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (vertices, faces) of a sphere with waves, of 20·4ᵏ faces."""
    g = (1 + 5**0.5) / 2
    plane = [(-1, g), (1, g), (-1, -g), (1, -g)]
    points = [(a, b, 0) for a, b in plane] + [(0, a, b) for a, b in plane] + [(b, 0, a) for a, b in plane]
    vertices = np.array(points, float) / np.hypot(1, g)
    near = np.isclose(np.linalg.norm(vertices[:, None] - vertices, axis=-1), 2 / np.hypot(1, g))
    triples = np.argwhere(near[:, :, None] & near[None] & near[:, None])
    faces = np.array([f for f in triples if f[0] == f.min() and np.linalg.det(vertices[f]) > 0])
    for _ in range(subdivisions):
        edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        edges, rows = np.unique(np.sort(edges, 1), axis=0, return_inverse=True)
        a, b, c = len(vertices) + rows.reshape(3, -1)
        x, y, z = faces.T
        middle = vertices[edges].sum(1)
        vertices = np.concatenate([vertices, middle / np.linalg.norm(middle, axis=1, keepdims=True)])
        faces = np.concatenate([np.stack(f, 1) for f in ((x, a, c), (y, b, a), (z, c, b), (a, b, c))])
    waves = np.sin(6 * vertices[:, 0]) * np.sin(7 * vertices[:, 1]) * np.sin(5 * vertices[:, 2])
    return vertices * (1 + 0.15 * waves[:, None]), faces


def room(vertices: np.ndarray, faces: np.ndarray) -> dict:
    """Return the description of a room of six huge spheres with the mesh in it, white, under a sphere light."""
    seed = Path(__file__).parent.parent / "scenes" / "seed" / "mesh_in_room.toml"
    description = tomllib.loads(seed.read_text(encoding="utf-8"))
    description["camera"] |= {"width": 256, "height": 256}
    description["render"] |= {"spp": 16, "max_depth": 4}
    mesh = {"vertices": 10 * vertices, "faces": faces, "material": "white"}
    return description | {"meshes": [mesh]}


def in_the_open(vertices: np.ndarray, faces: np.ndarray, size: float = 22) -> dict:
    """Return the description of the open scene with a mesh in its middle, `size` units wide."""
    text = (Path(__file__).parent / "scenes" / "open.toml").read_text(encoding="utf-8")
    low, high = vertices.min(0), vertices.max(0)
    placed = (vertices - (low + high) / 2) * (size / (high - low).max())
    return tomllib.loads(text) | {"meshes": [{"vertices": placed, "faces": faces, "material": "white"}]}


def camera_rays(count: int, view: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Return (origins, directions) (n, 3) float32 of about `count` rays of a camera: 8×8 tiles, 4 samples a pixel.

    view: width of the picture at distance 1.
    """
    rng = np.random.default_rng(1)
    across = int((count / 4) ** 0.5) // TILE
    ty, tx, _, y, x = np.indices((across, across, 4, TILE, TILE)).reshape(5, -1)
    pixels = np.stack([tx * TILE + x, ty * TILE + y], -1) + rng.uniform(size=(len(x), 2))
    d = np.concatenate([view * (pixels / (across * TILE) - 0.5), np.full((len(x), 1), -1.0)], 1)
    return np.tile(np.float32([0.3, 0.2, 2.6]), (len(x), 1)), unit(d)


def incoherent_rays(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (origins, directions) (n, 3) float32, uniform in a box around the mesh and in direction."""
    rng = np.random.default_rng(2)
    return rng.uniform(-1.2, 1.2, (count, 3)).astype(np.float32), unit(rng.normal(size=(count, 3)))


def unit(d: np.ndarray) -> np.ndarray:
    """Return directions (n, 3) of length 1, float32."""
    return (d / np.linalg.norm(d, axis=1, keepdims=True)).astype(np.float32)
