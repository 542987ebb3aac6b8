"""Scene files: TOML to description."""

import difflib
import re
import tomllib
from os import PathLike
from pathlib import Path

from jaxrt.description import SceneDescription, SceneError, parse_description, show


def read_description(path: str | PathLike[str]) -> SceneDescription:
    """Return the validated description in the TOML file at `path`.

    Raises SceneError, one line that starts with the path, for a missing or unreadable file, malformed TOML,
    and all that `parse_description` refuses.
    """
    source = str(path)
    try:
        mapping = tomllib.loads(_read_text(Path(path)))
    except RecursionError:
        raise SceneError(f"{source}: not valid TOML: nested too deeply: flatten it") from None
    except ValueError as error:
        if isinstance(error, SceneError):
            raise
        raise SceneError(_describe_syntax(source, str(error))) from None
    return parse_description(mapping, source)


def _read_text(path: Path) -> str:
    """Return the text of the file, or raise SceneError with the nearest existing name."""
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise SceneError(f"{path}: no such file{_nearest(path)}") from None
    except UnicodeDecodeError as error:
        raise SceneError(f"{path}: not UTF-8 text at byte {error.start}: save it as UTF-8") from None
    except IsADirectoryError:
        raise SceneError(f"{path}: is a folder: name a scene file in it") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise SceneError(f"{path}: cannot be read ({reason}): check the file") from None


def _nearest(path: Path) -> str:
    """Return the remedy for a missing file."""
    if not path.parent.is_dir():
        return f": the folder {show(str(path.parent))} does not exist, check the path"
    names = [p.name for p in path.parent.glob("*.toml")]
    near = difflib.get_close_matches(path.name, names, n=1)
    return f" (did you mean {show(str(path.with_name(near[0])))}?)" if near else ": check the path"


def _describe_syntax(source: str, message: str) -> str:
    """Return tomllib's message with its position, if it has one, put in front as the place."""
    match = re.fullmatch(r"(.*) \(at (line \d+, column \d+|end of document)\)", message, re.DOTALL)
    if match is None:
        return f"{source}: not valid TOML: {message}: correct it".replace("\n", " ")
    return f"{source}: {match[2]}: not valid TOML: {match[1]}: correct the line".replace("\n", " ")
