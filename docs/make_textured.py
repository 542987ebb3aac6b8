"""Make what textures are shown on: scenes/vase.obj, scenes/knot.obj, and the pictures majolica.png and wood.png.

Run `python docs/make_textured.py` from the project's root. Units: the vase is 2.4 high and stands on y = 0; u goes once
around it, v from its foot to its lip. The knot, which has colours at its vertices, is 2 wide, about its middle.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

Floats = NDArray[np.float64]
PROFILE = ((0.5, 0), (0.46, 0.12), (0.72, 0.55), (0.86, 1.05), (0.7, 1.6), (0.4, 1.95), (0.36, 2.15), (0.52, 2.4))
AROUND, RINGS = 48, 32  # faces around the vase and along its side
ALONG, TUBE, THICKNESS = 120, 12, 0.24  # faces along the knot and around its tube, and the tube's radius
BLUE, OCHRE, WHITE, GREEN = ((0.08, 0.16, 0.55), (0.85, 0.55, 0.1), (0.93, 0.91, 0.86), (0.1, 0.42, 0.22))  # sRGB
LIGHT_WOOD, DARK_WOOD = (0.82, 0.6, 0.38), (0.46, 0.27, 0.14)


def side() -> Floats:
    """Return radius and height (RINGS + 1, 2) along the side: a smooth curve through the profile, evenly long steps."""
    knots = np.asarray(PROFILE)
    t = np.linspace(0, len(knots) - 1, 2000)
    i = np.clip(t.astype(int), 0, len(knots) - 2)
    s = (t - i)[:, None]
    slopes = np.gradient(knots, axis=0)
    a, b, da, db = knots[i], knots[i + 1], slopes[i], slopes[i + 1]
    curve = a + s * da + s**2 * (3 * (b - a) - 2 * da - db) + s**3 * (2 * (a - b) + da + db)
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    even = np.linspace(0, length[-1], RINGS + 1)
    return np.stack([np.interp(even, length, column) for column in curve.T], -1)


def write_vase(path: Path) -> None:
    """Write the vase, with `vt`."""
    turn = 2 * np.pi * np.arange(AROUND) / AROUND
    rows = []
    for radius, height in side():
        places = np.stack([radius * np.sin(turn), np.full(AROUND, height), radius * np.cos(turn)], -1)
        rows += ["v {:.5g} {:.5g} {:.5g}\n".format(*(place + 0.0)) for place in places]
    for v in np.linspace(0, 1, RINGS + 1):
        rows += [f"vt {u:.5g} {v:.5g}\n" for u in np.linspace(0, 1, AROUND + 1)]
    for ring in range(RINGS):
        for i in range(AROUND):
            corners = ((ring, i), (ring, i + 1), (ring + 1, i + 1), (ring + 1, i))
            words = [f"{AROUND * r + c % AROUND + 1}/{(AROUND + 1) * r + c + 1}" for r, c in corners]
            rows.append(f"f {' '.join(words)}\n")
    path.write_text("# A vase, made by docs/make_textured.py\n" + "".join(rows))


def write_knot(path: Path) -> None:
    """Write a trefoil knot, with colours, sRGB, behind `v`, that go once through all hues along it."""
    t = 2 * np.pi * np.arange(ALONG) / ALONG
    reach = 2 + np.cos(3 * t)
    curve = np.stack([reach * np.cos(2 * t), reach * np.sin(2 * t), 1.2 * np.sin(3 * t)], -1) / 3
    along = np.roll(curve, -1, 0) - np.roll(curve, 1, 0)
    aside = np.cross(along, np.stack([np.cos(2 * t), np.sin(2 * t), 0 * t], -1))
    aside /= np.linalg.norm(aside, axis=1)[:, None]
    across = np.cross(aside, along / np.linalg.norm(along, axis=1)[:, None])
    turn = 2 * np.pi * np.arange(TUBE)[:, None, None] / TUBE
    places = curve + THICKNESS * (np.cos(turn) * aside + np.sin(turn) * across)
    colors = 0.55 + 0.38 * np.cos(t[:, None] + 2 * np.pi * np.arange(3) / 3)
    rows = []
    for ring in places.transpose(1, 0, 2):
        rows += ["v {:.5g} {:.5g} {:.5g}".format(*(place + 0.0)) for place in ring]
    rows = [f"{row} {' '.join(f'{c:.3g}' for c in colors[i // TUBE])}\n" for i, row in enumerate(rows)]
    for i, j in ((i, j) for i in range(ALONG) for j in range(TUBE)):
        corners = ((i, j), (i, j + 1), (i + 1, j + 1), (i + 1, j))
        rows.append(f"f {' '.join(str(a % ALONG * TUBE + b % TUBE + 1) for a, b in corners)}\n")
    path.write_text("# A trefoil knot, made by docs/make_textured.py\n" + "".join(rows))


def grid(size: int) -> tuple[Floats, Floats]:
    """Return u and v (size, size) of a picture's texels, the first row on top."""
    middle = (np.arange(size) + 0.5) / size
    u, v = np.meshgrid(middle, middle[::-1])
    return u, v


