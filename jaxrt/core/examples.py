"""The scenes that come with jaxrt, with their meshes and pictures. Imports nothing large."""

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from jaxrt.core.messages import SceneError, nearest, show

PACKAGE = Path(__file__).parents[1]


def _folder() -> Path:
    """Return where the scenes are: in the package once it is installed, beside it in a checkout."""
    installed = PACKAGE / "scenes"
    return installed if installed.is_dir() else PACKAGE.parent / "scenes"


def examples() -> dict[str, Path]:
    """Return the scene files by their names."""
    return {path.stem: path for path in sorted(_folder().rglob("*.toml"), key=lambda path: path.stem)}


def example_file(name: str) -> Path:
    """Return the scene file of a name. Raises SceneError where there is none, with the nearest name."""
    files = examples()
    if name not in files:
        raise SceneError(f"example {show(name)}: there is none of this name{nearest(name, files)}")
    return files[name]


def about(path: Path) -> str:
    """Return the sentence that a scene file begins with."""
    with path.open(encoding="utf-8") as file:
        return file.readline().lstrip("#").strip()


def copy_of(name: str) -> tuple[str, dict[str, bytes]]:
    """Return the text of an example whose meshes and pictures lie beside it, and these by their names there."""
    path = example_file(name)
    text, files = path.read_text(encoding="utf-8"), {}
    for word in _words(tomllib.loads(text)):
        if (path.parent / word).is_file():
            beside = Path(word).name
            files[beside] = (path.parent / word).read_bytes()
            text = text.replace(f'"{word}"', f'"{beside}"')
    return text, files


def _words(value: Any) -> Iterator[str]:
    """Yield all texts in a document."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list):
        for part in value.values() if isinstance(value, dict) else value:
            yield from _words(part)
