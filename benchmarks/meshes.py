"""Searches of a mesh beside Embree's, through Mitsuba: rays per CPU second of one core.

    python -m benchmarks.meshes [--subdivisions 3 5 6] [--large 8] [--peer-python PATH] [--report docs/meshes]

Both halves get the same rays, in 128-lane packets as `render` makes them on our side; processes alternate, ratios are
formed within a round. Kernel, on our side: the one `find` and `occluded` choose, packets of 32 lanes walked together
where their rays stay together, one ray at a time elsewhere. On Embree's: the better of its two settings.
"""

import argparse
import math
import platform
import statistics
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path
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


MODULE = [sys.executable, "-m", "benchmarks.mesh_jaxrt"]


def measure(
    subdivisions: int, peer: str | None, rounds: int, tests: list[str], picture: bool, console: Console
) -> tuple[Rates, float]:
    """Return the rates of all contenders at one size, and the CPU seconds of building the tree."""
    with tempfile.TemporaryDirectory() as folder:
        file = f"{folder}/rays.npz"
        build = report_of(run_child([*MODULE, "rays", str(subdivisions), file], folder))["build"]
        also = ["--picture"] if picture else []
        # What watertightness costs is told at one size, and without a picture
        commands = {tests[0]: [*MODULE, "time", file, "--test", tests[0], *also]}
        commands |= {test: [*MODULE, "time", file, "--test", test] for test in tests[1:] if picture}
        if peer:
            commands["Embree"] = [peer, str(HERE / "mesh_mitsuba.py"), file, *also]
        rates: Rates = {name: {} for name in commands}
        for i in range(rounds):
            for name in list(commands) if i % 2 == 0 else list(commands)[::-1]:
                console.print(f"{20 * 4**subdivisions} faces, round {i + 1} of {rounds}: {name}", style="dim")
                report = report_of(run_child(commands[name], folder))
                for kind, (rate, _) in report.items():
                    rates[name].setdefault(kind, []).append(rate)
    return rates, build


def rows_of(faces: int, rates: Rates, names: list[str]) -> list[list[str]]:
    """Return the table's rows of one size; names: the columns' contenders, whether measured at this size or not."""
    rows = []
    for kind in next(iter(rates.values())):
        known = {name: rates[name][kind] for name in names if kind in rates.get(name, {})}
        row = [f"{faces:,}", kind, KINDS.get(kind, "both")]
        row += [f"{statistics.median(known[name]):.2f}" if name in known else "" for name in names]
        if "Embree" in known:
            others = [name for name in names if name != "Embree"]
            row += [ratio_text(known[name], known["Embree"]) if name in known else "" for name in others]
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
            points = [
                (n, 1e3 / statistics.median(r[contender][kind])) for n, r in sorted(results.items()) if contender in r
            ]
            if points:
                label = f"{'jaxrt' if contender == 'watertight' else contender}, {kind}"
                axes.plot(*zip(*points, strict=True), dashes, marker="o", color=f"C{colour}", label=label)
    axes.set(xscale="log", xlabel="faces", ylabel="CPU ns a ray", ylim=(0, None))
    axes.legend(fontsize="small")
    figure.savefig(path, dpi=120)


