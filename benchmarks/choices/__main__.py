"""Measure the design choices and write their page.

    python -m benchmarks.choices [NAME …] [--rounds 9] [--report docs/choices.md]

Named choices are measured anew, the others keep their figures on file.
"""

import argparse
import datetime
import time
from pathlib import Path

from benchmarks.choices import bounces, lights, many_lights, offset, packets, spheres, tree, triangles
from benchmarks.choices.figures import read_csv, write_csv
from benchmarks.choices.page import dominating, write_page
from benchmarks.jaxrt_side import use_cores
from benchmarks.meshes import versions
from benchmarks.processes import cpu_model

CHOICES = [m.CHOICE for m in (triangles, offset, spheres, lights, many_lights, bounces, tree, packets)]
NAMES = [c.name for c in CHOICES]


def main() -> None:
    """Measure, write, and print the page."""
    parser = argparse.ArgumentParser(description="Cost and error of each design choice.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(NAMES)}; default: all")
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--page", action="store_true", help="measure nothing, write the page from the figures on file")
    parser.add_argument("--report", type=Path, default=Path("docs/choices.md"))
    options = parser.parse_args()
    unknown = set(options.names) - set(NAMES)
    if unknown:
        parser.error(f"no such choice: {', '.join(unknown)}; there are {', '.join(NAMES)}")
    use_cores(1)
    file = options.report.with_suffix(".csv")
    figures, taken = read_csv(file)
    wanted = [] if options.page else [c for c in CHOICES if c.name in (options.names or NAMES)]
    for choice in wanted:
        start = time.process_time()
        figures = [f for f in figures if f.choice != choice.name] + choice.measure(options.rounds)
        taken[choice.name] = f"{datetime.date.today().isoformat()}; {cpu_model()}; {versions()}"
        print(f"{choice.name}: {time.process_time() - start:.0f} CPU s", flush=True)
        write_csv(file, figures, taken)
    write_page(options.report, CHOICES, figures, taken)
    print(options.report.read_text(encoding="utf-8"))
    for line in dominating([c for c in CHOICES if c.name in taken], figures):
        print(f"OURS IS DOMINATED: {line}")


if __name__ == "__main__":
    main()
