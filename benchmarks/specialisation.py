"""What a scene pays for features, its own and those of others: a ladder of scenes, each also with everything forced in.

    python -m benchmarks.specialisation [--rungs base mesh …] [--rounds 7]
    python -m benchmarks.specialisation --counts        the table of tests/test_specialisation.py, to paste

Writes docs/specialisation.md, docs/charts/specialisation.png and .svg, and the figures as .csv beside them.
"""

import argparse
import csv
import datetime
from io import StringIO
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

from benchmarks.interleave import Picture, Spread, interleaved, picture, ratios, spread
from benchmarks.jaxrt_side import use_cores
from benchmarks.ladder import LADDER, build, count, forced, program
from benchmarks.meshes import markdown, versions
from benchmarks.processes import cpu_model
from jaxrt.core.writing import write_text, write_whole

SIZE, SPP, DEPTH = 128, 16, 4
RUNGS = [name for name in LADDER if name != "no light"]
SIDES = ("own", "forced")
NOISE = 0.004  # how far the forced picture's mean may be off, for the dark light's share of the samples


class Side(NamedTuple):
    """What one program takes."""

    equations: float
    compile_seconds: float  # CPU, tracing included
    kibibytes: float  # temporary memory
    microseconds: Spread  # CPU time of a camera path


class Rung(NamedTuple):
    """A scene: its own program, and the one with every feature."""

    name: str
    own: Side
    forced: Side
    factor: Spread  # forced time in own time, within rounds
    about: str  # date, machine and versions of the figures


def compile_both(name: str) -> list[Picture]:
    """Return the pictures of a rung and of its forced twin, which must show the same."""
    size = {"width": SIZE, "height": SIZE}
    pair = [picture(build(d, **size), SPP, DEPTH) for d in (LADDER[name], forced(LADDER[name]))]
    own, twin = (float(np.mean(p.draw())) for p in pair)
    if abs(own - twin) > NOISE * own:
        raise RuntimeError(f"{name}: with inert features the picture's mean is {twin:.5f} instead of {own:.5f}")
    return pair


def measure(name: str, rounds: int, about: str) -> Rung:
    """Return the figures of one rung; its two programs take turns."""
    pair = compile_both(name)
    times = interleaved({side: p.again for side, p in zip(SIDES, pair, strict=True)}, rounds)
    sides = [
        Side(
            count(p.program.traced),
            p.program.seconds,
            p.program.temporary / 1024,
            spread([1e6 * t / p.paths for t in times[side]]),
        )
        for side, p in zip(SIDES, pair, strict=True)
    ]
    return Rung(name, sides[0], sides[1], spread(ratios(times, "forced", "own")), about)


def write_csv(path: Path, rungs: list[Rung]) -> None:
    """Save the figures, one line a rung and side."""
    text = StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(HEADER)
    for r in rungs:
        for side, numbers in zip(SIDES, (r.own, r.forced), strict=True):
            fixed = [f"{x:g}" for x in numbers[:3]]
            table.writerow([r.name, side, *fixed, *cells(numbers.microseconds), *cells(r.factor), r.about])
    write_text(path, text.getvalue())


def read_csv(path: Path) -> dict[str, Rung]:
    """Return the figures of an earlier run, by rung."""
    if not path.exists():
        return {}
    with path.open(newline="", encoding="utf-8") as file:
        lines = list(csv.reader(file))[1:]
    rungs = {}
    for own, twin in zip(lines[::2], lines[1::2], strict=True):
        sides = [Side(float(r[2]), float(r[3]), float(r[4]), Spread(*map(float, r[5:8]))) for r in (own, twin)]
        rungs[own[0]] = Rung(own[0], sides[0], sides[1], Spread(*map(float, own[8:11])), own[11])
    return rungs


def cells(values: Spread) -> list[str]:
    """Return the numbers of a spread for the file."""
    return [f"{v:.5g}" for v in values]


