"""JAX's own files of compiled programs: lent to each run, taken back from runs that end.

JAX keeps the small programs around a render, and all those of a fit. It writes them in place and without a checksum. So
each run has a folder of its own, with the files that are whole; new ones join them when the run ends. A run that was
killed leaves its folder: then all are forgotten, since one of them may have done it.
"""

import atexit
import fcntl
import hashlib
import os
import secrets
import shutil
import warnings
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import jax

from jaxrt.programs.matching import matching
from jaxrt.programs.private import private_folder

LARGEST = 32 << 20  # bytes of all files: each start reads them
RUN = "run-"  # begins the names of runs' folders
DIGITS = 32  # of the SHA-256 at the end of a kept file's name


class Loan(NamedTuple):
    """Files lent to a run."""

    store: Path  # where they come from, and go
    run: Path  # the run's own folder
    lock: int  # descriptor that is open while the run lives


def lend_jax_files(folder: Path) -> None:
    """Let JAX keep programs in the private folder `folder`, until the process ends.

    Raises OSError where that cannot be, NotPrivate where it must not.
    """
    loan = lend(folder)
    jax.config.update("jax_compilation_cache_dir", str(loan.run))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    # Those would lie in the same folder, whose name would be part of what determines a program
    jax.config.update("jax_persistent_cache_enable_xla_caches", "none")
    # A file that it cannot read or write costs time, no more
    warnings.filterwarnings("ignore", "Error (reading|writing) persistent compilation cache entry")
    atexit.register(take_back, loan)


def lend(folder: Path) -> Loan:
    """Return a new folder with the files that are whole."""
    store = private_folder(folder / "jax")
    _forget_killed(folder, store)
    run, lock = _own_folder(folder)
    for file in store.iterdir():
        with suppress(OSError):  # another run may forget it this moment
            name, _, digest = file.name.rpartition(".")
            content = file.read_bytes()
            if _digest(content) == digest:
                (run / name).write_bytes(content)
            else:
                file.unlink()
    return Loan(store, run, lock)


def take_back(loan: Loan) -> None:
    """Keep the run's new files, the newest of all, and remove its folder."""
    store, run, lock = loan
    with suppress(OSError):
        there = {file.name.rpartition(".")[0] for file in store.iterdir()}
        for file in run.glob("*-cache"):
            if file.name not in there and file.stat().st_size:
                file.write_bytes(content := matching(file.read_bytes()))
                file.chmod(0o600)
                file.replace(store / f"{file.name}.{_digest(content)}")
        room = LARGEST
        for file in sorted(store.iterdir(), key=lambda file: -file.stat().st_mtime):
            room -= file.stat().st_size
            if room < 0:
                file.unlink(missing_ok=True)
    shutil.rmtree(run, ignore_errors=True)
    os.close(lock)


def _forget_killed(folder: Path, store: Path) -> None:
    """Empty the store where a run has not ended, yet lives no more."""
    for run in folder.glob(f"{RUN}*"):
        with suppress(OSError):
            lock = _lock(run)
            for file in store.iterdir():
                file.unlink(missing_ok=True)
            shutil.rmtree(run, ignore_errors=True)
            os.close(lock)


def _own_folder(folder: Path) -> tuple[Path, int]:
    """Return a new folder, and its lock. Whoever sees it by its name sees it locked."""
    number = secrets.token_hex(8)
    new, run = folder / f"new-{number}", folder / f"{RUN}{number}"
    new.mkdir(mode=0o700)
    try:
        lock = _lock(new)
        new.rename(run)
    except OSError:  # the file system knows no locks
        new.rmdir()
        raise
    return run, lock


def _lock(run: Path) -> int:
    """Return the open folder, locked while the process lives. Raises OSError where another one holds it."""
    descriptor = os.open(run, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:DIGITS]