def majolica(size: int = 128) -> Floats:
    """Return a painted pattern (size, size, 3), sRGB: bands, waves, leaves and dots, that closes around."""
    u, v = grid(size)
    picture = np.broadcast_to(WHITE, (size, size, 3)).copy()

    def paint(where: NDArray[np.bool_], color: tuple[float, ...]) -> None:
        picture[where] = color

    for low, high, color in ((0, 0.07, BLUE), (0.07, 0.1, OCHRE), (0.24, 0.26, BLUE), (0.74, 0.76, BLUE),
                             (0.9, 0.93, OCHRE), (0.93, 1, BLUE)):  # fmt: skip
        paint((v >= low) & (v < high), color)
    paint(np.abs(v - 0.17 - 0.035 * np.sin(2 * np.pi * 12 * u)) < 0.014, BLUE)
    cell, across = 8 * u % 1 - 0.5, (v - 0.5) / 0.22
    for turn in (-1, 1):
        x, y = cell + turn * 0.45 * across, across
        paint((x / 0.16) ** 2 + (y / 0.75) ** 2 < 1, GREEN if turn < 0 else BLUE)
        paint((x / 0.04) ** 2 + (y / 0.6) ** 2 < 1, WHITE)
    paint(((8 * u % 1) - 0.5) ** 2 + ((v - 0.5) / 0.13) ** 2 < 0.035, OCHRE)
    paint((((16 * u) % 1 - 0.5) / 16) ** 2 + (v - 0.83) ** 2 < 0.022**2, OCHRE)
    return picture


def waves(u: Floats, v: Floats, seed: int, across: int, along: int, power: float) -> Floats:
    """Return periodic noise of waves, up to `across` in a unit of u and `along` in one of v."""
    draw, total = np.random.default_rng(seed), np.zeros_like(u)
    for _ in range(60):
        i, j = draw.integers(-across, across + 1), draw.integers(-along, along + 1)
        size = 1 / (1 + np.hypot(i, j)) ** power
        total += size * np.cos(2 * np.pi * (i * u + j * v) + draw.uniform(0, 2 * np.pi))
    return total


def wood(size: int = 256) -> Floats:
    """Return wood (size, size, 3), sRGB: year rings cut lengthwise and fibres, that repeats without a seam."""
    u, v = grid(size)
    year = (5 * np.cos(2 * np.pi * u) + waves(u, v, 2, 2, 1, 1.2) + 0.2 * waves(u, v, 1, 6, 2, 0.8)) % 1
    share = np.where(year < 0.8, (year / 0.8) ** 2, (1 - year) / 0.2)
    fibres = waves(u, v, 3, 110, 4, 0.35)
    share = np.clip(0.75 * share + 0.13 * fibres / np.std(fibres), 0, 1)[..., None]
    return (1 - share) * LIGHT_WOOD + share * DARK_WOOD


if __name__ == "__main__":
    write_vase(Path("scenes/vase.obj"))
    write_knot(Path("scenes/knot.obj"))
    for name, picture in (("majolica", majolica()), ("wood", wood())):
        Image.fromarray(np.rint(255 * picture).astype(np.uint8)).save(f"scenes/{name}.png")
