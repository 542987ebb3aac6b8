"""Reading files, with errors that name the file and the remedy."""

import difflib
import os
import stat
from collections.abc import Sequence
from pathlib import Path

from jaxrt.description import SceneError, show

MIB = 2**20
SCENE_BYTES = 32 * MIB  # the most that a file of each kind may have
MESH_BYTES = 2048 * MIB
NAMES = 10_000  # of a folder, among which the nearest is sought


def read_bytes(
    path: Path,
    suffixes: Sequence[str],
    thing: str = "a file",
    remedy: str = "check the path",
    limit: int = MESH_BYTES,
) -> bytes:
    """Return the bytes of a regular file of at most `limit` bytes.

    Raises SceneError for anything else (a pipe or a device might never end), and with the nearest existing name that
    ends in one of `suffixes` where there is no such file.
    """
    try:
        # Not to wait for somebody to write into a pipe
        number = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
        with open(number, "rb") as file:
            _check_kind(path, os.fstat(number), thing, limit)
            return file.read(limit)
    except FileNotFoundError:
        raise SceneError(f"{path}: no such file{_nearest(path, suffixes, remedy)}") from None
    except IsADirectoryError:
        raise SceneError(f"{path}: is a folder: name {thing} in it") from None
    except SceneError:
        raise
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise SceneError(f"{path}: cannot be read ({reason}): check the file") from None


def _check_kind(path: Path, status: os.stat_result, thing: str, limit: int) -> None:
    if stat.S_ISDIR(status.st_mode):
        raise SceneError(f"{path}: is a folder: name {thing} in it")
    if not stat.S_ISREG(status.st_mode):
        raise SceneError(f"{path}: is a pipe or a device, no regular file: copy its content to a file")
    if status.st_size > limit:
        raise SceneError(f"{path}: has {status.st_size} bytes, more than {limit}: make it smaller")


def _nearest(path: Path, suffixes: Sequence[str], remedy: str) -> str:
    """Return the remedy for a missing file."""
    if not path.parent.is_dir():
        return f": the folder {show(str(path.parent))} does not exist, {remedy}"
    try:
        with os.scandir(path.parent) as entries:
            names = [e.name for e, _ in zip(entries, range(NAMES), strict=False)]
    except OSError:
        return f": {remedy}"
    near = difflib.get_close_matches(path.name, [n for n in names if Path(n).suffix.lower() in suffixes], n=1)
    return f' (did you mean "{path.with_name(near[0])}"?)' if near else f": {remedy}"
