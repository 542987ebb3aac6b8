"""Figures of the chart of moving edges."""

import numpy as np

from benchmarks.chart.curves import Curves, Point, by_scene, error_at
from benchmarks.chart.edges import GUIDING, PANELS, PEER_SPP, SAMPLES, SPP, WITHOUT
from benchmarks.chart.figures import Figures, markdown, peers_of, percent, two_digits
from benchmarks.chart.studies import Study

TIME = 0.5  # CPU seconds in which methods are compared


def edge_figures(study: Study) -> Figures:
    """Return what derivatives with moving edges reach in each scene, and in what time."""
    scenes, compiled = by_scene(study.curves), study.facts["compile"].values()
    left = [curves[WITHOUT][-1].error for curves in scenes.values()]
    rows = [_row(scene, curves, study.facts["floors"][scene]) for scene, curves in scenes.items()]
    return {
        "table_edges": markdown([_head(), *rows]),
        "edges_time": two_digits(TIME),
        "edges_samples": str(SAMPLES),
        "edges_spp": " or ".join(map(str, SPP.values())),
        "edges_left": f"{percent(min(left))} to {percent(max(left))}",
        "edges_first": str(PEER_SPP),
        "edges_guiding": str(GUIDING),
        "edges_silent": _silent(study, scenes),
        "edges_step": percent(max(study.facts["steps"].values())),
        "edges_compile": _between([each["with edges"] for each in compiled]),
        "edges_compile_inside": _between([each[WITHOUT] for each in compiled]),
    }


def _head() -> list[str]:
    edges = [f"{samples} : 16" for samples in (1, 4, 16)]
    return ["", "by, events", WITHOUT, *edges, "Mitsuba", "Mitsuba's last", "noise of the reference"]


def _row(scene: str, curves: Curves, floor: float) -> list[str]:
    """Return the errors in a given time, Mitsuba's last one, and the noise of what they are measured against."""
    (row,) = (panel.of for panel in PANELS if panel.title == scene)
    theirs = next((curves[name] for name in peers_of(curves)), [])
    told = [_error(curves[name]) for name in SPP] + [_error(theirs), _end(theirs)]
    return [scene, f"`{row.parameter}`, {row.depth}", percent(curves[WITHOUT][-1].error), *told, percent(floor)]


def _error(points: list[Point]) -> str:
    (error,) = error_at(points, np.array([TIME]))
    return percent(error) if np.isfinite(error) else "–"


def _end(points: list[Point]) -> str:
    return f"{percent(points[-1].error)} in {two_digits(points[-1].seconds)} s" if points else "–"


def _silent(study: Study, scenes: dict[str, Curves]) -> str:
    """Return what Mitsuba says where it has no answer, and where it was not asked."""
    said = [f"{scene}: “{word}”" for scene, told in study.facts["silent"].items() for word in told.values()]
    unasked = [scene for scene in scenes if scene not in study.facts["silent"]]
    answers = [f"To some it has no answer ({'; '.join(said)})."] if said else []
    return " ".join([*answers, f"Not measured of it: {', '.join(unasked)}."] if unasked else answers)


def _between(seconds: list[float]) -> str:
    return f"{two_digits(min(seconds))} to {two_digits(max(seconds))}"
