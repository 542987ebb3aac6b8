"""Ctrl-C, TERM and HUP: at once where there is nothing to lose, else when the work so far can be kept."""

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM, *((signal.SIGHUP,) if hasattr(signal, "SIGHUP") else ()))
NOTHING = "jaxrt: interrupted, nothing written"


class Interrupted(KeyboardInterrupt):
    """A signal that ends the command."""

    def __init__(self, number: int) -> None:
        self.number = number


class Stop:
    """Whether to stop: the number of the first signal that came, 0 before."""

    number = 0


def status_of(interrupt: KeyboardInterrupt) -> int:
    """Return the exit status, 128 + n for signal n."""
    return 128 + getattr(interrupt, "number", signal.SIGINT)


@contextmanager
def leaving() -> Iterator[None]:
    """Let signals end the process with one line. A raise inside an import may be swallowed, or become a traceback."""

    def leave(number: int) -> None:
        os.write(2, f"{NOTHING}\n".encode())
        os._exit(128 + number)

    with _handled(leave):
        yield


@contextmanager
def raising() -> Iterator[None]:
    """Let signals raise Interrupted."""

    def interrupt(number: int) -> None:
        raise Interrupted(number)

    with _handled(interrupt):
        yield


@contextmanager
def noted() -> Iterator[Stop]:
    """Yield what tells whether a signal came: nothing inside is interrupted, so that no sum is torn."""
    stop = Stop()

    def note(number: int) -> None:
        stop.number = stop.number or number

    with _handled(note):
        yield stop


@contextmanager
def _handled(handle: Callable[[int], None]) -> Iterator[None]:
    before = {}

    def handler(number: int, frame: FrameType | None) -> None:
        handle(number)

    try:
        for number in SIGNALS:
            if signal.getsignal(number) not in (signal.SIG_IGN, None):  # nohup means it
                before[number] = signal.signal(number, handler)
    except ValueError:  # not the main thread, which signals do not reach
        pass
    try:
        yield
    finally:
        for number, old in before.items():
            signal.signal(number, old)
