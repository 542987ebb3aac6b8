"""What derivatives cost, in renders: gradients of an L2 loss, Jacobians, compile time and memory.

    python -m benchmarks.gradients [--scene scenes/room.toml] [--rounds 5] [--names lights.position]

CPU time of one core; ratios are taken within a round, and their median and range are printed.
"""

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array
from jax.flatten_util import ravel_pytree
from rich.table import Table

import jaxrt
from benchmarks.clock import cpu_seconds
from benchmarks.jaxrt_side import load, use_cores
from benchmarks.processes import cpu_model, wide_console

SPP, DEPTH = 16, 4
NAMES = ("lights.position", "materials.albedo")
DIRECTIONS = 12  # of the Jacobian, at most


class Subject:
    """A scene, and what is differentiated of it."""

    def __init__(self, path: str, size: int, names: Sequence[str] = NAMES, unroll: bool = False) -> None:
        self.scene = load(path, size, size)
        parameters = jaxrt.parameters(self.scene)
        self.start = {name: parameters[name] for name in names}
        self.directions = min(DIRECTIONS, sum(value.size for value in self.start.values()))
        self.edges = 4 * size * size
        self.unroll = unroll
        self.target = 0.9 * jax.jit(self.picture)(self.start)

    def picture(self, p: dict[str, Array], boundary_samples: int = 0, spp: int = SPP) -> Array:
        """Return the picture of parameters p."""
        scene = jaxrt.with_parameters(self.scene, p)
        return jaxrt.render(scene, 0, spp=spp, max_depth=DEPTH, boundary_samples=boundary_samples, unroll=self.unroll)

    def loss(self, p: dict[str, Array], boundary_samples: int = 0) -> Array:
        """Return the mean square distance to the target."""
        return jnp.mean((self.picture(p, boundary_samples) - self.target) ** 2)

    def gradient(self, boundary_samples: int) -> Callable[[dict[str, Array]], Any]:
        """Return p -> (loss, gradient)."""
        return jax.value_and_grad(lambda p: self.loss(p, boundary_samples))

    def jacobian(self, p: dict[str, Array]) -> Array:
        """Return the picture's derivatives (H, W, 3, n) along the first coordinates."""
        flat, unravel = ravel_pytree(p)
        n = self.directions
        return jax.jacfwd(lambda x: self.picture(unravel(flat.at[:n].set(x))))(flat[:n])


def compiled(f: Callable[..., Any], *arguments: Any) -> tuple[Callable[..., Any], float, float]:
    """Return the program, and wall seconds to trace and to compile it."""
    start = time.perf_counter()
    lowered = jax.jit(f).lower(*arguments)
    traced = time.perf_counter()
    program = lowered.compile()
    return program, traced - start, time.perf_counter() - traced


def costs(subject: Subject, rounds: int, edges: bool) -> list[list[str]]:
    """Return rows (what, renders, seconds to trace, to compile)."""
    p = subject.start
    subjects: dict[str, tuple[Callable[..., Any], str]] = {
        "loss": (subject.loss, "loss"),
        "loss and gradient, interior": (subject.gradient(0), "loss"),
    }
    if edges:
        subjects["loss and gradient, with edges"] = (subject.gradient(subject.edges), "loss")
        subjects[f"Jacobian, {subject.directions} directions"] = (subject.jacobian, "loss")
    programs = {name: compiled(f, p) for name, (f, _) in subjects.items()}
    for program, _, _ in programs.values():
        cpu_seconds(program, p)
    times = [{name: cpu_seconds(program, p)[1] for name, (program, _, _) in programs.items()} for _ in range(rounds)]
    rows = []
    for name, (_, traced, compile_seconds) in programs.items():
        ratios = [one[name] / one["loss"] for one in times]
        told = f"{statistics.median(ratios):.2f} ({min(ratios):.2f}–{max(ratios):.2f})"
        rows.append([name, told, f"{traced:.1f}", f"{compile_seconds:.1f}"])
    return rows


def first_gradient(scene: str, names: Sequence[str], edges: bool, cache: str) -> float:
    """Return wall seconds of a process that starts, compiles and computes one gradient, cache folder given."""
    code = (
        "import sys, jax; jax.config.update('jax_compilation_cache_dir', sys.argv[2]);"
        "jax.config.update('jax_persistent_cache_min_compile_time_secs', 0);"
        "from benchmarks.gradients import Subject; import time;"
        "s = Subject(sys.argv[1], 128, sys.argv[4:]); begin = time.perf_counter();"
        "f = jax.jit(s.gradient(s.edges * int(sys.argv[3]))).lower(s.start).compile();"
        "print(time.perf_counter() - begin)"
    )
    output = subprocess.run(
        [sys.executable, "-c", code, scene, cache, str(int(edges)), *names], capture_output=True, text=True, check=True
    ).stdout
    return float(output.strip().splitlines()[-1])


def memory(subject: Subject) -> list[str]:
    """Return the gradient's temporary memory at 16 and at 1024 samples a pixel."""
    told = []
    for spp in (16, 1024):
        loss = jax.grad(lambda p, spp=spp: jnp.mean((subject.picture(p, 0, spp) - subject.target) ** 2))
        analysis = jax.jit(loss).lower(subject.start).compile().memory_analysis()
        told.append(f"{analysis.temp_size_in_bytes / 1e6:.2f} MB")
    return told


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="What derivatives cost.")
    parser.add_argument("--scene", default="scenes/room.toml")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--names", nargs="+", default=NAMES, help="parameters that derivatives are taken in")
    options = parser.parse_args()
    use_cores(1)
    console = wide_console()
    console.print(f"{cpu_model()}; jax {jax.__version__}; {options.scene}, 128×128, {SPP} spp, depth {DEPTH}, one core")
    table = Table("program", "CPU time in losses (range)", "trace s", "compile s")
    console.print("in", ", ".join(options.names))
    subject = Subject(options.scene, 128, options.names)
    for row in costs(subject, options.rounds, edges=True):
        table.add_row(*row)
    for name, *rest in costs(Subject(options.scene, 128, options.names, unroll=True), options.rounds, edges=False):
        table.add_row(f"{name}, bounces unrolled", *rest)
    console.print(table)
    console.print("gradient's temporary memory at 16 and 1024 spp:", *memory(subject))
    for edges in (False, True):
        with tempfile.TemporaryDirectory() as cache:
            cold, warm = (first_gradient(options.scene, options.names, edges, cache) for _ in range(2))
        name = "with edges" if edges else "interior"
        console.print(f"trace and compile of the gradient, {name}: cold {cold:.1f} s, from JAX's cache {warm:.1f} s")


if __name__ == "__main__":
    main()
