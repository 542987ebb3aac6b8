"""Derivative pictures of each row: finite differences, without edges, with edges."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.edge_rows import Result
from jaxrt.core.writing import write_whole

ACROSS = 2  # rows side by side
LABELS = "finite differences", "without edges", "with edges"
INCH = 1.15  # of a picture


def draw(path: Path, results: Sequence[Result]) -> None:
    """Save three pictures for each row, red where the picture brightens and blue where it darkens."""
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot

    down, wide = -(-len(results) // ACROSS), len(LABELS)
    size = ACROSS * wide * INCH, down * (INCH + 0.28)
    figure, axes = pyplot.subplots(down, ACROSS * wide, figsize=size, layout="constrained", squeeze=False)
    for axis in axes.flat:
        axis.set_axis_off()
    for number, found in enumerate(results):
        row, block = number % down, number // down
        limit = np.percentile(np.abs(found.pictures[0].mean(-1)), 99.5)
        for column, (picture, label) in enumerate(zip(found.pictures, LABELS, strict=True)):
            axis = axes[row, block * wide + column]
            axis.set_axis_on()
            axis.imshow(picture.mean(-1), cmap="RdBu_r", vmin=-limit, vmax=limit)
            axis.set(xticks=[], yticks=[])
            if row == 0:
                axis.set_title(label + "\n", fontsize=8)
        axes[row, block * wide + 1].set_xlabel(found.row.name, fontsize=7)
    write_whole(path, lambda file: figure.savefig(file, format="png", dpi=110))
