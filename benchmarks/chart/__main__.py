"""Error against CPU time, log-log: measure, draw, and write the page.

    python -m benchmarks.chart [--quick] [--only NAME...] [--output docs] [--peer-python PATH]
    python -m benchmarks.chart --draw          charts and page again, from the CSV files

Runs on one core. Each chart's numbers are saved as soon as it is measured.
"""

import argparse
import datetime
import os
import platform
import tempfile
import warnings
from contextlib import ExitStack
from pathlib import Path

import jax
from rich.console import Console
from rich.progress import Progress

import jaxrt
from benchmarks.chart.edges import edges
from benchmarks.chart.gradients import derivatives
from benchmarks.chart.measure import Sweep
from benchmarks.chart.peer import Peer
from benchmarks.chart.references import cache_folder
from benchmarks.chart.store import draw_all, save
from benchmarks.chart.studies import STUDIES, Methods, Settings
from benchmarks.jaxrt_side import use_cores
from benchmarks.processes import cpu_model, find_peer, wide_console

FULL = Sweep(short=(1, 4, 16, 64, 256), long=(1024, 4096), seeds=16, few=4)
QUICK = Sweep(short=(1, 4), long=(), seeds=2, few=2)
# Every kind of method once: what is left out differs in numbers alone, and compiling is most of a quick run
QUICK_METHODS = Methods(
    ("sobol", "stratified"), ("sobol",), (1, 4, 5, 8), edges=(16384,), steps=(0.1,), panels=1, fd_spp=64, fd_keys=4
)
SINGLE = {**STUDIES, "edges": edges}
DERIVATIVES = "derivatives"


def settings_of(quick: bool, progress: Progress, peer: Peer | None) -> Settings:
    """Return how much is measured."""
    if quick:
        return Settings(QUICK, (16, 2), (4, 2), 8, QUICK_METHODS, cache_folder(), progress, peer)
    return Settings(FULL, (8192, 8), (1024, 8), 128, Methods(), cache_folder(), progress, peer)


def circumstances(peer: str, quick: bool) -> dict[str, str]:
    """Return when and on what a chart was measured."""
    return {
        "date": datetime.date.today().isoformat(),
        "cpu": cpu_model(),
        "versions": f"Python {platform.python_version()}, jax {jax.__version__}; {peer}",
        "settings": "--quick" if quick else "full",
        "load": f"{os.getloadavg()[2]:.2f}",
    }


def measure_all(options: argparse.Namespace, folder: Path, console: Console) -> None:
    """Measure the charts that are asked for, one after another."""
    python, message = find_peer(options.peer_python)
    console.print(f"{cpu_model()}; {message}")
    with ExitStack() as stack:
        progress = stack.enter_context(Progress(console=console, transient=True))
        peer = stack.enter_context(Peer(python)) if python else None
        settings = settings_of(options.quick, progress, peer)
        for name in options.only:
            if name == DERIVATIVES:
                studies = derivatives(settings)
            else:
                studies = {name: SINGLE[name](settings)}
            for each, study in studies.items():
                save(folder, each, study, circumstances(message, options.quick))
            console.print(f"{datetime.datetime.now():%H:%M:%S} {name} measured")


def arguments() -> argparse.Namespace:
    """Return the parsed command line."""
    names = [*SINGLE, DERIVATIVES]
    parser = argparse.ArgumentParser(description="Charts of error against CPU time.")
    parser.add_argument("--quick", action="store_true", help="few samples and seeds, into a temporary folder")
    parser.add_argument("--only", nargs="+", default=names, choices=names, metavar="NAME", help=", ".join(names))
    parser.add_argument("--draw", action="store_true", help="measure nothing")
    parser.add_argument("--output", type=Path, help="folder of charts.md and charts/; default: docs")
    parser.add_argument("--peer-python", help="python of Mitsuba; default: $JAXRT_MITSUBA_PYTHON")
    return parser.parse_args()


def main() -> None:
    """Measure, draw, write."""
    options, console = arguments(), wide_console()
    warnings.simplefilter("ignore", jaxrt.SceneWarning)
    use_cores(1)
    # Compiled programs are kept: what is timed never contains compilation
    jax.config.update("jax_compilation_cache_dir", str(cache_folder().parent / "benchmarks"))
    output = options.output or Path(tempfile.mkdtemp(prefix="charts-") if options.quick else "docs")
    if not options.draw:
        measure_all(options, output / "charts", console)
    draw_all(output)
    console.print(f"charts and page in {output}")


if __name__ == "__main__":
    main()
