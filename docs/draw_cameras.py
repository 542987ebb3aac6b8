"""Draw docs/cameras.png: rows of balls in a room as each camera sees them, from the project's root."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import jaxrt
from jaxrt.io.color import gamma_encode

PAGE = Path(__file__).with_name("cameras.md")
WIDTH, HEIGHT = 240, 180
PINHOLE = HEIGHT / 2 / np.tan(np.radians(35))  # focal length in pixels, of 70 degrees
BENT = {"fx": PINHOLE, "fy": PINHOLE, "k1": -0.25, "k2": 0.04}
KINDS: dict[str, dict[str, Any]] = {
    "pinhole": {"type": "pinhole", "fov": 70},
    "calibrated, k1 = −0.25": {"type": "calibrated", **BENT},
    "orthographic": {"type": "orthographic", "tall": 8},
    "fisheye, 180°": {"type": "fisheye", "angle": 180},
    "equirectangular": {"type": "equirectangular"},
    "thin lens": {"type": "thin_lens", "fov": 70, "focus": 3.2, "aperture": 0.5},
}


def described(camera: dict[str, Any]) -> dict[str, Any]:
    """Return a room of three layers of balls, of a colour each, before a camera."""
    walls = {"floor": 0.5, "left": 0.6, "back": 0.7}
    colours = {"near": [0.8, 0.3, 0.2], "middle": [0.8, 0.7, 0.2], "far": [0.2, 0.5, 0.8]}
    materials = {name: {"type": "diffuse", "albedo": [x] * 3} for name, x in walls.items()}
    materials |= {name: {"type": "diffuse", "albedo": x} for name, x in colours.items()}
    around = [(1000 * axis, i) for i, axis in enumerate((*np.eye(3), *-np.eye(3)))]
    names = ["left", "floor", "back"]
    spheres = [{"center": (axis * 1.006).tolist(), "radius": 1000, "material": names[i % 3]} for axis, i in around]
    for name, z in {"near": 0, "middle": -2, "far": -4}.items():
        for x in range(-4, 5, 2):
            for y in range(-3, 4, 2):
                spheres.append({"center": [x, y, z], "radius": 0.35, "material": name})
    stands = {"position": [0, 0, 3.2], "target": [0, 0, 0], "width": WIDTH, "height": HEIGHT}
    lights = [{"position": [2, 5, 3], "intensity": 60, "radius": 0.4}]
    return {"camera": {**stands, **camera}, "materials": materials, "spheres": spheres, "lights": lights}


def draw() -> None:
    """Write the pictures."""
    figure = Figure(figsize=(9, 4.9), layout="constrained")
    for axes, (title, camera) in zip(figure.subplots(2, 3).flat, KINDS.items(), strict=True):
        picture = np.asarray(jaxrt.render(jaxrt.build(described(camera)), 0, spp=64, max_depth=3))
        axes.imshow(np.clip(gamma_encode(picture / np.quantile(picture, 0.99)), 0, 1))
        axes.set_title(title, fontsize=10)
        axes.set_axis_off()
    figure.savefig(PAGE.with_suffix(".png"), dpi=90)


if __name__ == "__main__":
    draw()
