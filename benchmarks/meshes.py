"""Searches of a mesh beside Embree's, through Mitsuba: rays per CPU second of one core.

    python -m benchmarks.meshes [--subdivisions 3 5 6] [--peer-python PATH] [--chart docs/meshes.png]

Both halves get the same rays, in 128-lane packets as `render` makes them on our side; processes alternate, ratios are
formed within a round. Kernel, on our side: the one `find` and `occluded` choose, packets of 32 lanes walked together
where their rays stay together, one ray at a time elsewhere. On Embree's: the better of its two settings.
"""

import argparse
import statistics
import sys
import tempfile
from typing import Any

from rich.console import Console
from rich.table import Table

from benchmarks.peers import ratio_text
from benchmarks.processes import HERE, cpu_model, find_peer, report_of, run_child, wide_console

KINDS = {
    "camera": "packet of 32",
    "shadow": "packet of 32",
    "incoherent": "single",
    "incoherent any": "single",
}
TESTS = ("watertight", "moller-trumbore")
Rates = dict[str, dict[str, list[float]]]  # contender -> kind -> Mrays per CPU second of each round


def measure(subdivisions: int, peer: str | None, rounds: int, tests: list[str], console: Console) -> Rates:
    """Return the rates of all contenders at one size."""
    module = [sys.executable, "-m", "benchmarks.mesh_jaxrt"]
    with tempfile.TemporaryDirectory() as folder:
        file = f"{folder}/rays.npz"
        run_child([*module, "rays", str(subdivisions), file], folder)
        commands = {test: [*module, "time", file, "--test", test] for test in tests}
        if peer:
            commands["Embree"] = [peer, str(HERE / "mesh_mitsuba.py"), file]
        rates: Rates = {name: {kind: [] for kind in KINDS} for name in commands}
        for i in range(rounds):
            for name in list(commands) if i % 2 == 0 else list(commands)[::-1]:
                console.print(f"{20 * 4**subdivisions} faces, round {i + 1} of {rounds}: {name}", style="dim")
                report = report_of(run_child(commands[name], folder))
                for kind in KINDS:
                    rates[name][kind].append(report[kind][0])
    return rates


def rows_of(faces: int, rates: Rates) -> list[list[str]]:
    """Return the table's rows of one size."""
    rows = []
    for kind, kernel in KINDS.items():
        row = [f"{faces:,}", kind, kernel, *(f"{statistics.median(r[kind]):.2f}" for r in rates.values())]
        if "Embree" in rates:
            row += [ratio_text(rates[name][kind], rates["Embree"][kind]) for name in rates if name != "Embree"]
        rows.append(row)
    return rows


def draw_chart(path: str, results: dict[int, Rates]) -> None:
    """Save the time of a ray over the number of faces: straight lines on a logarithmic axis."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(6, 4), layout="constrained")
    for contender, dashes in (("watertight", "-"), ("Embree", ":")):
        for colour, kind in enumerate(KINDS):
            points = [(n, 1e3 / statistics.median(r[contender][kind])) for n, r in results.items() if contender in r]
            if points:
                label = f"{'jaxrt' if contender == 'watertight' else contender}, {kind}"
                axes.plot(*zip(*points, strict=True), dashes, marker="o", color=f"C{colour}", label=label)
    axes.set(xscale="log", xlabel="faces", ylabel="ns per ray", ylim=(0, None), title="A ray costs like log n")
    axes.legend(fontsize="small")
    figure.savefig(path, dpi=120)


def arguments() -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(description="Compare the searches of a mesh with Embree.")
    parser.add_argument("--subdivisions", type=int, nargs="+", default=[3, 5, 6], help="of the mesh: 20·4ᵏ faces")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--tests", nargs="+", choices=TESTS, default=list(TESTS), help="of a ray and a face")
    parser.add_argument("--chart", help="picture file of the time of a ray over the number of faces")
    parser.add_argument("--peer-python", help="python of Mitsuba; default: $JAXRT_MITSUBA_PYTHON")
    return parser.parse_args()


def main() -> None:
    """Measure, and print the table."""
    options, console = arguments(), wide_console()
    peer, message = find_peer(options.peer_python)
    console.print(f"{cpu_model()}\n{message}")
    results: dict[int, Any] = {}
    for k in options.subdivisions:
        results[20 * 4**k] = measure(k, peer, options.rounds, options.tests, console)
    names = list(next(iter(results.values())))
    ratios = [f"{name} / Embree" for name in names if name != "Embree" and peer]
    table = Table("faces", "rays", "kernel", *names, *ratios, title="Mrays per CPU second, medians (ratios: range)")
    for faces, rates in results.items():
        for row in rows_of(faces, rates):
            table.add_row(*row)
    console.print(table)
    if options.chart:
        draw_chart(options.chart, results)


if __name__ == "__main__":
    main()
