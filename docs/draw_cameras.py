"""Draw the pictures of docs/cameras.md: one room, seen by each camera. From the project's root."""

from pathlib import Path
from typing import Any

import jaxrt

FOLDER = Path(__file__).with_name("cameras")
STAND = {"position": [1.2, 1.1, 4.2], "target": [0.2, -0.2, 0], "width": 200, "height": 160}
CAMERAS: dict[str, dict[str, Any]] = {
    "pinhole": {"fov": 55},
    "calibrated": {"fx": 150, "fy": 150, "k1": -0.25, "k2": 0.05},
    "orthographic": {"tall": 3.2},
    "thin_lens": {"fov": 55, "focus": 3.2, "aperture": 0.6},
    "fisheye": {"angle": 180},
    "equirectangular": {"width": 320},
}
COLOURS = {
    "grey": [0.6, 0.6, 0.6],
    "white": [0.85, 0.85, 0.85],
    "green": [0.3, 0.7, 0.3],
    "red": [0.8, 0.3, 0.3],
    "blue": [0.3, 0.4, 0.8],
    "sand": [0.7, 0.6, 0.3],
    "orange": [0.9, 0.5, 0.1],
    "teal": [0.1, 0.6, 0.6],
}
# Walls are balls of radius 1000: floor, ceiling, left, right, back and front; then balls in a row
PLACES = {(0, -1001, 0): "grey", (0, 1003, 0): "white", (-1002.5, 0, 0): "green", (1003.5, 0, 0): "red"}
PLACES |= {(0, 0, -1002.5): "blue", (0, 0, 1006): "sand"}
BALLS = {
    (-1.4, -0.5, -1.4): "white",
    (-0.4, -0.5, -0.4): "orange",
    (0.5, -0.5, 0.7): "teal",
    (1.4, -0.5, 1.7): "orange",
}


def room(kind: str) -> dict[str, Any]:
    """Return the room before a camera."""
    return {
        "camera": {"type": kind, **STAND, **CAMERAS[kind]},
        "render": {"spp": 64, "max_depth": 3},
        "materials": {name: {"type": "diffuse", "albedo": albedo} for name, albedo in COLOURS.items()},
        "spheres": [
            {"center": center, "radius": radius, "material": material}
            for places, radius in ((PLACES, 1000), (BALLS, 0.5))
            for center, material in places.items()
        ],
        "lights": [{"position": [0.5, 2.2, 1.5], "radius": 0.3, "intensity": 12}],
    }


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for kind in CAMERAS:
        jaxrt.save_image(FOLDER / f"{kind}.png", jaxrt.render(jaxrt.build(room(kind)), 0))
