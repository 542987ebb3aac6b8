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
    ),
    "edges-mirrors": (
        "mirror ball, ball x",
        "mirror ball, light x",
        "mirror ball, camera x",
        "flat mirror, ball x",
        "flat mirror, ball radius",
        "flat mirror, camera x",
    ),
    "edges-glass": (
        "glass ball, ball x",
        "glass ball, light x",
        "glass ball, ior",
    ),
    "edges-indirect": (
        "ball in a corner, indirect part, depth 3, x",
        "ball in a corner, indirect part, depth 3, y",
    ),
}
COLUMNS = "the picture", "finite differences", "without edges", "with edges"
SPP = 256  # of the picture
ROOM = 1.2  # of the colours, beyond what all but a hundredth of the finite differences need
INCH, MARGIN, HEAD, GAP = 1.8, 1.6, 0.28, 0.06  # of a picture, of the words beside it, above all, and between
DPI = 110


def whole(chosen: Sequence[Row]) -> list[str]:
    """Return the sheets all of whose rows are among these."""
    have = {row.name for row in chosen}
    return [sheet for sheet, names in SHEETS.items() if have.issuperset(names)]


def size_of(lines: int) -> tuple[int, int]:
    """Return the columns and rows of a sheet of so many lines."""
    across, down = _inches(lines)
    return int(across * DPI), int(down * DPI)


def _inches(lines: int) -> tuple[float, float]:
    return MARGIN + len(COLUMNS) * (INCH + GAP), HEAD + lines * (INCH + GAP)


def draw(folder: Path, results: Sequence[Result]) -> None:
    """Save the sheets all of whose rows are among these."""
    found = {each.row.name: each for each in results}
    for sheet in whole([each.row for each in results]):
        _sheet(folder / f"{sheet}.png", [found[name] for name in SHEETS[sheet]])


def _sheet(path: Path, results: Sequence[Result]) -> None:
    """Save four pictures for each row: of derivatives red where it brightens and blue where it darkens."""
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot

    across, down = _inches(len(results))
    figure = pyplot.figure(figsize=(across, down))
    for line, found in enumerate(results):
        bottom = down - HEAD - (line + 1) * (INCH + GAP) + GAP
        slopes = [picture.mean(-1) for picture in found.pictures]
        size = np.abs(slopes[0])
        part = _where(size > np.percentile(size, 99.5) / 50)
        limit = ROOM * float(np.percentile(size[part], 99))
        pictures = _shown(found.row, part), *(slope[part] for slope in slopes)
        for column, (picture, title) in enumerate(zip(pictures, COLUMNS, strict=True)):
            left = MARGIN + column * (INCH + GAP)
            axis = figure.add_axes((left / across, bottom / down, INCH / across, INCH / down))
            axis.imshow(picture, cmap="RdBu_r", vmin=-limit, vmax=limit, interpolation="nearest")
            axis.set(xticks=[], yticks=[])
            if line == 0:
                axis.set_title(title, fontsize=9, pad=4)
        words = "\n".join((*wrap(found.row.name, 24), "", f"from {-limit:.2g} to {limit:.2g}"))
        figure.text(0.05 / across, (bottom + INCH / 2) / down, words, fontsize=8, va="center")
    write_whole(path, lambda file: figure.savefig(file, format="png", dpi=DPI))
    pyplot.close(figure)


def _where(changes: np.ndarray) -> tuple[slice, slice]:
    """Return a square part of the picture, at least a quarter of its side, with all that changes and some around it."""
    spans = [np.flatnonzero(changes.any(axis)) for axis in (1, 0)]
    half = max(max(span[-1] - span[0] for span in spans) / 2 + 3, len(changes) / 8)
    starts = [max(0, int((span[0] + span[-1]) / 2 + 0.5 - half)) for span in spans]
    side = min(int(2 * half), len(changes))
    starts = [min(start, len(changes) - side) for start in starts]
    return slice(starts[0], starts[0] + side), slice(starts[1], starts[1] + side)


def _shown(row: Row, part: tuple[slice, slice]) -> np.ndarray:
    """Return a part of the picture that is differentiated, as screens show it, its brightest hundredth white."""
    picture = np.asarray(jax.jit(lambda key: view(row, built(row), key, SPP))(0))[part]
    return np.clip(picture / max(float(np.percentile(picture, 99)), 1e-6), 0, 1) ** (1 / 2.2)
