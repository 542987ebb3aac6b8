"""Compile variants apart from one another, and time them in turn: one process, CPU time, ratios within rounds."""

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any, NamedTuple
from unittest.mock import patch

import jax
from jax.extend import core

import jaxrt
from jaxrt.render import draw_sum, prepare
from jaxrt.transport.film import Run

Swap = tuple[Any, str, Any]  # module, name in it, what stands in its place
Times = dict[str, list[float]]  # variant -> CPU seconds of each round


class Program(NamedTuple):
    """A compiled program, and what compiling it took."""

    call: Any
    seconds: float  # CPU time to trace and to compile
    temporary: int  # bytes of temporary memory at the peak
    traced: core.ClosedJaxpr


@contextmanager
def swapped(swaps: Sequence[Swap]) -> Any:
    """Put other functions in place of the package's; stages traced before are forgotten, and those of now after."""
    jax.clear_caches()
    with ExitStack() as stack:
        for module, name, other in swaps:
            stack.enter_context(patch.object(module, name, other))
        yield
    jax.clear_caches()


def compiled(f: Callable[..., Any], *arguments: Any, swaps: Sequence[Swap] = ()) -> Program:
    """Return f, compiled for arguments like these with the methods in `swaps`."""
    with swapped(swaps):
        start = time.process_time()
        traced = jax.jit(lambda *a: f(*a)).trace(*arguments)
        call = traced.lower().compile()
        seconds = time.process_time() - start
    return Program(call, seconds, call.memory_analysis().temp_size_in_bytes, traced.jaxpr)


class Picture(NamedTuple):
    """A compiled picture: `draw()` has the mean of its samples (height, width, 3)."""

    program: Program
    scene: jaxrt.Scene
    run: Run
    spp: int

    @property
    def paths(self) -> int:
        """Camera paths of a picture."""
        return self.scene.camera.width * self.scene.camera.height * self.spp

    def draw(self, seed: int = 0, spp: int | None = None) -> jax.Array:
        """Return the picture of a seed, with as many samples as wanted; no number of them compiles anew."""
        spp = spp or self.spp
        run = prepare(self.scene, seed, 0, spp, spp)[1]
        return jax.block_until_ready(self.program.call(self.scene, run)) / spp

    def again(self) -> None:
        """Draw the picture once more, and nothing else."""
        jax.block_until_ready(self.program.call(self.scene, self.run))


def picture(scene: jaxrt.Scene, spp: int, depth: int, swaps: Sequence[Swap] = (), **options: Any) -> Picture:
    """Return the compiled picture of a scene on one device. options: those of `jaxrt.render`."""
    one = jax.devices()[:1]
    scene, run, plan = prepare(scene, 0, 0, spp, spp, max_depth=depth, devices=one, **options)
    program = compiled(lambda scene, run: draw_sum.__wrapped__(scene, run, plan), scene, run, swaps=swaps)
    return Picture(program, scene, run, spp)


def interleaved(actions: Mapping[str, Callable[[], object]], rounds: int) -> Times:
    """Return the CPU seconds of each action in each round, after one call to warm up; every other round backwards."""
    times: Times = {name: [] for name in actions}
    for action in actions.values():
        action()
    for i in range(rounds):
        for name in list(actions) if i % 2 == 0 else list(actions)[::-1]:
            start = time.process_time()
            actions[name]()
            times[name].append(time.process_time() - start)
    return times


def ratios(times: Times, name: str, base: str) -> list[float]:
    """Return the times of one action in those of another, round by round."""
    return [a / b for a, b in zip(times[name], times[base], strict=True)]


class Spread(NamedTuple):
    """Several measurements of one thing."""

    median: float
    least: float
    most: float

    def told(self, form: str = ".2f") -> str:
        """Return 'median (least–most)'."""
        return f"{self.median:{form}} ({self.least:{form}}–{self.most:{form}})"


def spread(values: Sequence[float]) -> Spread:
    """Return median, least and most."""
    return Spread(statistics.median(values), min(values), max(values))
