"""Progress on stderr: a bar on a terminal, a few lines elsewhere."""

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

COMPILING_SECONDS = 1.0  # that may pass in silence
FIRST_SECONDS, NEXT_SECONDS = 5.0, 10.0  # between lines


@contextmanager
def progress(count: int, unit: str = "spp") -> Iterator[Callable[[int], None]]:
    """Yield a function to call with the units done, first with those that were done before: it starts the clock."""
    if not sys.stderr.isatty():
        yield _lines(count, unit)
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task, started = bar.add_task("compiling", total=count), False

        def update(done: int) -> None:
            nonlocal started
            # Forget the time of compiling, or the time left would count it
            if not started:
                bar.reset(task, description="rendering")
                started = True
            bar.update(task, completed=done)

        yield update


@contextmanager
def compiling() -> Iterator[None]:
    """Say so where there is no bar to say it, once it takes long."""
    timer = threading.Timer(COMPILING_SECONDS, lambda: print("jaxrt: compiling", file=sys.stderr, flush=True))
    timer.daemon = True
    if not sys.stderr.isatty():
        timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _lines(count: int, unit: str) -> Callable[[int], None]:
    """Return a function that prints a line now and then."""
    start, begun, due = 0.0, -1, 0.0

    def report(done: int) -> None:
        nonlocal start, begun, due
        now = time.perf_counter()
        if begun < 0:
            start, begun, due = now, done, now + FIRST_SECONDS
        elif begun < done < count and now >= due:
            due = now + NEXT_SECONDS
            left = (now - start) * (count - done) / (done - begun)
            print(f"jaxrt: {done}/{count} {unit}, {left:.0f} s left", file=sys.stderr, flush=True)

    return report
