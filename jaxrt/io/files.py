"""Reading files: regular ones alone, of bounded size; errors name the file and the remedy."""

import difflib
import os
import stat
from collections.abc import Sequence
from itertools import islice
from pathlib import Path

from jaxrt.core.messages import SceneError, show

MIB = 2**20
SCENE_BYTES = 32 * MIB  # the most that a file of each kind may have, unless the variable says otherwise
MESH_BYTES = 2048 * MIB
PICTURE_BYTES = 1024 * MIB
LIMIT_VARIABLE = "JAXRT_MAX_FILE_SIZE"  # in MiB
MOST_NEIGHBOURS = 1000  # names of a folder that a missing one is compared with

StrPath = str | os.PathLike[str]


def read_bytes(
    path: Path,
    suffixes: Sequence[str],
    thing: str = "a file",
    remedy: str = "check the path",
    limit: int = MESH_BYTES,
) -> bytes:
    """Return the bytes of a regular file of at most `limit` bytes, which JAXRT_MAX_FILE_SIZE (in MiB) replaces.

    Raises SceneError; for a missing file with the nearest existing name that ends in one of `suffixes`. Never waits:
    FIFOs, devices and sockets are refused unread.
    """
    try:
        # Asked before opening, since that alone can move a device
        _check_kind(path, os.stat(path), thing)
        with open(os.open(path, os.O_RDONLY | _quick()), "rb") as file:
            status = os.fstat(file.fileno())
            _check_kind(path, status, thing)
            check_size(path, status.st_size, limit)
            data = file.read(status.st_size + 1)
    except FileNotFoundError:
        raise SceneError(f"{path}: no such file{instead_of(path, suffixes, remedy)}") from None
    except SceneError:
        raise
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise SceneError(f"{path}: cannot be read ({reason}): check the file") from None
    if len(data) > status.st_size:
        raise SceneError(f"{path}: is longer than the system says: copy it to a disk once it is whole")
    return data


def _quick() -> int:
    """Return the flags that let no opening wait for another process or take over a terminal."""
    return getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0) | getattr(os, "O_BINARY", 0)


def _check_kind(path: Path, status: os.stat_result, thing: str) -> None:
    if stat.S_ISDIR(status.st_mode):
        raise SceneError(f"{path}: is a folder: name {thing} in it")
    if not stat.S_ISREG(status.st_mode):
        raise SceneError(f"{path}: is a pipe or a device, no regular file: copy its content to a file")


def check_size(path: Path, size: int, limit: int, what: str = "has") -> None:
    """Raise SceneError where `size` bytes are more than `limit`, or more than JAXRT_MAX_FILE_SIZE allows."""
    text = os.environ.get(LIMIT_VARIABLE)
    if text is not None:
        try:
            limit = int(float(text) * MIB)
        except (ValueError, OverflowError):
            raise SceneError(f"{LIMIT_VARIABLE}: {show(text)} is not a number of MiB: correct it") from None
    if size > limit:
        needed = -(-size // MIB)
        raise SceneError(
            f"{path}: {what} {needed} MiB, {limit / MIB:g} MiB are allowed: make it smaller, or set "
            f"{LIMIT_VARIABLE}={needed}"
        )


def instead_of(path: Path, suffixes: Sequence[str], remedy: str = "check the path") -> str:
    """Return the remedy for a missing file: the nearest name that ends in one of `suffixes`, or `remedy`."""
    try:
        if not path.parent.is_dir():
            return f": the folder {show(str(path.parent))} does not exist, {remedy}"
        with os.scandir(path.parent) as entries:
            names = [entry.name for entry in islice(entries, MOST_NEIGHBOURS)]
    except (OSError, ValueError):
        return f": {remedy}"
    fitting = {name.casefold(): name for name in names if Path(name).suffix.lower() in suffixes}
    # A name without its suffix, then one that is spelt alike
    asked = path.name.casefold()
    near = [asked + suffix for suffix in suffixes if asked + suffix in fitting]
    near = near or difflib.get_close_matches(asked, fitting, n=1)
    return f' (did you mean "{path.with_name(fitting[near[0]])}"?)' if near else f": {remedy}"
