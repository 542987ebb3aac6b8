"""Pictures as textures: PNG and JPG by the sRGB curve, EXR as it is."""

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from jaxrt.core.messages import SceneError, SceneWarning, nearest, show
from jaxrt.description.textures import PICTURES, name_of_picture
from jaxrt.io import color
from jaxrt.io.decode import Curve, Pixels, decode_exr, decode_jpg, decode_png, decoding
from jaxrt.io.files import PICTURE_BYTES, StrPath, read_bytes
from jaxrt.io.folders import Folders, named_file

_CURVES: dict[str, Curve] = {"srgb": color.srgb_decode, "linear": lambda levels: levels}


def load_texture(path: StrPath, encoding: str | None = None) -> dict[str, Any]:
    """Return the picture in a .png, .jpg or .exr file as a table of `textures`: `file`, `texels` (h, w, 3) float32.

    encoding: "srgb" or "linear", what a PNG's or JPG's levels are; default "srgb". An EXR is linear. Numbers of an EXR
    beyond [0, 1] become the nearest of it, which is warned of (SceneWarning). Raises SceneError: file, culprit, remedy.
    """
    table = read_texture(path, encoding)
    if "notes" in table:
        warnings.warn(f"{path}: {table.pop('notes')}", SceneWarning, stacklevel=2)
    return table


def read_texture(path: StrPath, encoding: str | None = None) -> dict[str, Any]:
    """Return the table of `load_texture`, what it would warn of under the key `notes`, in one line."""
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in PICTURES:
        hint = nearest(suffix, PICTURES) if suffix else f" (known: {', '.join(PICTURES)})"
        raise SceneError(f"{path}: unknown kind of picture {show(suffix)}{hint}: convert it")
    if encoding not in (*_CURVES, None):
        raise SceneError(f"{path}: encoding: {show(encoding)} is unknown{nearest(str(encoding), _CURVES)}")
    data = read_bytes(path, PICTURES, "a picture", limit=PICTURE_BYTES)
    return {"file": str(path), **_bounded(path, texels_in(path, suffix, data, encoding))}


def texels_in(path: Path, suffix: str, data: bytes, encoding: str | None = None) -> Pixels:
    """Return the texels (h, w, 3) of a picture that is `data`, of the kind that `suffix` tells, in the file `path`."""
    curve = _CURVES[encoding or "srgb"]
    with decoding(path, suffix, SceneError):
        if suffix == ".exr":
            return decode_exr(path, data)
        return (decode_png if suffix == ".png" else decode_jpg)(path, data, curve)


def _bounded(path: Path, texels: Pixels) -> dict[str, Any]:
    """Return texels in [0, 1], and a note where some were not."""
    if not np.isfinite(texels).all():
        i, j, _ = (int(n) for n in np.argwhere(~np.isfinite(texels))[0])
        raise SceneError(f"{path}: pixel in row {i}, column {j} is not finite: mend the picture")
    beyond = int(np.any((texels < 0) | (texels > 1), axis=-1).sum())
    if not beyond:
        return {"texels": texels}
    return {"texels": np.clip(texels, 0, 1), "notes": f"{beyond} texels are outside [0, 1], and taken as the nearest"}


def with_textures(mapping: dict[str, Any], path: Path, allow_folders: Folders) -> dict[str, Any]:
    """Return a scene file's mapping with the texels of each picture that textures, or fields of materials, name."""
    textures, materials = mapping.get("textures", {}), mapping.get("materials", {})
    if not isinstance(textures, dict) or not isinstance(materials, dict):
        return mapping
    read = {name: _with_texels(table, name, path, allow_folders) for name, table in textures.items()}
    painted = {
        name: {key: _named(value, f"materials.{name}.{key}", read, path, allow_folders) for key, value in table.items()}
        if isinstance(table, dict)
        else table
        for name, table in materials.items()
    }
    return mapping | ({"textures": read} if read else {}) | ({"materials": painted} if painted else {})


def _with_texels(table: Any, name: str, path: Path, allow_folders: Folders) -> Any:
    if not isinstance(table, dict) or "file" not in table or table.get("type", "image") != "image":
        return table
    if "notes" in table:
        raise SceneError(f'{path}: textures.{name}: unknown key "notes": leave it out')
    if "texels" in table:
        raise SceneError(f'{path}: textures.{name}: "texels" and "file" exclude each other: leave one out')
    found = _read(table["file"], table.get("encoding"), f"textures.{name}.file", path, allow_folders)
    return found | {key: value for key, value in table.items() if key != "file"}


def _named(value: Any, place: str, textures: dict[str, Any], path: Path, allow_folders: Folders) -> Any:
    """Return a field's value, the name of a picture in it replaced by that of its texture, which is added."""
    file = value.get("texture") if isinstance(value, Mapping) else value
    if not isinstance(file, str) or file in textures or Path(file).suffix.lower() not in PICTURES:
        return value
    name = name_of_picture(file)
    found = _read(file, None, place, path, allow_folders)
    if textures.setdefault(name, found).get("file") != found["file"]:
        raise SceneError(
            f'{path}: {place}: {show(file)} would be texture "{name}", which is another: write [textures.NAME] with '
            f"file = {show(file)}, and its NAME here"
        )
    return {**value, "texture": name} if isinstance(value, Mapping) else name


def _read(file: Any, encoding: str | None, place: str, path: Path, allow_folders: Folders) -> dict[str, Any]:
    if not isinstance(file, str):
        raise SceneError(f"{path}: {place}: {show(file)} is not a name: write a string in quotes")
    # A folder of scenes beside a folder of pictures is usual
    named = named_file(file, path, place, (path.parent / "..", *allow_folders))
    try:
        return read_texture(named, encoding)
    except SceneError as error:
        raise SceneError(f"{path}: {place}: {error}") from None
