"""A mug's pose from one picture: from how many random starts it is found, and what its standard errors are worth.

    python -m benchmarks.poses [--fits 100] [--rows NAME...] [--peer-fits 10] [--peer-python PATH]

Each fit has another pose, handle in view, and begins turned by up to 40° about a random axis and moved by up to a fifth
of what the camera sees across. The target has another seed and four times the samples, its noise too. Found is what
ends within 1° and 1 % of the mug's size, 2. Of those that found it: how far they are off, their standard errors, and
how many of all numbers are within two of them, of which 95 % should be.

`picture` is `jaxrt.fit` with its defaults, from the one start, `16 starts` what it offers besides, `mask` the same
descent on the share of each pixel that shows the mug. Mitsuba is given the same pictures and starts, moves the vertices
by a rotation vector and a translation, and takes steps of Adam on its projective integrator's gradient of the mean
square, at three rates, each falling to a tenth. CPU seconds are of all threads, without what compiles.
"""

import argparse
import json
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

import jaxrt
from benchmarks.processes import HERE, cpu_model, find_peer, flags, wide_console
from jaxrt.description.pose import rotation_matrix, rotation_vector
from jaxrt.fit import Machine, Problem, sought
from jaxrt.fit.descent import descend
from jaxrt.fit.solve import Drawing
from jaxrt.views import asked_for

Floats = NDArray[np.float64]
SCENE, NAMES = "scenes/mug.toml", ("meshes.translate[mug]", "meshes.rotate[mug]")
SIZE = 2.0  # of the mug
ACROSS = 5.6  # that the camera sees at the mug
TURN, AWAY = 40.0, ACROSS / 5
DEGREES, SHARE = 1.0, 0.01  # within which a pose is found
TARGET = 4  # times the samples of a fit
MASK = "mask[mug]"
ROWS = {"picture": (None, 1), "16 starts": (None, 16), "mask": (MASK, 1)}  # name -> output, starts
RATES = (0.02, 0.05, 0.1)  # of Adam, in units of length and radians
TOLD = ("solved", "noise-limited")


class Task(NamedTuple):
    """Poses (6,), translate then rotate."""

    truth: Floats
    start: Floats


class Result(NamedTuple):
    """How a fit has ended."""

    task: Task
    pose: Floats
    seconds: float  # CPU
    spread: Floats | None = None  # (6,) standard errors
    word: str = ""

    @property
    def off(self) -> tuple[float, float]:
        """How far it is off."""
        return distance(self.pose, self.task.truth)

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


def tasks(count: int) -> list[Task]:
    """Return true poses, and one to begin with for each."""
    return [_task(rng) for rng in [np.random.default_rng(0)] for _ in range(count)]


def _task(rng: np.random.Generator) -> Task:
    tilt = turned(np.array([0, rng.uniform(-70, 40), 0]), rng.uniform(-25, 25, 3) * [1, 0, 1])
    axis, aside = rng.normal(size=(2, 3))
    turn = rng.uniform(0, TURN) * axis / np.linalg.norm(axis)
    move = AWAY * rng.uniform() ** (1 / 3) * aside / np.linalg.norm(aside)
    place = rng.uniform(-0.4, 0.4, 3)
    return Task(np.concatenate([place, tilt]), np.concatenate([place + move, turned(tilt, turn)]))


def distance(pose: Floats, truth: Floats) -> tuple[float, float]:
    """Return how far a pose is off: degrees, and the share of the mug's size."""
    turn = turned(-truth[3:], pose[3:])
    return float(np.linalg.norm(turn)), float(np.linalg.norm(pose[:3] - truth[:3]) / SIZE)


class Mug:
    """The scene in one size."""

    def __init__(self, size: int, spp: int) -> None:
        scene = jaxrt.load_scene(SCENE)
        self.scene = replace(scene, camera=replace(scene.camera, width=size, height=size))
        self.spp = spp

    def posed(self, pose: Floats) -> jaxrt.Scene:
        """Return the scene with the mug in a pose."""
        return jaxrt.with_parameters(self.scene, dict(zip(NAMES, np.split(pose, 2), strict=True)))

    def target(self, task: Task, number: int, output: str | None = None) -> Array:
        """Return what a task shows (size, size, channels)."""
        scene, seed, spp = self.posed(task.truth), 1000 + number, TARGET * self.spp
        if output is None:
            return jaxrt.render(scene, seed, spp=spp)
        return jaxrt.render(scene, seed, spp=spp, outputs=(output,))[output][..., None]

    def machine(self, target: Array, output: str | None) -> Machine:
        """Return what fits, compiled."""
        outputs = asked_for(self.scene, [output or "radiance"])
        unknowns = sought(self.scene, NAMES)
        machine = Machine(Problem(self.scene, unknowns, target, jnp.ones_like(target), 1, outputs=outputs))
        machine.evaluate(machine.start, 0, Drawing(1))  # compiles
        return machine

    def fits(self, given: list[Task], output: str | None, starts: int) -> Iterator[Result]:
        """Yield how each fit ends; one compiled program serves all."""
        machine = None
        for i, task in enumerate(given):
            target = self.target(task, i, output)
            machine = (machine or self.machine(target, output)).again(self.posed(task.start), target)
            begin = time.process_time()
            found = descend(machine, self.spp, i, starts=starts)
            seconds, unknowns = time.process_time() - begin, machine.problem.unknowns
            pose = np.concatenate(list(unknowns.values(found.vector).values()))
            spread = found.verdict.errors * unknowns.slopes(found.vector)
            yield Result(task, pose, seconds, spread, found.verdict.word)


