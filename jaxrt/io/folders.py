"""What a file may name: files in its own folder or below, and in folders that the user allows."""

import os
from collections.abc import Sequence
from pathlib import Path

from jaxrt.description import SceneError, show
from jaxrt.io.files import StrPath

LONGEST = 250  # characters of a name

Folders = Sequence[StrPath]


def folders_of(allow_folders: Folders | StrPath) -> tuple[StrPath, ...]:
    """Return the folders as a tuple; one name stands for itself, since its letters would allow all of the system."""
    return (allow_folders,) if isinstance(allow_folders, str | os.PathLike) else tuple(allow_folders)


def named_file(name: str, owner: Path, place: str, allow_folders: Folders = ()) -> Path:
    """Return the path of a file that the file `owner` names at `place`, such as "line 3".

    Raises SceneError where it lies outside of the owner's folder and of `allow_folders`, symbolic links resolved: a
    file from somebody else must not choose what is opened here.
    """
    path = owner.parent / name
    if len(name) > LONGEST:
        raise SceneError(f"{owner}: {place}: {show(name)} names no file (it is too long): correct it")
    try:
        real = path.resolve()
        roots = [Path(folder).resolve() for folder in (owner.parent, *folders_of(allow_folders))]
    except (OSError, ValueError, RuntimeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise SceneError(f"{owner}: {place}: {show(name)} names no file ({reason}): correct it") from None
    if not any(real.is_relative_to(root) for root in roots):
        raise SceneError(
            f"{owner}: {place}: {show(name)} lies outside of the file's folder: move it there, or allow its own by "
            f"--allow-folder {show(str(real.parent))} (in Python: allow_folders=)"
        )
    return path
