"""Progress on stderr: a bar on a terminal, lines elsewhere."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from jaxrt.chunks import CHUNKS


@contextmanager
def progress(count: int, unit: str = "spp") -> Iterator[Callable[[int], None]]:
    """Yield a function to call with the units done: a bar on a terminal, lines elsewhere, on stderr."""
    if not sys.stderr.isatty():
        yield _lines(count, unit)
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("compiling", total=count)

        def update(done: int) -> None:
            # Forget the time of compiling, or the time left would count it
            if done == 0:
                bar.reset(task, description="rendering")
            bar.update(task, completed=done)

        yield update


def _lines(count: int, unit: str) -> Callable[[int], None]:
    """Return a function that prints a line for each twentieth of the count; 0 starts its clock."""
    start, told = time.perf_counter(), 0

    def report(done: int) -> None:
        nonlocal start, told
        if done == 0:
            start = time.perf_counter()
        elif done * CHUNKS // count > told:
            told = done * CHUNKS // count
            left = (time.perf_counter() - start) * (count - done) / done
            print(f"jaxrt: {done}/{count} {unit}, {left:.1f} s left", file=sys.stderr, flush=True)

    return report
