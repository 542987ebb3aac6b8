"""Make scenes/mug.obj: a thick-walled mug with a handle, in 264 faces.

Run `python docs/make_mug.py` from the project's root. Units: the mug is 2 high and wide, about its middle; its handle
is at +x.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Faces = list[tuple[int, ...]]
WALL = ((1.0, -1.0), (1.0, 1.0), (0.88, 1.0), (0.88, -0.85))  # radius and height of the rings around
AROUND, BEND, TUBE = 20, 8, 6  # faces around the mug, along the handle and around it
HANDLE, THICKNESS = 0.62, 0.14  # radii


def cup() -> tuple[Floats, Faces]:
    """Return vertices and faces of the mug without its handle."""
    turn = 2 * np.pi * np.arange(AROUND) / AROUND
    rings = [np.stack([r * np.cos(turn), np.full(AROUND, y), r * np.sin(turn)], -1) for r, y in WALL]
    middles = np.array([[0, WALL[0][1], 0], [0, WALL[-1][1], 0]])
    bottom, last = len(WALL) * AROUND, (len(WALL) - 1) * AROUND
    faces: Faces = []
    for i, j in ((i, (i + 1) % AROUND) for i in range(AROUND)):
        for low in range(0, last, AROUND):
            high = low + AROUND
            faces += [(low + i, high + j, low + j), (low + i, high + i, high + j)]
        faces += [(bottom, i, j), (bottom + 1, last + j, last + i)]
    return np.concatenate([*rings, middles]), faces


def handle() -> tuple[Floats, Faces]:
    """Return vertices and faces of the handle, a bent tube whose ends are within the wall."""
    middle = np.array([(WALL[0][0] + WALL[-1][0]) / 2, 0, 0])
    bend, turn = np.linspace(-np.pi / 2, np.pi / 2, BEND + 1), 2 * np.pi * np.arange(TUBE) / TUBE
    outwards = np.stack([np.cos(bend), np.sin(bend), np.zeros(BEND + 1)], -1)
    around = np.cos(turn)[:, None] * outwards[:, None] + np.sin(turn)[:, None] * np.array([0, 0, 1])
    vertices = (middle + HANDLE * outwards)[:, None] + THICKNESS * around
    faces: Faces = []
    for i, j in ((i, (i + 1) % TUBE) for i in range(TUBE)):
        for low in range(0, BEND * TUBE, TUBE):
            high = low + TUBE
            faces += [(low + i, low + j, high + j), (low + i, high + j, high + i)]
    end = BEND * TUBE
    for i in range(1, TUBE - 1):
        faces += [(0, i + 1, i), (end, end + i, end + i + 1)]
    return vertices.reshape(-1, 3), faces


def write_obj(path: Path) -> None:
    """Write the mug as an OBJ file."""
    (vertices, faces), (more, others) = cup(), handle()
    faces += [tuple(corner + len(vertices) for corner in face) for face in others]
    rows = ["v {:.5g} {:.5g} {:.5g}\n".format(*(vertex + 0.0)) for vertex in np.concatenate([vertices, more])]
    rows += ["f {} {} {}\n".format(*(corner + 1 for corner in face)) for face in faces]
    path.write_text("# A mug, made by docs/make_mug.py\n" + "".join(rows))


if __name__ == "__main__":
    write_obj(Path("scenes/mug.obj"))
