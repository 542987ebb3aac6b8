"""Errors and CPU times of several methods, side by side in one run."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from rich.progress import Progress

from benchmarks.chart.curves import Curves, point_of
from benchmarks.chart.subjects import Draw
from benchmarks.samplers import Reference

WARM_UP = 500_000  # seed of the calls that compile, whose images and times do not count


class Sweep(NamedTuple):
    """How many samples a pixel, and how many seeds."""

    short: tuple[int, ...]  # numbers of samples drawn with all seeds
    long: tuple[int, ...]  # and those drawn with few
    seeds: int
    few: int

    def up_to(self, spp: int) -> "Sweep":
        """Return the sweep without longer runs than `spp`."""
        short, long = (tuple(n for n in lengths if n <= spp) for lengths in (self.short, self.long))
        return self._replace(short=short, long=long)


class Metric(NamedTuple):
    """An error: of what, against what."""

    reference: Reference
    scale: float  # what errors are relative to
    reduce: Callable[[np.ndarray], np.ndarray] = lambda image: image

    def squared(self, image: np.ndarray) -> float:
        """Return the mean square error of an image, less the part that is the reference's own."""
        return float(((self.reduce(image) - self.reference.image) ** 2).mean()) - self.reference.variance


def relative_to_mean(reference: Reference) -> Metric:
    """Return the metric of pictures: RMSE over the mean of the reference."""
    return Metric(reference, float(reference.image.mean()))


Records = dict[str, dict[int, list[tuple[list[float], float]]]]  # method -> spp -> (squared errors, seconds) per image


def measure(methods: dict[str, Draw], sweep: Sweep, metrics: list[Metric], progress: Progress) -> list[Curves]:
    """Return the curves of each metric. Methods alternate within a seed: a drift of the machine hits all alike."""
    records: Records = {name: {} for name in methods}
    for draw in methods.values():
        for n in sweep.short:  # some compile anew for each length
            draw(WARM_UP, [n])
    for seed in progress.track(range(sweep.seeds), description="seeds"):
        runs = [[n] for n in sweep.short] + ([list(sweep.long)] if sweep.long and seed < sweep.few else [])
        for run in runs:
            for name, draw in methods.items():
                for spp, (image, seconds) in draw(seed, run).items():
                    squared = [metric.squared(image) for metric in metrics]
                    records[name].setdefault(spp, []).append((squared, seconds))
    return [_curves(records, i, metric.scale) for i, metric in enumerate(metrics)]


def _curves(records: Records, i: int, scale: float) -> Curves:
    curves: Curves = {}
    for name, lengths in records.items():
        curves[name] = [
            point_of(spp, np.array([squared[i] for squared, _ in images]), [s for _, s in images], scale)
            for spp, images in sorted(lengths.items())
        ]
    return curves
