"""Curves of error against CPU time: unbiased errors, Pareto front, time at a given error, CSV. Pure NumPy."""

import csv
from io import StringIO
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxrt.core.writing import write_text

FIELDS = ("method", "spp", "images", "cpu_seconds", "error", "low", "high", "pareto")


class Point(NamedTuple):
    """What one method reaches with one number of samples."""

    spp: int
    images: int  # that the error is taken over, each of a seed of its own
    seconds: float  # median CPU time of an image
    error: float  # relative; 0 where it is too small to tell from the reference's own
    low: float  # one standard error over seeds below
    high: float  # and above


Curves = dict[str, list[Point]]  # method -> points of rising spp


class Crossing(NamedTuple):
    """Where a curve reaches a given error."""

    seconds: float
    spp: float
    measured: bool  # between two points, not beyond the last one or before the first


def point_of(spp: int, squared: np.ndarray, seconds: list[float], scale: float) -> Point:
    """Return the point of a method's images.

    squared: (images,) mean square error of each, less the reference's variance. scale: what errors are relative to.
    """
    mean = float(squared.mean())
    spread = float(squared.std(ddof=1) / np.sqrt(len(squared))) if len(squared) > 1 else 0.0
    roots = [float(np.sqrt(max(value, 0.0))) / scale for value in (mean, mean - spread, mean + spread)]
    return Point(spp, len(squared), float(np.median(seconds)), *roots)


def error_at(curve: list[Point], seconds: np.ndarray) -> np.ndarray:
    """Return the error (n,) that a method reaches in the time given: ∞ before its first point, its last one's after it.

    In between along the straight line, log-log: the number of samples is free to choose.
    """
    points = [p for p in curve if p.error > 0]
    if not points:
        return np.full(len(seconds), np.inf)
    times, errors = (np.log([getattr(p, name) for p in points]) for name in ("seconds", "error"))
    order = np.argsort(times, kind="stable")
    found = np.exp(np.interp(np.log(seconds), times[order], errors[order]))
    return np.where(np.log(seconds) < times.min(), np.inf, found)


def envelope(curves: Curves, count: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """Return times (count,) and the least error that any method reaches by then: the Pareto front as a line."""
    times = [p.seconds for p in all_points(curves) if p.error > 0]
    grid = np.geomspace(min(times), max(times), count)
    return grid, np.minimum.accumulate(np.min([error_at(points, grid) for points in curves.values()], axis=0))


def pareto_front(curves: Curves) -> list[Point]:
    """Return the points that no method beats: none reaches a smaller error in the same time or less."""
    front = []
    for name, points in curves.items():
        best = np.inf
        for point in points:
            rivals = [error_at(other, np.array([point.seconds]))[0] for key, other in curves.items() if key != name]
            if 0 < point.error < best and point.error <= min(rivals, default=np.inf):
                front.append(point)
            best = min(best, point.error) if point.error > 0 else best
    return sorted(front, key=lambda p: p.seconds)


def by_scene(curves: Curves) -> dict[str, Curves]:
    """Return the curves of each scene of a chart: its name stands before that of the method, behind a colon."""
    scenes: dict[str, Curves] = {}
    for name, points in curves.items():
        scene, _, method = name.rpartition(": ")
        scenes.setdefault(scene, {})[method] = points
    return scenes


def all_points(curves: Curves) -> list[Point]:
    """Return the points of all curves."""
    return [point for points in curves.values() for point in points]


def crossing(curve: list[Point], error: float) -> Crossing | None:
    """Return where a curve falls to `error`: along the straight line, log-log, between the two points around it.

    Before the first point the line through the first two is continued; from the last one on, a line with the
    least-squares slope of the last four. None where the curve does not fall there.
    """
    points = [p for p in curve if p.error > 0]
    if len(points) < 2:
        return None
    pairs = list(zip(points[:-1], points[1:], strict=True))
    around = [pair for pair in pairs if pair[0].error >= error >= pair[1].error]
    before = points[0].error < error
    fitted = list(around[0]) if around else points[:2] if before else points[-4:]
    if fitted[-1].error >= fitted[-2].error:
        return None
    end, errors = fitted[-1], np.log([p.error for p in fitted])
    rates = [np.polyfit(errors, np.log([getattr(p, name) for p in fitted]), 1)[0] for name in ("seconds", "spp")]
    seconds, spp = (
        float(x * (error / end.error) ** rate) for x, rate in zip((end.seconds, end.spp), rates, strict=True)
    )
    return Crossing(seconds, spp, bool(around))


def write_csv(path: Path, curves: Curves) -> None:
    """Save the points of all curves, with a mark at those of the Pareto front."""
    front = {point for scene in by_scene(curves).values() for point in pareto_front(scene)}
    text = StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(FIELDS)
    for method, points in curves.items():
        for p in points:
            numbers = [f"{value:.6g}" for value in (p.seconds, p.error, p.low, p.high)]
            writer.writerow([method, p.spp, p.images, *numbers, int(p in front)])
    write_text(path, text.getvalue())


def read_csv(path: Path) -> Curves:
    """Return the curves that `write_csv` has saved."""
    curves: Curves = {}
    with path.open(newline="") as file:
        for row in csv.DictReader(file):
            numbers = [float(row[name]) for name in FIELDS[3:7]]
            curves.setdefault(row["method"], []).append(Point(int(row["spp"]), int(row["images"]), *numbers))
    return curves
