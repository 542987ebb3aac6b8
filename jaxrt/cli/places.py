"""Where results go: one rule for all commands. A folder on the way is never made, a file is never a folder, nor a
folder a file; results of an earlier run are replaced."""

import os
from pathlib import Path

from jaxrt.cli.errors import UsageError, refusing
from jaxrt.core.messages import show
from jaxrt.core.writing import check_place


def check_file(path: Path, name: str = "a file") -> None:
    """Refuse, before any work, a file that could not be written; `name` is what might be named in a folder instead."""
    with refusing():
        if path.is_dir():
            raise UsageError(f"{path}: is a folder: name a file in it, such as {path / name}")
        _check_parent(path)
        check_place(path)
    _check_writable(path, path.parent)


def check_folder(path: Path) -> None:
    """Refuse, before any work, a folder of results that could neither be made nor taken as it is."""
    with refusing():
        if path.is_dir():
            _check_writable(path, path)
            return
        if os.path.lexists(path):
            raise UsageError(f"{path}: is a file, and the results are several: name a folder")
        _check_parent(path)
    _check_writable(path, path.parent)


def _check_parent(path: Path) -> None:
    if path.parent.is_dir():
        return
    if path.parent.exists():
        raise UsageError(f"{path}: {show(str(path.parent))} is a file, not a folder: choose another")
    raise UsageError(f"{path}: the folder {show(str(path.parent))} does not exist: make it first")


def _check_writable(path: Path, folder: Path) -> None:
    if not os.access(folder, os.W_OK | os.X_OK):
        raise UsageError(f"{path}: the folder {show(str(folder))} is not writable: choose another")