def markdown(header: list[str], rows: list[list[str]]) -> str:
    """Return a table in Markdown."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def cost_rows(results: dict[int, Rates]) -> list[list[str]]:
    """Return rows of the time of a ray, and of that time over log₂ of the number of faces."""
    rows = []
    for n, rates in sorted(results.items()):
        cost = [1e3 / statistics.median(rates["watertight"][kind]) for kind in KINDS]
        rows.append([f"{n:,}", *(f"{c:.0f} ({c / math.log2(n):.1f})" for c in cost)])
    return rows


def large_text(report: dict[str, Any]) -> str:
    """Return what a large mesh took, in a sentence."""
    return (
        f"A mesh of {report['faces']:,} faces in a room, 256×256, 16 spp, max_depth 4: tree built in "
        f"{report['build']:.1f} CPU s, picture drawn in {report['draw']:.1f} CPU s, "
        f"peak memory {report['peak_bytes'] / 2**30:.2f} GiB (limit of the design: 4 GiB)."
    )


def write_report(
    path: str, about: str, header: list[str], names: list[str], results: dict[int, Rates], extra: list[str]
) -> None:
    """Write path.md, with the chart path.png."""
    rows = [row for n, rates in sorted(results.items()) for row in rows_of(n, rates, names)]
    draw_chart(f"{path}.png", results)
    parts = [
        "# Searches of a mesh, measured\n",
        f"{about} Written by `python -m benchmarks.meshes --report`.\n",
        INTRODUCTION,
        markdown(header, rows),
        "## Cost of a ray\n",
        "CPU ns a ray, and in brackets the same over log₂ of the number of faces. Larger meshes miss the caches more "
        "often, which no count of steps shows.\n",
        markdown(["faces", *KINDS], cost_rows(results)),
        f"![Time of a ray over the number of faces]({Path(path).name}.png)\n",
        *extra,
    ]
    Path(f"{path}.md").write_text("\n".join(parts), encoding="utf-8")


INTRODUCTION = """Mrays per CPU second of one core (of whole pictures: million camera paths), medians; ratios are \
formed within rounds, with their range. Both sides get the same rays: a camera's in 8×8 tiles, those from its hits to
a point light, and uniformly random ones. *Packet of 32*: lanes of a packet that stay together walk through the tree
together; *single*: each alone. `find` and `occluded` choose by themselves; at 1,310,720 faces most of the
camera's and the shadow rays are too far apart for packets, and walk alone. Neither side's time has the building of the
tree in it, nor ours the copy of the tables that a call of `render` makes once. Embree runs through Mitsuba, at the
better of its settings (coherent or not). *Moller-trumbore* is the same walk with a test that leaks through edges: what
watertightness costs. A whole picture is the mesh in a room of six spheres under a sphere light, 256×256, 16 spp,
max_depth 4, beside Mitsuba's `path`.
"""


def arguments() -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(description="Compare the searches of a mesh with Embree.")
    parser.add_argument("--subdivisions", type=int, nargs="+", default=[3, 5, 6], help="of the mesh: 20·4ᵏ faces")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--tests", nargs="+", choices=TESTS, default=list(TESTS), help="of a ray and a face")
    parser.add_argument("--picture", type=int, default=5, help="subdivisions of the mesh of whole pictures")
    parser.add_argument("--large", type=int, help="subdivisions of a mesh to build and draw once")
    parser.add_argument("--report", help="path of a Markdown file and a chart, without suffix")
    parser.add_argument("--peer-python", help="python of Mitsuba; default: $JAXRT_MITSUBA_PYTHON")
    return parser.parse_args()


def main() -> None:
    """Measure, and print the table."""
    options, console = arguments(), wide_console()
    peer, message = find_peer(options.peer_python)
    console.print(f"{cpu_model()}\n{message}")
    results: dict[int, Rates] = {}
    builds: list[list[str]] = []
    for k in options.subdivisions:
        n = 20 * 4**k
        results[n], seconds = measure(k, peer, options.rounds, options.tests, k == options.picture, console)
        builds.append([f"{n:,}", f"{seconds:.2f}", f"{1e6 * seconds / n:.0f}"])
    names = list(dict.fromkeys(name for rates in results.values() for name in rates))
    ratios = [f"{name} / Embree" for name in names if name != "Embree" and peer]
    header = ["faces", "rays", "kernel", *names, *ratios]
    table = Table(*header, title="Mrays per CPU second, medians (ratios: range)")
    for faces, rates in results.items():
        for row in rows_of(faces, rates, names):
            table.add_row(*row)
    console.print(table)
    extra = ["## Building\n", markdown(["faces", "CPU s", "µs a face"], builds)]
    with tempfile.TemporaryDirectory() as folder:
        if options.large is not None:
            extra.append(large_text(report_of(run_child([*MODULE, "large", str(options.large)], folder))) + "\n")
        crossover = report_of(run_child([*MODULE, "crossover"], folder))
    rows = [[*name.split(), f"{ratio:.2f}"] for name, ratio in crossover.items()]
    extra += ["## Few faces\n", markdown(["faces", "rays", "tree, times as fast as the loop"], rows)]
    console.print("\n".join(extra))
    if options.report:
        about = f"{cpu_model()}; {versions()}; {message}; medians of {options.rounds} rounds."
        write_report(options.report, about, header, names, results, extra)


def versions() -> str:
    """Return the versions of Python and JAX."""
    return f"Python {platform.python_version()}, jax {version('jax')}"


if __name__ == "__main__":
    main()
