"""A chart of several scenes: a panel for each, with the same axes, and one legend for all."""

from pathlib import Path
from typing import Any

from matplotlib import pyplot

from benchmarks.chart.curves import all_points, by_scene
from benchmarks.chart.drawing import Chart, coordinates, save_figure, styles_of, write_shares
from benchmarks.chart.studies import Study

COLUMNS = 3
NOISE = "noise of the reference"


def draw_panels(stem: Path, chart: Chart, study: Study) -> None:
    """Save the chart as `stem`.png and `stem`.svg."""
    scenes = by_scene(study.curves)
    rows = -(-len(scenes) // COLUMNS)
    size = 8.6, 2.5 * rows + 0.8
    figure, grid = pyplot.subplots(
        rows, COLUMNS, figsize=size, layout="constrained", sharex=True, sharey=True, squeeze=False
    )
    styles = styles_of(list(dict.fromkeys(name for curves in scenes.values() for name in curves)), chart)
    lines: dict[str, Any] = {}
    for axes, (scene, curves) in zip(grid.flat, scenes.items(), strict=False):
        for name in (name for name in styles if name in curves):
            shown = [p for p in curves[name] if p.error > 0]
            (lines[name],) = axes.plot(*coordinates(shown), marker="o", markersize=3, linewidth=1.4, **styles[name])
        lines[NOISE] = axes.axhline(study.facts["floors"][scene], color="0.6", linewidth=1, linestyle=":")
        axes.set(xscale="log", yscale="log")
        axes.set_title(scene, fontsize=9)
        axes.tick_params(labelsize=7)
        write_shares(axes)
    errors = [p.error for p in all_points(study.curves) if p.error > 0]
    grid[0, 0].set_ylim(0.5 * min(errors), 1.5 * max(errors))
    for axes in grid.flat[len(scenes) :]:
        axes.set_visible(False)
    grid[-1, 0].set_xlabel("CPU seconds of a derivative, one core", fontsize=8)
    for axes in grid[:, 0]:
        axes.set_ylabel(chart.error, fontsize=8)
    order = [name for name in (*styles, NOISE) if name in lines]
    figure.suptitle(chart.title, fontsize=11)
    figure.legend(
        [lines[name] for name in order], order, loc="outside lower center", ncols=3, fontsize=8, frameon=False
    )
    save_figure(figure, stem)
