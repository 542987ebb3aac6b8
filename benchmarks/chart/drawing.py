"""A chart of error against CPU time, as PNG and SVG."""

from pathlib import Path
from typing import Any, NamedTuple

import matplotlib

from jaxrt.core.writing import write_whole

matplotlib.use("agg")

from matplotlib import pyplot, ticker

from benchmarks.chart.curves import Point, all_points, envelope, pareto_front
from benchmarks.chart.studies import Study

# Okabe and Ito's colours, which colour-blind readers tell apart
COLOURS = ("#0072B2", "#009E73", "#56B4E9", "#CC79A7", "#882255")
PEER_COLOURS = {"Mitsuba independent": "#E69F00", "Mitsuba direct_projective": "#E69F00"}


class Chart(NamedTuple):
    """What a chart says besides its curves."""

    title: str
    error: str = "RMSE / mean of the picture"
    samples: str = ""  # the curve whose points tell their samples a pixel; default: the first
    ordered: str = ""  # curves of this prefix are steps of one quantity: colours in order
    panels: bool = False  # several scenes, side by side


def styles_of(names: list[str], chart: Chart) -> dict[str, dict[str, Any]]:
    """Return how each curve is drawn: jaxrt's with a line, Mitsuba's with dashes."""
    steps = [name for name in names if chart.ordered and name.startswith(chart.ordered)]
    styles: dict[str, dict[str, Any]] = {}
    colours, others = iter(COLOURS), iter(COLOURS[3:])
    for name in names:
        if name in steps:
            share = steps.index(name) / max(len(steps) - 1, 1)
            styles[name] = {"color": matplotlib.colormaps["viridis"](0.9 * share)}
        elif name.startswith("Mitsuba"):
            styles[name] = {"color": PEER_COLOURS.get(name, "#D55E00"), "linestyle": "--"}
        else:
            styles[name] = {"color": "0.25" if steps and not styles else next(others if steps else colours)}
    return styles


def draw_chart(stem: Path, chart: Chart, study: Study) -> None:
    """Save the chart as `stem`.png and `stem`.svg."""
    figure, axes = pyplot.subplots(figsize=(8.6, 4.8), layout="constrained")
    for name, style in styles_of(list(study.curves), chart).items():
        shown = [p for p in study.curves[name] if p.error > 0]
        axes.plot(*coordinates(shown), marker="o", markersize=4, linewidth=1.5, label=name, zorder=3, **style)
        if name in study.facts.get("floors", {}):
            _draw_floor(axes, study.facts["floors"][name], shown, style["color"])
    front = pareto_front(study.curves)
    grid, best = envelope(study.curves)
    until = grid <= front[-1].seconds
    axes.plot(grid[until], best[until], color="0.82", linewidth=8, zorder=1, label="Pareto front")
    ring: dict[str, Any] = {
        "linestyle": "",
        "marker": "o",
        "markersize": 8,
        "markerfacecolor": "none",
        "markeredgecolor": "0.3",
    }
    axes.plot(*coordinates(front), **ring, zorder=4, label="point on the front")
    _label_samples(axes, study.curves.get(chart.samples, next(iter(study.curves.values()))))
    _finish(axes, chart, study)
    figure.legend(loc="outside right upper", fontsize=8, frameon=False)
    save_figure(figure, stem)


def save_figure(figure: Any, stem: Path) -> None:
    """Save a figure as `stem`.png and `stem`.svg, which is the same whenever it is drawn."""
    matplotlib.rcParams["svg.hashsalt"] = stem.name
    write_whole(stem.with_suffix(".png"), lambda file: figure.savefig(file, format="png", dpi=150))
    write_whole(stem.with_suffix(".svg"), lambda file: figure.savefig(file, format="svg", metadata={"Date": None}))
    pyplot.close(figure)


def coordinates(points: list[Point]) -> tuple[list[float], list[float]]:
    """Return the seconds and the errors of points."""
    return [p.seconds for p in points], [p.error for p in points]


def _label_samples(axes: Any, points: list[Point]) -> None:
    """Write the samples a pixel at the points of a curve, but those too near to the one before."""
    place = {"xytext": (-6, -11), "textcoords": "offset points", "ha": "right", "fontsize": 7, "color": "0.35"}
    last = 0.0
    for p in points:
        if p.error > 0 and (p.seconds > 2 * last or p.error < points[0].error / 2):
            axes.annotate(f"{p.spp} spp", (p.seconds, p.error), zorder=5, **place)
            last = p.seconds


def _draw_floor(axes: Any, floor: float, points: list[Point], colour: Any) -> None:
    """Draw the error that is left however long the render, from the last point on."""
    if floor > 0 and points:
        right = 3 * points[-1].seconds
        axes.plot([points[-1].seconds, right], [floor, floor], color=colour, linewidth=1, linestyle=":")
        axes.annotate(f" {100 * floor:.2g} %", (right, floor), fontsize=7, color=colour, va="center")


def _finish(axes: Any, chart: Chart, study: Study) -> None:
    """Set scales, labels and what is drawn across."""
    errors = [p.error for p in all_points(study.curves) if p.error > 0]
    floors = [f for f in study.facts.get("floors", {}).values() if f > 0]
    band = [0.7 * study.band] if study.band > 0 else []
    low, high = min([*(0.5 * e for e in (*errors, *floors)), *band]), 2 * max(errors)
    axes.set(xscale="log", yscale="log", ylim=(low, high), title=chart.title)
    axes.set(xlabel="CPU seconds of one picture of 64 × 64 pixels, one core", ylabel=chart.error)
    if study.band > low:
        axes.axhspan(low, study.band, color="0.94", zorder=0, label="error of the reference")
    axes.margins(x=0.09)
    write_shares(axes)


def write_shares(axes: Any) -> None:
    """Write errors as per cent, and set lines behind."""
    axes.yaxis.set_major_formatter(ticker.FuncFormatter(lambda value, _: f"{100 * value:.10g} %"))
    axes.xaxis.set_major_formatter(ticker.FuncFormatter(lambda value, _: f"{value:.10g}"))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_minor_formatter(ticker.NullFormatter())
    axes.grid(which="major", color="0.92", linewidth=0.8)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
