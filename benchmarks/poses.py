"""A mug's pose from one picture: from how many random starts it is found, and what its standard errors are worth.

    python -m benchmarks.poses [--fits 100] [--starts 16] [--size 32] [--spp 32]

Each fit has another pose, handle in view, and begins turned by up to 40° about a random axis and moved by up to a fifth
of what the camera sees across. The target has another seed and four times the samples. Found is what ends within 1° and
1 % of the mug's size, 2. Standard errors are of the fits that found it: of all numbers 95 % should be within two.
"""

import argparse
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

import jaxrt
from benchmarks.processes import cpu_model
from jaxrt.description.pose import rotation_matrix, rotation_vector
from jaxrt.fit import Machine, Problem, sought
from jaxrt.fit.descent import descend
from jaxrt.fit.solve import Drawing

Floats = NDArray[np.float64]
SCENE, NAMES = "scenes/mug.toml", ("meshes.translate[mug]", "meshes.rotate[mug]")
SIZE = 2.0  # of the mug
ACROSS = 5.6  # that the camera sees at the mug
TURN, AWAY = 40.0, ACROSS / 5
DEGREES, SHARE = 1.0, 0.01  # within which a pose is found


class Result(NamedTuple):
    """How a fit has ended."""

    off: tuple[float, float]  # degrees, share of the size
    begun: tuple[float, float]  # the same of the start
    errors: Floats  # (6,) found less true, translate then rotate
    spread: Floats  # (6,) standard errors of these
    word: str
    steps: int
    seconds: float

    @property
    def found(self) -> bool:
        """Whether it is where it should be."""
        return self.off[0] <= DEGREES and self.off[1] <= SHARE


def turned(vector: Floats, by: Floats) -> Floats:
    """Return the rotation vector that turns by one and then by the other, in degrees."""
    return np.array(rotation_vector(rotation_matrix(_three(by)) @ rotation_matrix(_three(vector))))


def _three(vector: Floats) -> tuple[float, float, float]:
    x, y, z = map(float, vector)
    return x, y, z


def poses(rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Return a true pose (6,) and one to begin with."""
    tilt = turned(np.array([0, rng.uniform(-70, 40), 0]), rng.uniform(-25, 25, 3) * [1, 0, 1])
    axis, aside = rng.normal(size=(2, 3))
    turn = rng.uniform(0, TURN) * axis / np.linalg.norm(axis)
    move = AWAY * rng.uniform() ** (1 / 3) * aside / np.linalg.norm(aside)
    place = rng.uniform(-0.4, 0.4, 3)
    return np.concatenate([place, tilt]), np.concatenate([place + move, turned(tilt, turn)])


def distance(pose: Floats, truth: Floats) -> tuple[float, float]:
    """Return how far a pose is off: degrees, and the share of the mug's size."""
    turn = turned(-truth[3:], pose[3:])
    return float(np.linalg.norm(turn)), float(np.linalg.norm(pose[:3] - truth[:3]) / SIZE)


def fits(count: int, starts: int, size: int, spp: int) -> Iterator[Result]:
    """Yield how each fit ends; one compiled program serves all."""
    rng, machine = np.random.default_rng(0), None
    scene = jaxrt.load_scene(SCENE)

    def posed(pose: Floats) -> jaxrt.Scene:
        return jaxrt.with_parameters(scene, dict(zip(NAMES, np.split(pose, 2), strict=True)))

    for i in range(count):
        truth, start = poses(rng)
        target = jaxrt.render(posed(truth), 1000 + i, spp=4 * spp, width=size, height=size)
        begin, guess = time.perf_counter(), posed(start)
        machine = machine.again(guess, target) if machine else _machine(guess, target)
        found = descend(machine, spp, i, starts=starts)
        unknowns, spread = machine.problem.unknowns, found.verdict.errors
        pose = np.concatenate(list(unknowns.values(found.vector).values()))
        spread = spread * unknowns.slopes(found.vector)
        seconds, off = time.perf_counter() - begin, distance(pose, truth)
        yield Result(
            off, distance(start, truth), pose - truth, spread, found.verdict.word, found.progress.step, seconds
        )


def _machine(scene: jaxrt.Scene, target: jnp.ndarray) -> Machine:
    """Return the machine of the first fit, compiled."""
    height, width, _ = target.shape
    scene = replace(scene, camera=replace(scene.camera, width=width, height=height))
    machine = Machine(Problem(scene, sought(scene, NAMES), target, jnp.ones_like(target), 1))
    machine.evaluate(machine.start, 0, Drawing(1))  # compiles
    return machine


def main() -> None:
    """Print a line for each fit, and what all of them come to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, value in (("fits", 100), ("starts", 16), ("size", 32), ("spp", 32)):
        parser.add_argument(f"--{name}", type=int, default=value)
    options = parser.parse_args()
    print(cpu_model())
    results: list[Result] = []
    for result in fits(options.fits, options.starts, options.size, options.spp):
        results.append(result)
        begun, off = (f"{degrees:6.2f}° {share:7.2%}" for degrees, share in (result.begun, result.off))
        print(f"{len(results):3} from {begun} to {off}  {result.word:13} {result.seconds:5.1f} s", flush=True)
    found = [result for result in results if result.found]
    print(f"found: {len(found)} of {len(results)}, median {np.median([r.seconds for r in results]):.1f} s each")
    told = sum(result.word in ("solved", "noise-limited") for result in results)
    false = sum(result.word in ("solved", "noise-limited") and not result.found for result in results)
    print(f"told as found: {told}, wrongly {false}")
    if found:
        errors, spread = (np.stack([getattr(r, field) for r in found]) for field in ("errors", "spread"))
        print(f"within two standard errors: {np.mean(np.abs(errors) <= 2 * spread):.1%} of {errors.size} numbers")
        place, turn = np.median(spread[:, :3]) / SIZE, np.median(spread[:, 3:])
        print(f"median standard errors: {turn:.3f}°, {place:.3%} of the size")


if __name__ == "__main__":
    main()
