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
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from benchmarks.mesh_rays import KINDS
from benchmarks.processes import HERE, cpu_model, find_peer, ratio_text, report_of, run_child, wide_console
from jaxrt.core.writing import write_text, write_whole

TESTS = ("watertight", "moller-trumbore")
PICTURE = 5  # subdivisions of the mesh of whole pictures
Rates = dict[str, dict[str, list[float]]]  # contender -> kind -> Mrays per CPU second of each round
Measured = dict[int, tuple[Rates, dict[str, Any]]]  # faces -> rates, and what building and walking the tree takes
PANELS = (("camera", "close camera", "shadow", "close shadow"), ("incoherent", "incoherent any"))  # of the chart
MODULE = [sys.executable, "-m", "benchmarks.mesh_jaxrt"]


def measure(
    subdivisions: int, peer: str | None, rounds: int, tests: Sequence[str], picture: bool, console: Console
) -> tuple[Rates, dict[str, Any]]:
    """Return the rates of all contenders at one size, and what building and walking the tree takes."""
    with tempfile.TemporaryDirectory() as folder:
        file = f"{folder}/rays.npz"
        tree = report_of(run_child([*MODULE, "rays", str(subdivisions), file], folder))
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
    return rates, tree


def kernel(kind: str) -> str:
    """Return the search that most rays of a kind take, on our side."""
    return "both" if kind not in KINDS else "single" if kind.startswith("incoherent") else "packet of 32"


def measure_all(
    subdivisions: list[int],
    peer: str | None,
    rounds: int,
    console: Console,
    tests: Sequence[str] = TESTS,
    picture: int = PICTURE,
) -> Measured:
    """Return what `measure` does for each size, a whole picture included at one."""
    return {20 * 4**k: measure(k, peer, rounds, tests, k == picture, console) for k in sorted(subdivisions)}


def table_of(measured: Measured) -> Table:
    """Return the table of all sizes."""
    header, *rows = rows_of(measured)
    table = Table(*header, title="Searches of a mesh: Mrays per CPU second, medians (ratios: range)")
    for row in rows:
        table.add_row(*row)
    return table


def rows_of(measured: Measured) -> list[list[str]]:
    """Return the table's header and rows."""
    names = list(dict.fromkeys(name for rates, _ in measured.values() for name in rates))
    others = [name for name in names if name != "Embree"] if "Embree" in names else []
    rows = [["faces", "rays", "kernel", *names, *(f"{name} / Embree" for name in others)]]
    for faces, (rates, _) in measured.items():
        for kind in next(iter(rates.values())):
            known = {name: rates[name][kind] for name in names if kind in rates.get(name, {})}
            medians = [f"{statistics.median(known[name]):.2f}" if name in known else "" for name in names]
            ratios = [ratio_text(known[name], known["Embree"]) if name in known else "" for name in others]
            rows.append([f"{faces:,}", kind, kernel(kind), *medians, *ratios])
    return rows


def draw_chart(path: str, measured: Measured) -> None:
    """Save what a ray visits and takes over the number of faces: straight lines on a logarithmic axis."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, panels = pyplot.subplots(1, 3, figsize=(14, 4.5), layout="constrained")
    colours = {kind: f"C{i}" for i, kind in enumerate(KINDS)}
    for kind, colour in colours.items():
        visits = [sum(tree["visits"][kind]) for _, tree in measured.values()]
        panels[0].plot(list(measured), visits, "-", marker="o", color=colour, label=kind)
    for axes, kinds in zip(panels[1:], PANELS, strict=True):
        for kind in kinds:
            for contender, dashes in (("watertight", "-"), ("Embree", ":")):
                points = [(n, nanoseconds(r[contender][kind])) for n, (r, _) in measured.items() if contender in r]
                if points:
                    label = f"{'jaxrt' if contender == 'watertight' else contender}, {kind}"
                    axes.plot(*zip(*points, strict=True), dashes, marker="o", color=colours[kind], label=label)
    for axes, label in zip(panels, ("nodes and leaves a ray", "CPU ns a ray", "CPU ns a ray"), strict=True):
        axes.set(xscale="log", xlabel="faces", ylabel=label, ylim=(0, None))
        axes.legend(fontsize="small")
    write_whole(Path(path), lambda file: figure.savefig(file, format="png", dpi=100))


def nanoseconds(rates: list[float]) -> float:
    """Return the median time of a ray, of rates in Mrays per second."""
    return 1e3 / statistics.median(rates)


def markdown(header: list[str], rows: list[list[str]]) -> str:
    """Return a table in Markdown."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def cost_rows(results: dict[int, Rates], contender: str) -> list[list[str]]:
    """Return rows of the time of a ray, and of that time over log₂ of the number of faces; last, how much they grow."""
    costs = {
        n: [nanoseconds(r[contender][kind]) for kind in KINDS] for n, r in sorted(results.items()) if contender in r
    }
    return logarithmic(costs, "{:.0f} ({:.1f})")


def visit_rows(trees: dict[int, dict[str, Any]]) -> list[list[str]]:
    """Return rows of how many nodes and leaves a ray visits, and of that number over log₂ of the number of faces."""
    return logarithmic(
        {n: [sum(t["visits"][kind]) for kind in KINDS] for n, t in sorted(trees.items())}, "{:.1f} ({:.2f})"
    )


