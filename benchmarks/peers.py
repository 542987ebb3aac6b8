"""The same room with jaxrt and with Mitsuba 3: speed, start-up and memory, side by side.

    python -m benchmarks.peers [--scene scenes/room.toml] [--peer-python PATH] [--meshes 3 5 6]

Each number comes from a process of its own. Contenders alternate within a round, in reversed order every
other round, so that a drift of the machine hits both; ratios are formed within a round. Speed counts camera
paths.
"""

import argparse
import statistics
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass

from rich.console import Console
from rich.table import Table

from benchmarks import meshes
from benchmarks.processes import (
    Finished,
    cpu_model,
    find_peer,
    flags,
    jaxrt_side,
    peer_side,
    ratio_text,
    report_of,
    run_child,
    wide_console,
)

SAMPLERS = ("independent", "sobol")
Round = dict[str, float]  # metric -> value
Results = dict[str, list[Round]]  # contender -> rounds


@dataclass(frozen=True)
class Contender:
    """A renderer with the command lines that time it and that make a picture file."""

    name: str
    timing: Callable[[int], list[str]]  # cores -> command that prints the JSON of `time`
    picture: Callable[[str, int], list[str]]  # (file, cores) -> command that renders to a file


def jaxrt_contender(scene: str, sampler: str, repeat: int, size: dict[str, int]) -> Contender:
    """Return jaxrt with one of its samplers; the picture comes from the `jaxrt render` program."""
    program = [sys.executable, "-m", "jaxrt", "render", scene, *flags(**size, sampler=sampler)]
    return Contender(
        f"jaxrt {sampler}",
        lambda cores: jaxrt_side("time", scene, **size, sampler=sampler, repeat=repeat, cores=cores),
        lambda out, cores: [*program, "-o", out, "--cores", str(cores)],
    )


def peer_contender(python: str, name: str, scene: str, repeat: int, size: dict[str, int]) -> Contender:
    """Return Mitsuba in the environment of `python`."""
    return Contender(
        name,
        lambda cores: peer_side(python, "time", scene, **size, repeat=repeat, cores=cores),
        lambda out, cores: peer_side(python, "cold", scene, **size, out=out, cores=cores),
    )


def measure(contender: Contender, cores: list[int]) -> Round:
    """Return all metrics of one contender, each from fresh processes with an empty cache."""
    metrics: Round = {}
    for n in cores:
        with tempfile.TemporaryDirectory() as cache:
            report = report_of(run_child(contender.timing(n), cache))
        millions = report["paths"] / 1e6
        cpu, wall = (statistics.median(call[kind] for call in report["calls"]) for kind in ("cpu", "wall"))
        metrics[f"compile, s ({n} core)"] = report["compile"]
        metrics[f"Mpaths per CPU second ({n} core)"] = millions / cpu
        metrics[f"Mpaths per wall second ({n} core)"] = millions / wall
    if len(cores) > 1:
        first, last = (metrics[f"Mpaths per wall second ({n} core)"] for n in (cores[0], cores[-1]))
        metrics[f"wall speed-up, {cores[0]} to {cores[-1]} cores"] = last / first
    cold, warm = start_up(contender, cores[-1])
    metrics["cold start to PNG, s"] = cold.seconds
    metrics["warm start to PNG, s"] = warm.seconds
    metrics["peak memory, MB"] = cold.peak_bytes / 1e6
    return metrics


def start_up(contender: Contender, cores: int) -> tuple[Finished, Finished]:
    """Return a run from start to picture file with an empty cache, and a second with the cache it left."""
    with tempfile.TemporaryDirectory() as folder:
        command = contender.picture(f"{folder}/picture.png", cores)
        return run_child(command, folder), run_child(command, folder)


def alternate(contenders: list[Contender], rounds: int, cores: list[int], console: Console) -> Results:
    """Return the metrics of each contender in each round."""
    results: Results = {contender.name: [] for contender in contenders}
    for i in range(rounds):
        for contender in contenders if i % 2 == 0 else contenders[::-1]:
            console.print(f"round {i + 1} of {rounds}: {contender.name}", style="dim")
            results[contender.name].append(measure(contender, cores))
    return results


def table_of(results: Results, peer: str | None, title: str) -> Table:
    """Return medians of each contender, and the ratios to the peer of those that are not it."""
    table = Table(title=title)
    table.add_column("median", no_wrap=True)
    for name in results:
        table.add_column(name)
    others = [name for name in results if name != peer] if peer else []
    for name in others:
        table.add_column(f"{name} / peer (range)")
    for metric in next(iter(results.values()))[0]:
        values = {name: [r[metric] for r in rounds] for name, rounds in results.items()}
        medians = [f"{statistics.median(v):.2f}" for v in values.values()]
        table.add_row(metric, *medians, *(ratio_text(values[n], values[peer]) for n in others if peer))
    return table


def memory_text(few: Contender, many: Contender, cores: int) -> str:
    """Return the peak memory of one renderer at few and at many samples: it must not grow."""
    a, b = (start_up(contender, cores)[0].peak_bytes / 1e6 for contender in (few, many))
    return f"{a:.0f} MB and {b:.0f} MB, {100 * (b / a - 1):+.1f} %"


def arguments() -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(description="Compare jaxrt with Mitsuba 3 on one scene.")
    parser.add_argument("--scene", default="scenes/room.toml")
    for name, default in (("width", 256), ("height", 256), ("spp", 16), ("max-depth", 4)):
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--repeat", type=int, default=3, help="timed calls in each process")
    parser.add_argument("--cores", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--memory-spp", type=int, default=1024, help="spp of the memory comparison; 0: none")
    parser.add_argument("--meshes", type=int, nargs="+", help="also searches of meshes of 20·4ᵏ faces: 3 5 6")
    parser.add_argument("--peer-python", help="python of Mitsuba; default: $JAXRT_MITSUBA_PYTHON")
    return parser.parse_args()


def main() -> None:
    """Measure, and print the table."""
    options, console = arguments(), wide_console()
    size = {name: getattr(options, name) for name in ("width", "height", "spp", "max_depth")}
    contenders = [jaxrt_contender(options.scene, sampler, options.repeat, size) for sampler in SAMPLERS]
    python, message = find_peer(options.peer_python)
    console.print(f"{cpu_model()}\n{message}")
    if python:
        contenders.append(peer_contender(python, message, options.scene, options.repeat, size))
    results = alternate(contenders, options.rounds, options.cores, console)
    title = f"{options.scene}, {', '.join(f'{name} {value}' for name, value in size.items())}"
    console.print(table_of(results, message if python else None, title))
    if options.memory_spp:
        many = jaxrt_contender(options.scene, SAMPLERS[0], 1, size | {"spp": options.memory_spp})
        text = memory_text(contenders[0], many, options.cores[-1])
        console.print(f"{many.name}: peak memory at {options.spp} and {options.memory_spp} spp: {text}")
    if options.meshes:
        console.print(meshes.table_of(meshes.measure_all(options.meshes, python, options.rounds, console)))


if __name__ == "__main__":
    main()
