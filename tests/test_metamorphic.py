"""Changes of a scene whose effect on the picture is known, though the picture is not.

Powers of two scale every float32 operation exactly, and so do permutations: such pictures agree bit by bit, or to a
few ulp where the compiler may fuse other products. Elsewhere two pictures with different seeds are compared: 16 seeds
each, t-test on 4 × 4 blocks and channels with Šidák's bound, 1e-4 false alarms per comparison of random seeds.
"""

import jax
import numpy as np
import pytest
from scipy import stats

import jaxrt

SEEDS = 16
CORNERS = [(-3.0, -1.0, -3.0), (3.0, -1.0, -3.0), (3.0, -1.0, 3.0), (-3.0, -1.0, 3.0)]


def quad(corners, pieces=1):
    """Return the triangles of a quad cut into pieces × pieces smaller ones; the cuts are dyadic, so exact."""
    a, b, _, d = np.array(corners)
    across, down = (b - a) / pieces, (d - a) / pieces
    triangles = []
    for i in range(pieces):
        for j in range(pieces):
            p = a + i * across + j * down
            triangles += [(p, p + across, p + across + down), (p, p + across + down, p + down)]
    return triangles


BASE = {
    "camera": {"position": (0.5, 2.0, 6.0), "target": (0.0, -0.25, 0.0), "up": (0, 1, 0), "fov": 40.0},
    "materials": {
        "floor": {"type": "diffuse", "albedo": (0.8, 0.5, 0.25)},
        "ball": {"type": "diffuse", "albedo": (0.25, 0.5, 0.75)},
        "mirror": {"type": "mirror", "albedo": (0.9, 0.8, 0.7)},
    },
    "spheres": [((-1.0, 0.0, 0.0), 1.0, "ball"), ((1.25, 0.0, 0.5), 1.0, "mirror")],
    "triangles": [(corners, "floor") for corners in quad(CORNERS)],
    "lights": [((2.0, 4.0, 2.0), (60.0, 40.0, 20.0), 0.5)],
}


def scene(base=BASE, move=lambda p: p, turn=lambda v: v, scale=1.0, power=1.0):
    """Return the scene with points moved, directions turned, and lengths and powers scaled."""
    point = lambda p: np.asarray(move(np.asarray(p, float)))  # noqa: E731
    camera = base["camera"]
    return jaxrt.build(
        {
            "camera": camera
            | {"position": point(camera["position"]), "target": point(camera["target"])}
            | {"up": np.asarray(turn(np.asarray(camera["up"], float))), "width": 8, "height": 8},
            "materials": base["materials"],
            "spheres": [
                {"center": point(c), "radius": r * scale, "material": m} for c, r, m in base["spheres"]
            ],
            "triangles": [
                {"vertices": [point(v) for v in corners], "material": m} for corners, m in base["triangles"]
            ],
            "lights": [
                {"position": point(p), "intensity": np.multiply(i, power), "radius": r * scale}
                for p, i, r in base["lights"]
            ],
        }
    )


def shot(scene, key=0, spp=16):
    image = jaxrt.render(scene, key, spp=spp, max_depth=3, devices=jax.devices()[:1])
    return np.asarray(image, np.float64)


def largest_z(a, b):
    """Return the largest |t| of block means of two scenes, in units of its bound: 2 × 2 blocks × 3 channels."""

    def blocks(scene, first, flip=False):
        pictures = np.stack([shot(scene, key, 64) for key in range(first, first + SEEDS)])
        pictures = pictures[:, :, ::-1] if flip else pictures
        return pictures.reshape(SEEDS, 2, 4, 2, 4, 3).mean((2, 4))

    x, y = blocks(a, 0), blocks(*b, first=1000) if isinstance(b, tuple) else blocks(b, 1000)
    t = (x.mean(0) - y.mean(0)) / np.sqrt((x.var(0, ddof=1) + y.var(0, ddof=1)) / SEEDS)
    return abs(t).max() / stats.t.isf((1 - (1 - 1e-4) ** (1 / t.size)) / 2, 2 * SEEDS - 2)
