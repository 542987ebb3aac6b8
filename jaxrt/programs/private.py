"""A folder that nobody but the user can have written in.

Compiled programs are code, and are loaded with the user's rights. Who owns a file, and who may put another in its
place, is all that tells whose code it is: so every folder on the way is looked at, each opened in the one before.
"""

import errno
import os
import stat
from contextlib import suppress
from pathlib import Path

CHOOSE = "set XDG_CACHE_HOME to a folder of yours"
OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
OPEN = getattr(os, "O_PATH", os.O_RDONLY) | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC


class NotPrivate(ValueError):
    """A folder whose files might be another's: one line with the culprit and the remedy."""


def cache_folder() -> Path:
    """Return the place of jaxrt's kept programs, whether it is there or not: absolute, as the XDG standard asks.

    Raises NotPrivate where there is none.
    """
    given = os.environ.get("XDG_CACHE_HOME", "")
    base = given if os.path.isabs(given) else os.path.expanduser("~/.cache")
    if not os.path.isabs(base):
        raise NotPrivate(f"no home folder is known: {CHOOSE}")
    return Path(os.path.normpath(base), "jaxrt")


def private_folder(path: Path, choose: str = CHOOSE) -> Path:
    """Return `path`, an absolute one: a folder of mode 0700 that belongs to the user, made if there is none.

    choose: the remedy where the folder will not do. Raises NotPrivate where a part of the path is a link, belongs to
    another, or may be written by others. A folder such as /tmp, where all may write but nobody may rename what is
    another's, may hold folders of the user.
    """
    if not path.is_absolute() or ".." in path.parts:
        raise NotPrivate(f"{path}: is not absolute: {choose}")
    place = Path(path.anchor)
    folder = os.open(place, OPEN)
    try:
        shared = _check(place, folder, False, choose)
        for name in path.parts[1:]:
            place /= name
            inner = _enter(place, folder, choose)
            os.close(folder)
            folder = inner
            shared = _check(place, folder, shared, choose)
        _check_last(path, folder, choose)
    except OSError as error:
        raise NotPrivate(f"{place}: {error.strerror}: {choose}") from None
    finally:
        os.close(folder)
    return path


def _enter(place: Path, outer: int, choose: str) -> int:
    """Open the folder, made if there is none. Raises NotPrivate for a link."""
    try:
        os.stat(place.name, dir_fd=outer, follow_symlinks=False)
    except FileNotFoundError:
        with suppress(FileExistsError):  # by another run, this moment
            os.mkdir(place.name, 0o700, dir_fd=outer)
    try:
        return os.open(place.name, OPEN, dir_fd=outer)
    except OSError as error:
        if error.errno not in (errno.ELOOP, errno.ENOTDIR):
            raise
        raise NotPrivate(f"{place}: is a link or no folder: {choose}, no link") from None


def _check(place: Path, folder: int, shared: bool, choose: str) -> bool:
    """Return whether others may make files in the folder. Raises NotPrivate where they could change ours.

    shared: whether they may make files in the folder around it.
    """
    found = os.fstat(folder)
    if found.st_uid != os.getuid() and (shared or found.st_uid != 0):
        raise NotPrivate(f"{place}: belongs to another user: {choose}")
    open_to_all = bool(found.st_mode & OTHERS_WRITE)
    if open_to_all and not found.st_mode & stat.S_ISVTX:
        raise NotPrivate(f"{place}: others may write in it: remove it if it is jaxrt's own, else chmod go-w it")
    return open_to_all


def _check_last(path: Path, folder: int, choose: str) -> None:
    """Let nobody but the user look into the folder. Raises NotPrivate where others could write in it until now."""
    found = os.fstat(folder)
    if found.st_uid != os.getuid():
        raise NotPrivate(f"{path}: belongs to another user: {choose}")
    if found.st_mode & OTHERS_WRITE:
        raise NotPrivate(f"{path}: others may write in it: remove it")
    if stat.S_IMODE(found.st_mode) != 0o700:
        os.chmod(".", 0o700, dir_fd=folder)
    if not os.access(".", os.W_OK, dir_fd=folder):
        raise NotPrivate(f"{path}: is not writable: {choose}")
