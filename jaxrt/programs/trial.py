"""A program on trial leaves a trace, so that one that kills the process is tried once only."""

import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

SUFFIX = ".trial"
PATIENCE = 10.0  # seconds for another process's trial, which takes a fraction of one


@contextmanager
def on_trial(program: Path) -> Iterator[bool]:
    """Mark the file as on trial, and tell whether the process that tried it before died of it.

    One process tries at a time. Raises OSError where no mark can be made, or where another process tries for ever.
    """
    mark = program.with_suffix(SUFFIX)
    descriptor = _locked(mark)
    try:
        died = os.fstat(descriptor).st_size > 0  # who lives through it removes the mark
        os.write(descriptor, b"on trial\n")
        yield died
    finally:
        os.unlink(mark)
        os.close(descriptor)


def _locked(mark: Path) -> int:
    """Return the open mark, locked until this process closes it or ends, however it ends."""
    end = time.monotonic() + PATIENCE
    while True:
        descriptor = os.open(mark, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.fstat(descriptor).st_nlink:  # else another's trial ended well since it was opened
                return descriptor
        except BlockingIOError:
            if time.monotonic() > end:
                os.close(descriptor)
                raise
            time.sleep(0.02)
        except OSError:
            os.close(descriptor)
            raise
        os.close(descriptor)
