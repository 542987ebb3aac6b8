"""Sheets of derivative pictures, a line for each row: the picture, finite differences, without edges, with edges."""

from collections.abc import Sequence
from pathlib import Path
from textwrap import wrap

import jax
import numpy as np

from benchmarks.edge_rows import Result, view
from benchmarks.edge_scenes import Row, built
from jaxrt.core.writing import write_whole

# Of docs/derivatives.md, each with the rows on it
SHEETS = {
    "edges-sky": (
        "plane under a black ball, height",
        "ball over floor, sky, depth 1, height",
        "ball over floor, sky, depth 2, sideways",
        "round mesh over floor, sky, height",
        "box over floor, sky, turn",
        "box, sky .1 beside a lamp, x",
        "box, sky .1 beside a lamp, turn",
        "box, sky .1 beside a lamp, scale",
    ),
    "edges-crossings": (
        "half-sunk ball, radius",
        "half-sunk ball, x",
        "room of balls, camera x",
        "room of balls, fov",
        "two boxes that overlap, x",
        "two boxes that overlap, y",
        "ball in a corner, indirect part, depth 3, x",
        "ball in a corner, indirect part, depth 3, y",
    ),
    "edges-mirrors": (
        "mirror ball, ball x",
        "mirror ball, light x",
        "mirror ball, camera x",
        "flat mirror, ball x",
        "flat mirror, camera x",
        "glass ball, ball x",
        "glass ball, light x",
        "glass ball, ior",
    ),
}
COLUMNS = "the picture", "finite differences", "without edges", "with edges"
SPP = 256  # of the picture
INCH, MARGIN, HEAD, GAP = 1.8, 1.6, 0.28, 0.06  # of a picture, of the words beside it, above all, and between
DPI = 110


def drawn(row: Row) -> bool:
    """Return whether the row is on a sheet."""
    return any(row.name in names for names in SHEETS.values())


def draw(folder: Path, results: Sequence[Result]) -> None:
    """Save the sheets that have one of these rows, as far as they have them."""
    for sheet, names in SHEETS.items():
        found = [each for name in names for each in results if each.row.name == name]
        if found:
            _sheet(folder / f"{sheet}.png", found)


def _sheet(path: Path, results: Sequence[Result]) -> None:
    """Save four pictures for each row: of derivatives red where it brightens and blue where it darkens."""
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot

    across, down = MARGIN + len(COLUMNS) * (INCH + GAP), HEAD + len(results) * (INCH + GAP)
    figure = pyplot.figure(figsize=(across, down))
    for line, found in enumerate(results):
        bottom = down - HEAD - (line + 1) * (INCH + GAP) + GAP
        limit = float(np.percentile(np.abs(found.pictures[0].mean(-1)), 99.5))
        shown = _shown(found.row), *(picture.mean(-1) for picture in found.pictures)
        for column, (picture, title) in enumerate(zip(shown, COLUMNS, strict=True)):
            left = MARGIN + column * (INCH + GAP)
            axis = figure.add_axes((left / across, bottom / down, INCH / across, INCH / down))
            axis.imshow(picture, cmap="RdBu_r", vmin=-limit, vmax=limit, interpolation="nearest")
            axis.set(xticks=[], yticks=[])
            if line == 0:
                axis.set_title(title, fontsize=9, pad=4)
        words = "\n".join((*wrap(found.row.name, 22), "", *_told(found), f"colours: ± {limit:.2g}"))
        figure.text(0.05 / across, (bottom + INCH / 2) / down, words, fontsize=8, va="center")
    write_whole(path, lambda file: figure.savefig(file, format="png", dpi=DPI))
    pyplot.close(figure)


def _told(found: Result) -> tuple[str, str, str]:
    """Return how far derivatives without edges and with them are off."""
    return "off without edges:", f"{found.interior:.3f}; with them:", f"{found.error:.4f} ± {found.noise:.4f}"


def _shown(row: Row) -> np.ndarray:
    """Return the picture that is differentiated, as screens show it, its brightest hundredth white."""
    picture = np.asarray(jax.jit(lambda key: view(row, built(row), key, SPP))(0))
    return np.clip(picture / max(float(np.percentile(picture, 99)), 1e-6), 0, 1) ** (1 / 2.2)