HEADER = ["rung", "program", "equations", "compile_cpu_s", "temporary_kib"]
HEADER += [f"{what}_{which}" for what in ("cpu_us_a_path", "forced_over_own") for which in Spread._fields] + ["taken"]


def rows_of(rungs: list[Rung]) -> list[list[str]]:
    """Return the table's rows."""
    rows = []
    for r in rungs:
        times = (r.own.microseconds.told(".3f"), r.factor.told())
        parts = [
            [f"{side.equations:.0f}", f"{side.compile_seconds:.1f}", time, f"{side.kibibytes:.0f}"]
            for side, time in zip((r.own, r.forced), times, strict=True)
        ]
        rows.append([r.name, *parts[0], *parts[1]])
    return rows


def draw_chart(stem: Path, rungs: list[Rung]) -> None:
    """Save stem.png and stem.svg: four panels of bars, own beside forced."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    panels = {
        "equations traced": [(r.own.equations, r.forced.equations) for r in rungs],
        "CPU seconds to trace and compile": [(r.own.compile_seconds, r.forced.compile_seconds) for r in rungs],
        "CPU µs a camera path": [(r.own.microseconds.median, r.forced.microseconds.median) for r in rungs],
        "temporary memory, KiB": [(r.own.kibibytes, r.forced.kibibytes) for r in rungs],
    }
    figure, axes = pyplot.subplots(2, 2, figsize=(11, 7), layout="constrained", sharex=True)
    place = np.arange(len(rungs))
    for axis, (title, values) in zip(axes.flat, panels.items(), strict=True):
        for k, (side, colour) in enumerate(zip(SIDES, ("#2a6f97", "#d9a441"), strict=True)):
            label = "compiled for what the scene has" if side == "own" else "with every feature forced in"
            axis.bar(place + 0.4 * k - 0.2, [v[k] for v in values], 0.4, color=colour, label=label)
        axis.set_title(title, fontsize="medium")
        axis.set_xticks(place, [r.name for r in rungs], rotation=40, ha="right")
        axis.grid(axis="y", alpha=0.3)
        axis.set_axisbelow(True)
    for r, x in zip(rungs, place, strict=True):
        top = (x + 0.2, r.forced.microseconds.median)
        axes[1, 0].annotate(f"×{r.factor.median:.1f}", top, ha="center", va="bottom", fontsize=7)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=2, frameon=False)
    stem.parent.mkdir(parents=True, exist_ok=True)
    for suffix in ("png", "svg"):
        write_whole(
            stem.with_suffix(f".{suffix}"), lambda file, format=suffix: figure.savefig(file, format=format, dpi=120)
        )


def summary(rungs: list[Rung]) -> str:
    """Return what the figures say, in a paragraph."""
    by_name = {r.name: r for r in rungs}
    base, full = by_name["base"], by_name["everything"]
    factors = sorted((r.factor.median, r.name) for r in rungs if r.name not in ("base", "everything"))
    return (
        f"The program of one sphere under a point light has {base.own.equations:.0f} equations and takes "
        f"{base.own.compile_seconds:.1f} CPU seconds to compile; with every feature it has "
        f"{base.forced.equations:.0f} and takes {base.forced.compile_seconds:.1f}, and each of its paths costs "
        f"{base.factor.median:.1f} times as much. Of the other scenes, *{factors[0][1]}* gains least from leaving out "
        f"what it lacks (a forced path costs {factors[0][0]:.2f} times its own) and *{factors[-1][1]}* most "
        f"({factors[-1][0]:.2f} times). The scene that has everything already pays {full.factor.median:.2f} times its "
        "own time: more inert objects cost little where the code for them is there anyway. "
        f"The dearest feature is the tree of a mesh: it takes {by_name['mesh'].own.compile_seconds:.0f} of the "
        f"{full.own.compile_seconds:.0f} seconds that everything takes to compile."
    )


INTRODUCTION = f"""A scene's structure decides what is compiled: what it lacks is `None`, and there is no code for it. \
This page measures what that is worth. *Own* is the program that `render` compiles for a scene. *Forced* is the program
of the same scene with every feature in it: unused materials of mirror and glass, a black environment, and inside the
opaque white ball, where no ray comes, a smooth mesh of 320 faces (so triangles, a tree and smooth normals) and a dark
sphere light (so sphere lights and a choice among lights). It shows the same picture; the dark light takes 1/200 of the
light samples, which is noise (means agree to {NOISE:.1%}, or the command fails).

