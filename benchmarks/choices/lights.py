"""Where on a spherical light to sample: in the cone it fills, on its visible cap, or anywhere on it."""

from typing import Any

import numpy as np

from benchmarks.alternatives import area_light
from benchmarks.choices.figures import Choice, Figure, Table, cost, error
from benchmarks.interleave import Picture, Swap, picture, spread
from benchmarks.jaxrt_side import load
from jaxrt.lights import sample_light_attached
from jaxrt.transport import path

NAME, OURS, AREA, CAP = "lights", "cone", "whole area", "visible cap"
SWAPS: dict[str, list[Swap]] = {
    OURS: [],
    AREA: [(path, "sample_light", area_light.sample_light)],
    CAP: [(path, "sample_light", sample_light_attached)],
}
SCENES = {
    "ball under a light": ("scenes/ball_under_sphere_light.toml", 1),
    "room": ("scenes/room.toml", 4),
}
SIZE, SPP, SEEDS = 64, 16, 16
REFERENCE_SPP, REFERENCE_SEEDS = 1024, 4


def rmse_in(scene: str) -> str:
    """Return the measure's name."""
    return f"RMSE in % of the mean, {scene}"


def median_in(scene: str) -> str:
    """Return the measure's name."""
    return f"error of the median pixel in %, {scene}"


def worst_in(scene: str) -> str:
    """Return the measure's name."""
    return f"squared error in the worst 1 % of pixels, %, {scene}"


def reference_of(drawn: Picture) -> tuple[np.ndarray, np.ndarray]:
    """Return a long picture, and its squared standard error (height, width, 3), from the spread of its parts."""
    seeds = range(1000, 1000 + REFERENCE_SEEDS)
    parts = np.stack([np.asarray(drawn.draw(seed, REFERENCE_SPP), float) for seed in seeds])
    return parts.mean(0), parts.var(0, ddof=1) / REFERENCE_SEEDS


def errors(drawn: Picture, truth: np.ndarray, variance: np.ndarray) -> tuple[float, float, float]:
    """Return three numbers in %: RMSE over pixels and seeds, free of the reference's own; that of the median pixel; and
    the worst 1 % of pixels' share of all squared error."""
    squares = np.mean([(np.asarray(drawn.draw(seed), float) - truth) ** 2 for seed in range(SEEDS)], axis=0)
    free = squares - variance
    lit = truth.mean(2) > 0
    whole, median = (
        100 * float(np.sqrt(max(x, 0)) / truth.mean()) for x in (free.mean(), np.median(free.mean(2)[lit]))
    )
    pixels = np.sort(squares.sum(2).ravel())[::-1]
    return whole, median, 100 * float(pixels[: len(pixels) // 100].sum() / pixels.sum())


def measure(rounds: int) -> list[Figure]:
    """Return all figures."""
    figures: list[Figure] = []
    for name, (file, depth) in SCENES.items():
        scene: Any = load(file, SIZE, SIZE)
        pictures = {v: picture(scene, SPP, depth, swaps) for v, swaps in SWAPS.items()}
        truth = reference_of(pictures[OURS])
        for v, p in pictures.items():
            whole, median, worst = errors(p, *truth)
            figures += [error(NAME, v, rmse_in(name), whole), error(NAME, v, median_in(name), median)]
            figures.append(Figure(NAME, v, worst_in(name), "note", spread([worst]), ".0f"))
        figures += cost(NAME, f"time, {name}", {v: p.again for v, p in pictures.items()}, OURS, rounds)
    return figures


def argument(t: Table) -> str:
    """Return what the figures say."""

    def times(variant: str) -> str:
        parts = []
        for name in SCENES:
            whole, median = (t(variant, f(name)) / t(OURS, f(name)) for f in (rmse_in, median_in))
            time = t(variant, f"time, {name}")
            parts.append(f"{whole:.2f} ({median:.2f} in the median pixel) in {time:.2f} of the time in *{name}*")
        return ", ".join(parts)

    return (
        f"Samples over the whole area have these multiples of the cone's error: {times(AREA)}. Half of them fall on "
        "the far side and bring nothing, and those on the near side count by how far each is. Uniform samples of the "
        "visible cap's disk, which derivatives use because they hold a place on the light fixed, have "
        f"{times(CAP)}. In the room {t(OURS, worst_in('room')):.0f} % of the squared error is in one pixel of a "
        "hundred, where the light's own edge or that of its mirror image crosses a pixel, or glass gathers its light: "
        "no light sampling touches that."
    )


CHOICE = Choice(
    NAME,
    "A spherical light: sampled from its cone, or by its area",
    OURS,
    f"Pictures of {SIZE}×{SIZE} pixels, {SPP} spp, sampler `sobol`: RMSE over {SEEDS} seeds against "
    f"{REFERENCE_SPP * REFERENCE_SEEDS} samples, whose own variance is subtracted. A ball on a floor under a light of "
    "radius 1 about 9 away, direct light only; and the room.",
    measure,
    argument,
)