def logarithmic(values: dict[int, list[float]], form: str) -> list[list[str]]:
    """Return rows of values and their ratio to log₂ n for each n, and of how often the first is in the last."""
    rows = [[f"{n:,}", *(form.format(x, x / math.log2(n)) for x in row)] for n, row in values.items()]
    if len(values) > 1:
        first, *_, last = values.values()
        rows.append(["growth", *(f"{b / a:.2f}" for a, b in zip(first, last, strict=True))])
    return rows


def large_text(report: dict[str, Any]) -> str:
    """Return what a large mesh took, in a sentence."""
    return (
        f"A mesh of {report['faces']:,} faces in a room, 256×256, 16 spp, max_depth 4: tree built in "
        f"{report['build']:.1f} CPU s, picture drawn in {report['draw']:.1f} CPU s, "
        f"peak memory {report['peak_bytes'] / 2**30:.2f} GiB (limit of the design: 4 GiB)."
    )


def write_report(path: str, about: str, measured: Measured, extra: list[str]) -> None:
    """Write path.md, with the chart path.png."""
    header, *rows = rows_of(measured)
    results, trees = ({n: both[i] for n, both in measured.items()} for i in range(2))
    embree = cost_rows(results, "Embree")
    draw_chart(f"{path}.png", measured)
    parts = [
        "# Searches of a mesh, measured\n",
        f"{about} Written by `python -m benchmarks.meshes --report`.\n",
        INTRODUCTION,
        markdown(header, rows),
        "## Cost of a ray\n",
        COST.format(growth=math.log2(max(results)) / math.log2(min(results))),
        "Nodes, those returned to counted again, and leaves that a ray visits when it walks alone:\n",
        markdown(["faces", *KINDS], visit_rows(trees)),
        "CPU ns a ray:\n",
        markdown(["faces", *KINDS], cost_rows(results, "watertight")),
        *(["and Embree's:\n", markdown(["faces", *KINDS], embree)] if embree else []),
        f"![Visits and time of a ray over the number of faces]({Path(path).name}.png)\n",
        *extra,
    ]
    write_text(Path(f"{path}.md"), "\n".join(parts))


COST = """In brackets the same over log₂ of the number of faces, which grows {growth:.2f} times from the first row to \
the last.
What a ray visits follows the depth of the tree. Its time follows where rays are as close as the faces are small. In one
and the same picture of ever smaller faces, rays of a packet meet ever fewer leaves together, until they walk alone; and
random rays in a large mesh wait for memory, Embree's as well as ours.
"""

INTRODUCTION = """Mrays per CPU second of one core (of whole pictures: million camera paths), medians; ratios are \
formed within rounds, with their range. Both sides get the same rays: a camera's in 8×8 tiles, those from its hits to
a point light, and uniformly random ones. *Close*: of a picture of a part of the mesh, so small that there are as many
rays to a face at every size. *Packet of 32*: lanes of a packet that stay together walk through the tree
together; *single*: each alone. `find` and `occluded` choose by themselves; at 1,310,720 faces most of the
camera's and the shadow rays that are not close are too far apart for packets, and walk alone. Neither side's time has
the building of the tree in it, nor ours the boxes that a call of `render` puts around the vertices once. Embree runs
through Mitsuba, at the better of its settings (coherent or not). *Moller-trumbore* is the same walk with a test that
leaks through edges: what watertightness costs. A whole picture is the mesh in a room of six spheres under a sphere
light, 256×256, 16 spp, max_depth 4, beside Mitsuba's `path`. *In the open*: the same of a scene whose paths escape
(`benchmarks/scenes/open.toml`), with a body as scanners see it, 69,451 uneven faces, and with a torus knot of 19,200.
"""


def arguments() -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(description="Compare the searches of a mesh with Embree.")
    parser.add_argument("--subdivisions", type=int, nargs="+", default=[3, 5, 6], help="of the mesh: 20·4ᵏ faces")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--tests", nargs="+", choices=TESTS, default=list(TESTS), help="of a ray and a face")
    parser.add_argument("--picture", type=int, default=PICTURE, help="subdivisions of the mesh of whole pictures")
    parser.add_argument("--large", type=int, help="subdivisions of a mesh to build and draw once")
    parser.add_argument("--report", help="path of a Markdown file and a chart, without suffix")
    parser.add_argument("--peer-python", help="python of Mitsuba; default: $JAXRT_MITSUBA_PYTHON")
    return parser.parse_args()


def main() -> None:
    """Measure, and print the table."""
    options, console = arguments(), wide_console()
    peer, message = find_peer(options.peer_python)
    console.print(f"{cpu_model()}\n{message}")
    measured = measure_all(options.subdivisions, peer, options.rounds, console, options.tests, options.picture)
    console.print(table_of(measured))
    trees = {n: tree for n, (_, tree) in measured.items()}
    builds = [[f"{n:,}", f"{t['build']:.2f}", f"{1e6 * t['build'] / n:.0f}"] for n, t in trees.items()]
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
        write_report(options.report, about, measured, extra)


def versions() -> str:
    """Return the versions of Python and JAX."""
    return f"Python {platform.python_version()}, jax {version('jax')}"


if __name__ == "__main__":
    main()