Pictures of {SIZE}×{SIZE} pixels, {SPP} samples, max_depth {DEPTH}, one core. Equations: of the traced program, inner \
programs included.
Compile: CPU seconds to trace and compile, once, nothing cached. Memory: temporary memory of the compiled program
(`memory_analysis`). Time: CPU time of a camera path, median of rounds (least–most); the factor is formed within rounds.
The two programs of a scene take turns in every round.
"""

HEAD = ["scene", "equations", "compile s", "CPU µs a path", "KiB"]
FORCED_HEAD = ["forced: equations", "compile s", "time, × own", "KiB"]

GUARD = """## Kept so

`tests/test_specialisation.py` holds the number of equations of each rung. A feature added to the code must leave the
programs of scenes without it as they were; where a number changes for a good reason,
`python -m benchmarks.specialisation --counts` prints the table anew.
"""


def write_page(path: Path, rungs: list[Rung], rounds: int) -> None:
    """Write the page, the chart and the figures."""
    stem = path.parent / "charts" / path.stem
    draw_chart(stem, rungs)
    write_csv(stem.with_suffix(".csv"), rungs)
    about = "; ".join(dict.fromkeys(r.about for r in rungs))
    parts = [
        "# What a scene pays for: no more than it has\n",
        f"{about}; medians of {rounds} rounds. "
        f"Written by `python -m benchmarks.specialisation`; figures in [CSV](charts/{path.stem}.csv).\n",
        INTRODUCTION,
        f"![Four measures of each scene, own and forced](charts/{path.stem}.png)\n",
        markdown([*HEAD, *FORCED_HEAD], rows_of(rungs)),
        summary(rungs) + "\n",
        GUARD,
    ]
    write_text(path, "\n".join(parts))


def main() -> None:
    """Measure, print and write, or print the counts alone."""
    parser = argparse.ArgumentParser(description="What specialisation to a scene is worth.")
    parser.add_argument("--report", type=Path, default=Path("docs/specialisation.md"))
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--rungs", nargs="*", choices=RUNGS, default=RUNGS, help="others keep their figures on file")
    parser.add_argument("--counts", action="store_true", help="print the equations of each rung, and no more")
    options = parser.parse_args()
    use_cores(1)
    if options.counts:
        print(f'COUNTED_WITH = "{jax.__version__}"\nCOUNTS = {{')
        print("\n".join(f'    "{name}": {count(program(name))},' for name in LADDER) + "\n}")
        return
    about = f"{datetime.date.today().isoformat()}; {cpu_model()}; {versions()}"
    file = options.report.parent / "charts" / f"{options.report.stem}.csv"
    file.parent.mkdir(parents=True, exist_ok=True)
    known = read_csv(file)
    for name in options.rungs:
        known[name] = measure(name, options.rounds, about)
        print(
            f"{name}: compiled in {known[name].own.compile_seconds:.1f} and {known[name].forced.compile_seconds:.1f} s"
        )
        write_csv(file, list(known.values()))
    missing = [name for name in RUNGS if name not in known]
    if missing:
        print(f"no page without figures of {', '.join(missing)}")
        return
    write_page(options.report, [known[name] for name in RUNGS], options.rounds)
    print(options.report.read_text(encoding="utf-8"))


if __name__ == "__main__":
    main()
