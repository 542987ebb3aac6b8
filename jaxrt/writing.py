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
    has the permissions of the one that it replaces, else those of `mode`, else those of new files. A link is replaced,
    not followed. What it says has reached the disk when this returns. Raises OSError, always with `path` and a reason.
    """
    with _naming(path), _opened(path.parent) as folder:
        if mode is None:
            mode = _mode(path.name, folder)
        _sweep(path.parent, folder)
        with _part(folder, mode) as (name, file):
            write(file)
            file.flush()
            os.fsync(file.fileno())
            os.replace(name, path.name, src_dir_fd=folder, dst_dir_fd=folder)
    with suppress(OSError):  # some file systems know no such thing
        _sync(path.parent)


def check_place(path: Path) -> None:
    """Raise OSError, with `path` and a reason, where no file of this name can be: too long, a folder, a device."""
    with _naming(path), _opened(path.parent) as folder:
        _mode(path.name, folder)


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Let errors name the file that was to be written, whatever they name, and say why."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno or errno.EIO, error.strerror or str(error), str(path)) from error


@contextmanager
def _opened(folder: Path) -> Iterator[int]:
    """Open a folder, so that all that follows happens in the same one."""
    descriptor = os.open(folder, getattr(os, "O_PATH", os.O_RDONLY) | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        yield descriptor
    finally:
        os.close(descriptor)


def _mode(name: str, folder: int) -> int | None:
    """Return the permissions of the file of this name, None where there is none. Raises OSError for a name unfit."""
    try:
        found = os.stat(name or ".", dir_fd=folder, follow_symlinks=False).st_mode
    except FileNotFoundError:
        return None
    if stat.S_ISDIR(found):
        raise OSError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(found) and not stat.S_ISLNK(found):
        raise OSError(errno.EINVAL, "is a device or a pipe, not a file")
    return found & 0o777 if stat.S_ISREG(found) else None


@contextmanager
def _part(folder: int, mode: int | None) -> Iterator[tuple[str, BinaryIO]]:
    """Make a file that is this process's own as long as it lives, and that nobody can have planted."""
    while True:
        name = f".jaxrt-{secrets.token_hex(8)}"
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
        descriptor = os.open(name, flags, 0o666 if mode is None else mode & 0o600, dir_fd=folder)
        try:
            with open(descriptor, "wb") as file:
                _lock(descriptor)
                if os.fstat(descriptor).st_nlink == 0:  # swept before it was locked
                    continue
                if mode is not None:
                    os.fchmod(descriptor, mode)
                yield name, file
                return
        finally:
            with suppress(FileNotFoundError):
                os.unlink(name, dir_fd=folder)


def _lock(descriptor: int) -> None:
    """Tell others that the process lives, where the file system can."""
    with suppress(OSError):
        fcntl.flock(descriptor, fcntl.LOCK_EX)


def _sweep(path: Path, folder: int) -> None:
    """Remove what killed processes left in a folder: the parts that nobody has locked."""
    with suppress(OSError):
        for name in filter(PART.fullmatch, os.listdir(path)):
            with suppress(OSError):
                # A pipe of this name must not hold us up, nor a link lead us elsewhere
                flags = os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
                with open(os.open(name, flags, dir_fd=folder), "wb", buffering=0) as file:
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    os.unlink(name, dir_fd=folder)


def _sync(folder: Path) -> None:
    """Let the name reach the disk too."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
