"""Reads a case in process, within a time limit, and says what is wrong with how that ended."""

import os
import signal
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

LONGEST = 1000  # characters of a message
SECONDS = 20.0  # of a case, hundreds of times what it takes


class Case(NamedTuple):
    """A file, and what must come of it."""

    name: str  # what was done to it
    content: bytes
    kind: str  # suffix of the file, with its dot
    taken: bool | None = None  # True: must be read. False: must be refused. None: either
    check: Callable[[Any], str] = lambda result: ""  # what is wrong with the result of reading it, or nothing
    names: str = ""  # what a refusal must name, where the file can be parsed


class Verdict(NamedTuple):
    """How a case ended."""

    case: Case
    fault: str  # "", or "crash", "hang", "message", "reason", "accepted", "refused", "wrong"
    text: str


class Hang(BaseException):
    """The time is up."""


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Raise Hang after `seconds`; on the main thread alone."""

    def stop(signum: int, frame: object) -> None:
        raise Hang

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def judge(case: Case, folder: Path, read: Callable[[Path], Any]) -> Verdict:
    """Return what came of reading the case's file, which is written into `folder`.

    Refused is what raises ValueError (SceneError is one) in one printable line that names the file.
    """
    path = folder / f"case{case.kind}"
    path.write_bytes(case.content)
    try:
        with time_limit(SECONDS), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            result = read(path)
    except Hang:
        return Verdict(case, "hang", f"more than {SECONDS:g} s")
    except ValueError as error:
        return _refusal(case, path, error)
    except Exception:
        return Verdict(case, "crash", traceback.format_exc().strip())
    if case.taken is False:
        return Verdict(case, "accepted", repr(result)[:200])
    wrong = case.check(result)
    return Verdict(case, "wrong" if wrong else "", wrong)


def _refusal(case: Case, path: Path, error: ValueError) -> Verdict:
    text = str(error)
    if not text.startswith(str(path)) or not text.isprintable() or len(text) > LONGEST:
        return Verdict(case, "message", f"{type(error).__name__} of {len(text)} characters: {text[:300]!r}")
    if case.names not in text and "not valid TOML" not in text:
        return Verdict(case, "reason", text)
    return Verdict(case, "refused" if case.taken else "", text)


def run(cases: Iterable[Case], folder: Path, read: Callable[[Path], Any]) -> tuple[Counter[str], list[Verdict]]:
    """Return how many cases were read, were refused, and had each fault; and the verdicts with one."""
    counts: Counter[str] = Counter()
    faults = []
    for case in cases:
        verdict = judge(case, folder, read)
        counts["cases"] += 1
        counts[verdict.fault or ("refused in one line" if verdict.text else "read")] += 1
        if verdict.fault:
            faults.append(verdict)
    return counts, faults


def traps(folder: Path) -> None:
    """Make what must not be opened: a FIFO, links to a device, out of the folder and in a circle."""
    os.mkfifo(folder / "pipe.obj")
    (folder / "zero.obj").symlink_to("/dev/zero")
    (folder / "loop.obj").symlink_to("loop.obj")
    (folder / "out.obj").symlink_to("/etc/hostname")
    (folder / "folder.obj").mkdir()
    (folder / "empty.obj").touch()
