"""Files that appear whole or not at all."""

import errno
import fcntl
import os
import re
import secrets
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

PART = re.compile(r"\.jaxrt-[0-9a-f]{16}")  # names of files being written: short, so that every legal name can be


def write_whole(path: Path, write: Callable[[BinaryIO], object], mode: int | None = None) -> None:
    """Let `write` fill a hidden neighbour of `path` with a random name, then rename it to `path`.

    Where either raises, or is interrupted, there is no neighbour left, and what was at `path` before still is. The file
    has the permissions `mode`, by default those of the file that it replaces, else those of new files. A link is
    replaced, not followed. What was written has reached the disk when this returns. Raises OSError, always with `path`
    and a reason.
    """
    with _naming(path):
        found = _mode(path)
        _sweep(path.parent)
        with _part(path.parent, found if mode is None else mode) as (part, file):
            write(file)
            file.flush()
            os.fsync(file.fileno())
            os.replace(part, path)
    with suppress(OSError):  # some file systems know no such thing
        _sync(path.parent)


def write_text(path: Path, text: str) -> None:
    """Write the text in UTF-8, as `write_whole` does."""
    write_whole(path, lambda file: file.write(text.encode()))


def check_place(path: Path) -> None:
    """Raise OSError, with `path` and a reason, where no file of this name can be: too long, a folder, a device."""
    with _naming(path):
        _mode(path)


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Let errors name the file that was to be written, whatever they name, and say why."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno or errno.EIO, error.strerror or str(error), str(path)) from error


def _mode(path: Path) -> int | None:
    """Return the permissions of the file at `path`, None where there is none. Raises OSError where none can be."""
    try:
        found = path.lstat().st_mode
    except FileNotFoundError:
        return None
    if stat.S_ISDIR(found):
        raise OSError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(found) and not stat.S_ISLNK(found):
        raise OSError(errno.EINVAL, "is a device or a pipe, not a file")
    return found & 0o777 if stat.S_ISREG(found) else None


@contextmanager
def _part(folder: Path, mode: int | None) -> Iterator[tuple[Path, BinaryIO]]:
    """Make a file of this process's own, which is gone at the end unless it was renamed."""
    part, descriptor = _create(folder, 0o666 if mode is None else mode & 0o600)
    try:
        with open(descriptor, "wb") as file:
            if mode is not None:
                os.fchmod(descriptor, mode)
            yield part, file
    finally:
        part.unlink(missing_ok=True)


def _create(folder: Path, mode: int) -> tuple[Path, int]:
    """Return a new file that nobody can have planted, locked as long as it is open, and its descriptor."""
    while True:
        part = folder / f".jaxrt-{secrets.token_hex(8)}"
        descriptor = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, mode)
        with suppress(OSError):  # some file systems know no locks, and then nobody sweeps
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        if os.fstat(descriptor).st_nlink:  # else it was swept before it was locked
            return part, descriptor
        os.close(descriptor)


def _sweep(folder: Path) -> None:
    """Remove what killed processes left in a folder: the parts that nobody has locked."""
    with suppress(OSError):
        for name in filter(PART.fullmatch, os.listdir(folder)):
            with suppress(OSError):
                # A pipe of this name must not hold us up, nor a link lead us elsewhere
                flags = os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
                with open(os.open(folder / name, flags), "wb", buffering=0) as file:
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    os.unlink(folder / name)


def _sync(folder: Path) -> None:
    """Let the name reach the disk too."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
