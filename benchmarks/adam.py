"""The albedos of a scene from a picture of it, by 100 steps of Adam: jaxrt and Mitsuba, cold and with kept programs.

    python -m benchmarks.adam [--scene scenes/room.toml scenes/seed/mesh_in_room.toml] [--rounds 3] [--peer-python PATH]

64x64 pixels, 8 samples, the scene's own depth; each step has samples of its own. A target of 64 samples is drawn
first. Wall seconds from the start of a process to its end, on all cores: first with empty caches, then again with what
the first run left in them. Mitsuba's gradient is path replay's (prb). Contenders alternate within a round.
"""

import argparse
import os
import statistics
import sys
import tempfile

from rich.table import Table

from benchmarks.processes import HERE, cpu_model, find_peer, flags, ratio_text, report_of, run_child, wide_console

SCENES = ("scenes/room.toml", "scenes/seed/mesh_in_room.toml")
PARTS = ("start", "target", "first", "others")
Run = dict[str, float]


def measure(command: list[str]) -> dict[str, Run]:
    """Return what a run with empty caches takes, and the same again."""
    runs = {}
    with tempfile.TemporaryDirectory() as cache:
        os.chmod(cache, 0o700)
        for name in ("cold", "kept"):
            finished = run_child(command, cache)
            runs[name] = report_of(finished) | {"total": finished.seconds}
    return runs


def main() -> None:
    """Print a table for each scene."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scene", nargs="+", default=SCENES)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--steps", type=int, default=100)
    parser.add_argument("--peer-python", help="python of Mitsuba; default: $JAXRT_MITSUBA_PYTHON")
    options, console = parser.parse_args(), wide_console()
    python, message = find_peer(options.peer_python)
    console.print(f"{cpu_model()}\n{message}")
    for scene in options.scene:
        task = [scene, *flags(steps=options.steps)]
        commands = {"jaxrt": [sys.executable, "-m", "benchmarks.jaxrt_adam", *task]}
        if python:
            commands["Mitsuba"] = [python, str(HERE / "mitsuba_adam.py"), *task]
        rounds: dict[str, list[dict[str, Run]]] = {name: [] for name in commands}
        for i in range(options.rounds):
            for name in list(commands)[:: 1 if i % 2 == 0 else -1]:
                rounds[name].append(measure(commands[name]))
        console.print(table_of(f"{scene}, {options.steps} steps", rounds))


def table_of(title: str, rounds: dict[str, list[dict[str, Run]]]) -> Table:
    """Return medians of wall seconds, whole and in parts, and ratios within rounds."""
    table = Table(title=title)
    for column in ("median of wall seconds", "whole", *PARTS, "mean error", "whole / Mitsuba's (range)"):
        table.add_column(column)
    for kind in ("cold", "kept"):
        totals = {name: [run[kind]["total"] for run in runs] for name, runs in rounds.items()}
        for name, runs in rounds.items():
            numbers = [statistics.median(run[kind][part] for run in runs) for part in ("total", *PARTS)]
            ratio = ratio_text(totals[name], totals["Mitsuba"]) if "Mitsuba" in totals and name != "Mitsuba" else ""
            table.add_row(f"{name}, {kind}", *(f"{v:.2f}" for v in numbers), f"{runs[0][kind]['error']:.3f}", ratio)
    return table


if __name__ == "__main__":
    main()
