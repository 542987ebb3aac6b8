"""Scene files: TOML to description."""

import codecs
import re
import tomllib
from pathlib import Path
from typing import Any

from jaxrt.core.examples import examples
from jaxrt.description import SceneDescription, SceneError, parse_description, show
from jaxrt.io.files import SCENE_BYTES, StrPath, read_bytes
from jaxrt.io.folders import Folders, folders_of, named_file
from jaxrt.io.meshes import SUFFIXES, read_mesh
from jaxrt.io.textures import with_textures

DEEPEST = 64  # parts of a dotted key; what tomllib does with more grows with their square
# Each part ends for good where it ends, so that the search looks at each character a bounded number of times
_PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+"""
_DOTTED = re.compile(rf"(?<![\w-])(?:{_PART}\.[ \t]*+){{{DEEPEST}}}")


def read_description(path: StrPath, allow_folders: Folders = ()) -> SceneDescription:
    """Return the validated description in the TOML file at `path`, with the meshes and pictures it names.

    What these leave out of their files is carried along, and told by `build`.
    allow_folders: where meshes may lie besides the folder above the file's and all below that.
    Raises SceneError, one line that starts with the path, for a missing or unreadable file, malformed TOML,
    unsound meshes, and all that `parse_description` refuses.
    """
    source = str(path)
    text = read_text(Path(path))
    try:
        mapping = tomllib.loads(text)
    except RecursionError:
        raise SceneError(f"{source}: not valid TOML: nested too deeply: flatten it") from None
    except ValueError as error:
        raise SceneError(_describe_syntax(source, str(error))) from None
    folders = folders_of(allow_folders)
    mapping = with_textures(_with_mesh_files(mapping, Path(path), folders), Path(path), folders)
    return parse_description(mapping, source)


def read_text(path: Path) -> str:
    """Return the text of a scene file, or raise SceneError where TOML cannot be read from it."""
    remedy = f"check the path, or write it: jaxrt example {path.stem}" if path.stem in examples() else "check the path"
    data = read_bytes(path, (".toml",), "a scene file", remedy, SCENE_BYTES)
    if path.suffix.lower() in (".png", ".exr"):
        raise SceneError(f"{path}: is a picture, not a scene: name a scene file (.toml)")
    if path.suffix.lower() in SUFFIXES:
        key = f"[[meshes]] file = {show(path.name)}"
        raise SceneError(f"{path}: is a mesh, not a scene: name it in a scene file (.toml), by {key}")
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        raise SceneError(f"{path}: UTF-16 text, and TOML is UTF-8: save it as UTF-8")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SceneError(f"{path}: not UTF-8 text at byte {error.start}: save it as UTF-8") from None
    if "\r" in text and "\n" not in text:
        raise SceneError(f"{path}: its lines end with CR alone, which TOML does not know: save it with LF")
    if _DOTTED.search(text):
        raise SceneError(f"{path}: not valid TOML: a key of more than {DEEPEST} parts, nested too deeply: flatten it")
    return text


def _with_mesh_files(mapping: dict[str, Any], path: Path, allow_folders: Folders) -> dict[str, Any]:
    """Return the mapping with the arrays of each mesh file in the place of its name."""
    meshes = mapping.get("meshes")
    if not isinstance(meshes, list):
        return mapping
    return mapping | {"meshes": [_with_mesh_file(mesh, path, i, allow_folders) for i, mesh in enumerate(meshes)]}


def _with_mesh_file(mesh: Any, path: Path, number: int, allow_folders: Folders) -> Any:
    if isinstance(mesh, dict) and "notes" in mesh:
        raise SceneError(f'{path}: meshes[{number}]: unknown key "notes": leave it out')
    if not isinstance(mesh, dict) or "file" not in mesh:
        return mesh
    file, place = mesh["file"], f"meshes[{number}]"
    if not isinstance(file, str):
        raise SceneError(f"{path}: {place}.file: {show(file)} is not a name: write a string in quotes")
    for key in ("vertices", "faces"):
        if key in mesh:
            raise SceneError(f'{path}: {place}: {show(key)} and "file" exclude each other: leave one out')
    wanted: bool | str = "material" not in mesh
    if isinstance(mesh.get("materials"), str):
        if not wanted:
            raise SceneError(f'{path}: {place}: "material" and "materials" exclude each other: leave one out')
        wanted, mesh = mesh["materials"], {key: value for key, value in mesh.items() if key != "materials"}
    # A folder of scenes beside a folder of meshes is usual
    named = named_file(file, path, f"{place}.file", (path.parent / "..", *allow_folders))
    try:
        return read_mesh(named, wanted, allow_folders) | mesh
    except SceneError as error:
        raise SceneError(f"{path}: {place}.file: {error}") from None


def _describe_syntax(source: str, message: str) -> str:
    """Return tomllib's message with its position, if it has one, put in front as the place."""
    if "integer string conversion" in message:
        return f"{source}: not valid TOML: a whole number of thousands of digits: shorten it"
    match = re.fullmatch(r"(.*) \(at (line \d+, column \d+|end of document)\)", message, re.DOTALL)
    if match is None:
        return f"{source}: not valid TOML: {message}: correct it".replace("\n", " ")
    return f"{source}: {match[2]}: not valid TOML: {match[1]}: correct the line".replace("\n", " ")
