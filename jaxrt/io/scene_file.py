"""Scene files: TOML to description."""

import re
import tomllib
from os import PathLike
from pathlib import Path
from typing import Any

from jaxrt.description import SceneDescription, SceneError, parse_description, show
from jaxrt.io.files import read_bytes
from jaxrt.io.folders import Folders
from jaxrt.io.meshes import read_mesh


def read_description(path: str | PathLike[str], allow_folders: Folders = ()) -> SceneDescription:
    """Return the validated description in the TOML file at `path`, with the meshes that it names.

    What these leave out of their files is carried along, and told by `build`. allow_folders: as for `jaxrt.load_mesh`.
    Raises SceneError, one line that starts with the path, for a missing or unreadable file, malformed TOML,
    unsound meshes, and all that `parse_description` refuses.
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
    return parse_description(_with_mesh_files(mapping, Path(path).parent, source, allow_folders), source)


def _read_text(path: Path) -> str:
    """Return the text of the file, or raise SceneError with the nearest existing name."""
    try:
        return read_bytes(path, (".toml",), "a scene file").decode("utf-8")
    except UnicodeDecodeError as error:
        raise SceneError(f"{path}: not UTF-8 text at byte {error.start}: save it as UTF-8") from None


def _with_mesh_files(mapping: dict[str, Any], folder: Path, source: str, allow_folders: Folders) -> dict[str, Any]:
    """Return the mapping with the arrays of each mesh file in the place of its name."""
    meshes = mapping.get("meshes")
    if not isinstance(meshes, list):
        return mapping
    places = [f"{source}: meshes[{i}]" for i in range(len(meshes))]
    read = [_with_mesh_file(mesh, folder, place, allow_folders) for mesh, place in zip(meshes, places, strict=True)]
    return mapping | {"meshes": read}


def _with_mesh_file(mesh: Any, folder: Path, place: str, allow_folders: Folders) -> Any:
    if isinstance(mesh, dict) and "notes" in mesh:
        raise SceneError(f'{place}: unknown key "notes": leave it out')
    if not isinstance(mesh, dict) or "file" not in mesh:
        return mesh
    file = mesh["file"]
    if not isinstance(file, str):
        raise SceneError(f"{place}.file: {show(file)} is not a name: write a string in quotes")
    for key in ("vertices", "faces"):
        if key in mesh:
            raise SceneError(f'{place}: {show(key)} and "file" exclude each other: leave one out')
    try:
        return read_mesh(folder / file, "material" not in mesh, allow_folders) | mesh
    except SceneError as error:
        raise SceneError(f"{place}.file: {error}") from None


def _describe_syntax(source: str, message: str) -> str:
    """Return tomllib's message with its position, if it has one, put in front as the place."""
    match = re.fullmatch(r"(.*) \(at (line \d+, column \d+|end of document)\)", message, re.DOTALL)
    if match is None:
        return f"{source}: not valid TOML: {message}: correct it".replace("\n", " ")
    return f"{source}: {match[2]}: not valid TOML: {match[1]}: correct the line".replace("\n", " ")
