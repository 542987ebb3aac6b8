"""Bounces in a loop against bounces in a row."""

import numpy as np

import jaxrt
from benchmarks.choices.figures import Choice, Figure, Table, cost, error
from benchmarks.interleave import Picture, picture, spread

NAME, OURS, OTHER = "bounces", "scan", "unrolled"
SCENES = {"room, depth 4": ("scenes/room.toml", 4), "room, depth 8": ("scenes/room.toml", 8)}
COMPILES = 3


def compiles(scene: jaxrt.Scene, depth: int) -> tuple[dict[str, Picture], dict[str, list[float]]]:
    """Return the last programs, and seconds to compile each, in turns."""
    seconds: dict[str, list[float]] = {OURS: [], OTHER: []}
    pictures = {}
    for _ in range(COMPILES):
        for variant in seconds:
            pictures[variant] = picture(scene, 4, depth, unroll=variant == OTHER)
            seconds[variant].append(pictures[variant].program.seconds)
    return pictures, seconds


def measure(rounds: int) -> list[Figure]:
    """Return all figures."""
    figures: list[Figure] = []
    for name, (file, depth) in SCENES.items():
        pictures, seconds = compiles(jaxrt.load_scene(file), depth)
        for v, s in seconds.items():
            figures.append(Figure(NAME, v, f"compile s, {name}", "note", spread(s), ".1f"))
            ratios = [a / b for a, b in zip(s, seconds[OURS], strict=True)]
            figures.append(Figure(NAME, v, f"to compile, {name}", "cost", spread(ratios)))
            figures.append(error(NAME, v, f"largest difference, {name}", difference(pictures[v], pictures[OURS])))
        figures += cost(NAME, f"time, {name}", {v: p.again for v, p in pictures.items()}, OURS, rounds)
    return figures


def difference(a: Picture, b: Picture) -> float:
    """Return the largest difference of a pixel, in the mean radiance."""
    truth = np.asarray(b.draw())
    return float(np.abs(np.asarray(a.draw()) - truth).max() / truth.mean())


def argument(t: Table) -> str:
    """Return what the figures say."""
    parts = [
        f"in the {name}, unrolled events take {t(OTHER, f'time, {name}'):.2f} times the loop's time and "
        f"{t(OTHER, f'compile s, {name}'):.1f} s to compile instead of {t(OURS, f'compile s, {name}'):.1f}"
        for name in SCENES
    ]
    return (
        f"Both make the same picture: {'; '.join(parts)}. A loop's program is as large for any depth. "
        "`render(…, unroll=True)` is there for those who draw one scene for long, where it is the faster of the two."
    )


CHOICE = Choice(
    NAME,
    "Bounces: in a loop, or unrolled",
    OURS,
    f"The room, 256×256, 4 spp. Compile: CPU seconds to trace and compile, median of {COMPILES}, nothing cached. "
    "Difference: the largest of any pixel, in the mean radiance, with the same random numbers.",
    measure,
    argument,
)
