"""Reading files, with errors that name the file and the remedy."""

import difflib
from collections.abc import Sequence
from pathlib import Path

from jaxrt.description import SceneError, show


def read_bytes(path: Path, suffixes: Sequence[str], thing: str = "a file", remedy: str = "check the path") -> bytes:
    """Return the bytes of a file, or raise SceneError with the nearest existing name that ends in one of `suffixes`."""
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise SceneError(f"{path}: no such file{_nearest(path, suffixes, remedy)}") from None
    except IsADirectoryError:
        raise SceneError(f"{path}: is a folder: name {thing} in it") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise SceneError(f"{path}: cannot be read ({reason}): check the file") from None


def _nearest(path: Path, suffixes: Sequence[str], remedy: str) -> str:
    """Return the remedy for a missing file."""
    if not path.parent.is_dir():
        return f": the folder {show(str(path.parent))} does not exist, {remedy}"
    names = [p.name for p in path.parent.iterdir() if p.suffix.lower() in suffixes]
    near = difflib.get_close_matches(path.name, names, n=1)
    return f' (did you mean "{path.with_name(near[0])}"?)' if near else f": {remedy}"
