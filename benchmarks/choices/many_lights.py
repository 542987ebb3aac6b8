"""Which of many lights to look at: by power alone, or by power over squared distance, through groups of neighbours."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np

import jaxrt
from benchmarks.choices.figures import Choice, Figure, Table, error
from benchmarks.interleave import Picture, interleaved, picture, spread
from jaxrt.lights.near import MANY, neighbours

NAME, OURS, POWER = "many lights", "power over squared distance", "power alone"
NUMBERS = 4, 8, 16, 32, 64, 256
FLOOR, ROOM = "open floor", "closed room"
SIZE, SPP, SEEDS = 64, 16, 8
WHITE = {"white": {"type": "diffuse", "albedo": [0.7, 0.7, 0.7]}}


def described(scene: str, n: int) -> dict[str, Any]:
    """Return n lights: of unlike power, anywhere over a floor; or alike and close together, in the middle of a room."""
    rng = np.random.default_rng(n)
    if scene == FLOOR:
        around, balls = [[0, -1000, 0]], [[0, 1.5, 0], [-5, 1.5, -3], [4, 1.5, 5]]
        places = rng.uniform([-10, 0.3, -10], [10, 8, 10], (4 * n, 3))
        places = places[np.linalg.norm(places[:, None] - balls, axis=-1).min(1) > 2][:n]
        powers, camera = rng.lognormal(0, 1, n), {"position": [0, 14, 14], "target": [0, 0, 0]}
    else:
        around = [(1005 * axis).tolist() for axis in (*np.eye(3), *-np.eye(3))]
        balls = [[-2, -3.5, -1], [2, -3.5, 1]]
        places = [0, 2, 0] + rng.uniform(-0.7, 0.7, (n, 3))
        powers, camera = np.ones(n), {"position": [0, 0, 4.5], "target": [0, -1, 0], "fov": 80}
    spheres = [{"center": c, "radius": 1000, "material": "white"} for c in around]
    spheres += [{"center": c, "radius": 1.5, "material": "white"} for c in balls]
    lights = [{"position": p.tolist(), "intensity": float(w)} for p, w in zip(places, powers, strict=True)]
    camera |= {"width": SIZE, "height": SIZE}
    return {"camera": camera, "materials": WHITE, "spheres": spheres, "lights": lights}


def noise_of(drawn: Picture) -> float:
    """Return the standard deviation over seeds, in % of the picture's mean."""
    pictures = np.stack([np.asarray(drawn.draw(seed), float) for seed in range(SEEDS)])
    return 100 * float(np.sqrt(pictures.var(0, ddof=1).mean()) / pictures.mean())


def noise_in(scene: str, n: int) -> str:
    """Return the measure's name."""
    return f"noise in % after a CPU second, {scene}, {n} lights"


def both_ways(scene: str, n: int, rounds: int) -> tuple[float, float]:
    """Return the noise after a CPU second of lights chosen by power alone, and through groups."""
    built = jaxrt.build(described(scene, n))
    assert built.lights is not None
    order = jnp.asarray(neighbours(np.asarray(built.lights.position)))
    drawn = [
        picture(replace(built, lights=replace(built.lights, order=way)), SPP, 1 if scene == FLOOR else 4)
        for way in (None, order)
    ]
    times = interleaved({str(i): p.again for i, p in enumerate(drawn)}, rounds)
    power, groups = (noise_of(p) * spread(times[str(i)]).median ** 0.5 for i, p in enumerate(drawn))
    return power, groups


def measured(rounds: int) -> Iterator[Figure]:
    """Yield all figures."""
    for scene in (FLOOR, ROOM):
        for n in NUMBERS:
            for variant, value in zip((POWER, OURS), both_ways(scene, n, rounds), strict=True):
                yield error(NAME, variant, noise_in(scene, n), value)


def measure(rounds: int) -> list[Figure]:
    """Return all figures."""
    return list(measured(rounds))


def argument(t: Table) -> str:
    """Return what the figures say."""

    def ratios(scene: str) -> str:
        return ", ".join(f"{t(OURS, noise_in(scene, n)) / t(POWER, noise_in(scene, n)):.2f}" for n in NUMBERS)

    return (
        f"With {', '.join(map(str, NUMBERS))} lights, ours leaves these multiples of the noise of power alone in the "
        f"same time: {ratios(FLOOR)} on the {FLOOR}; {ratios(ROOM)} in the {ROOM}, where all are about as far, so that "
        f"only the time to look at them shows. Up to {MANY} lights power alone chooses."
    )


CHOICE = Choice(
    NAME,
    "Many lights: chosen by power, or by power over squared distance",
    OURS,
    f"Pictures of {SIZE}×{SIZE} pixels, {SPP} spp: the standard deviation of {SEEDS} seeds, times the square root of "
    "the CPU seconds that a picture takes. Open floor: lights of unlike power, from 0.3 to 8 above a floor 20 wide, "
    "direct light. Closed room: lights alike, close together in the middle, max_depth 4.",
    measure,
    argument,
)