def peer_fits(python: str, mug: Mug, given: list[Task], rate: float, steps: int) -> Iterator[Result]:
    """Yield how each fit of Mitsuba's ends."""
    targets = np.stack([np.asarray(mug.target(task, i)) for i, task in enumerate(given)])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "tasks.npz"
        np.savez(path, targets=targets, starts=np.stack([task.start for task in given]))
        options = flags(rate=rate, steps=steps, spp=mug.spp)
        command = [python, str(HERE / "mitsuba_poses.py"), SCENE, str(path), *options]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
            assert child.stdout is not None
            for task, line in zip(given, child.stdout, strict=True):
                answer = json.loads(line)
                yield Result(task, np.asarray(answer["pose"]), answer["seconds"])


def row_of(name: str, results: list[Result]) -> list[str]:
    """Return the row of the table."""
    found = [result for result in results if result.found]
    seconds = f"{np.median([result.seconds for result in results]):.1f}"
    row = [name, f"{len(found)} of {len(results)}", seconds]
    if not found:
        return row
    degrees, share = np.median([result.off for result in found], axis=0)
    row.append(f"{degrees:.2f}° {share:.2%}")
    spreads = [result.spread for result in found if result.spread is not None]
    if not spreads:
        return row
    spread, errors = np.stack(spreads), np.stack([result.pose - result.task.truth for result in found])
    place, turn = np.median(spread[:, :3]) / SIZE, np.median(spread[:, 3:])
    told = [result for result in results if result.word in TOLD]
    wrongly = sum(not result.found for result in told)
    within = np.mean(np.abs(errors) <= 2 * spread)
    return [*row, f"{turn:.2f}° {place:.2%}", f"{within:.1%} of {errors.size}", f"{len(told)}, wrongly {wrongly}"]


def tell(console: Console, name: str, results: Iterator[Result]) -> list[Result]:
    """Return the results, each told in a line as it comes."""
    every = []
    for result in results:
        every.append(result)
        start, end = (f"{a:6.2f}° {b:7.2%}" for a, b in (distance(result.task.start, result.task.truth), result.off))
        line = f"{name} {len(every):3} from {start} to {end}  {result.word:13} {result.seconds:5.1f} s"
        console.print(line, highlight=False)
    return every


def main() -> None:
    """Print a line for each fit, and a table of what they come to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    counts = (("fits", 100), ("size", 32), ("spp", 32), ("peer-fits", 10), ("steps", 100))
    for name, value in counts:
        parser.add_argument(f"--{name}", type=int, default=value)
    parser.add_argument("--rows", nargs="+", choices=[*ROWS, "Mitsuba"], default=[*ROWS, "Mitsuba"])
    parser.add_argument("--peer-python", help="python of Mitsuba; default: $JAXRT_MITSUBA_PYTHON")
    options, console = parser.parse_args(), wide_console()
    console.print(cpu_model())
    mug, given = Mug(options.size, options.spp), tasks(options.fits)
    rows: dict[str, Callable[[], Iterator[Result]]] = {
        name: lambda how=how: mug.fits(given, *how) for name, how in ROWS.items()
    }
    if "Mitsuba" in options.rows:
        python, message = find_peer(options.peer_python)
        console.print(message)
        for rate in RATES if python else ():
            some: Any = (python, mug, given[: options.peer_fits], rate, options.steps)
            rows[f"Mitsuba, Adam {rate}"] = lambda some=some: peer_fits(*some)
    table = Table(title=f"{SCENE}, {options.size}x{options.size}, {options.spp} spp, target {TARGET * options.spp}")
    for column in ("", "found", "CPU s", "off", "standard error", "within two", "told as found"):
        table.add_column(column)
    for name, fits in rows.items():
        if name.split(",")[0] in options.rows:
            table.add_row(*row_of(name, tell(console, name, fits())))
    console.print(table)


if __name__ == "__main__":
    main()
