"""The fitted scene: the user's file, comments and all, with new values in it."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jaxrt.core.writing import write_text
from jaxrt.description import MeshDescription, SceneDescription, SceneError
from jaxrt.description.textures import (
    PICTURES,
    CheckerTexture,
    VertexColors,
    as_written,
    painted_fields,
    texture_of,
)
from jaxrt.io.image import save_image
from jaxrt.io.scene_file import read_text
from jaxrt.scene.measures import TEXTURES
from jaxrt.scene.poses import POSES
from jaxrt.scene.selectors import Selector, place_in_file

Floats = NDArray[np.floating]

MOST_FACES = 2000  # of a mesh file that is written into the scene, since a vertex of it has moved


def write_scene(
    source: Path, path: Path, values: Mapping[str, Floats], selectors: Mapping[str, Selector], scene: SceneDescription
) -> None:
    """Write the scene file `source` to `path` with new values, everything else as the user wrote it.

    A material or mesh of a mesh file, of which a value is new, is written into the scene, where it takes precedence.
    Raises SceneError for meshes too large for that.
    """
    import tomlkit

    document = tomlkit.parse(read_text(source))
    for text, value in values.items():
        if selectors[text].name.startswith(TEXTURES):
            _put_texels(document, text, value, scene, path)
        else:
            _put(document, selectors[text], text, value, scene)
    left = _left_behind(document, scene)
    for name in left:
        if isinstance(scene.textures[name], VertexColors):
            document.setdefault("textures", {})[name] = {"type": "vertex_colors"}
        else:
            _put_texels(document, TEXTURES + name, scene.textures[name].texels, scene, path)
    names = [text.removeprefix(TEXTURES) for text in values if text.startswith(TEXTURES)]
    _move_pictures(document, source, path, {_picture(path, name).name for name in (*names, *left)})
    for mesh in document.get("meshes", []):
        # Names of files stay right in another folder
        if "file" in mesh:
            mesh["file"] = Path(os.path.relpath(source.parent / str(mesh["file"]), path.parent)).as_posix()
    text = tomlkit.dumps(document)
    write_text(path, text)


def _put(document: Any, selector: Selector, text: str, value: Floats, scene: SceneDescription) -> None:
    """Put a value in its place in the document."""
    owner, field = selector.name.split(".")
    if selector.name == "meshes.vertices":
        total = sum(len(mesh.vertices) for mesh in scene.meshes) + 3 * len(scene.triangles)
        rows = np.atleast_1d(np.arange(total)[selector.row])
        _put_vertices(document, rows, np.reshape(value, (-1, 3)), text, scene)
    elif owner == "camera" and "cameras" in document:
        for table in document["cameras"]:
            table[field] = _plain(value)
    elif owner in ("camera", "environment"):
        document[owner][field] = _plain(value)
    else:
        place = place_in_file(scene, selector)
        if owner == "materials" and place not in document.setdefault("materials", {}):
            # A mesh file has brought it along
            material = scene.materials[str(place)]
            own = {name: as_written(getattr(material, name)) for name in type(material).model_fields}
            document["materials"][place] = {name: each for name, each in own.items() if each is not None}
        key = "rotate_vector" if selector.name in POSES and field == "rotate" else field
        new = _plain(_in_group(value, selector, scene))
        texture = texture_of(getattr(scene.materials[str(place)], field)) if owner == "materials" else None
        document[owner][place][key] = new if texture is None else _painted(document, texture, new, scene)


def _painted(document: Any, texture: str, factor: Any, scene: SceneDescription) -> Any:
    """Return a field that a texture is multiplied by, which has that name in the document or comes with a mesh."""
    if _by_file(document, texture, scene):
        _add_texture(document, texture, scene)
    return {"texture": texture, "factor": factor}


def _by_file(document: Any, texture: str, scene: SceneDescription) -> list[tuple[Any, str]]:
    """Return the tables and fields that name a texture by its file."""
    return [
        (fields, field)
        for material, fields in document.get("materials", {}).items()
        for field, own in painted_fields(scene.materials[material])
        if own == texture and _picture_in(fields.get(field))
    ]


def _picture_in(value: Any) -> str | None:
    """Return the file that a field names as its texture, None where it names none."""
    file = value.get("texture") if isinstance(value, Mapping) else value
    return file if isinstance(file, str) and Path(file).suffix.lower() in PICTURES else None


def _with_texture(value: Any, texture: str) -> Any:
    """Return a field that names another texture."""
    return {**value, "texture": texture} if isinstance(value, Mapping) else texture


def _add_texture(document: Any, name: str, scene: SceneDescription) -> Any:
    """Return the table of a texture that so far was the name of a file, or came along with a mesh."""
    named, texture = _by_file(document, name, scene), scene.textures[name]
    table = texture.model_dump(mode="json", include={"file", "wrap", "scale"}, exclude_defaults=True)
    document.setdefault("textures", {})[name] = table
    for fields, field in named:
        fields[field] = _with_texture(fields[field], name)
    return document["textures"][name]


def _put_texels(document: Any, text: str, value: Floats, scene: SceneDescription, path: Path) -> None:
    """Write the texels of a picture beside the scene, and its name, or a checker's colours, into the document."""
    name = text.removeprefix(TEXTURES)
    if isinstance(scene.textures[name], VertexColors):
        raise SceneError(f"{text}: colours at vertices are not written: take jaxrt.fit in Python")
    known = document.get("textures", {})
    table = known[name] if name in known else _add_texture(document, name, scene)
    if isinstance(scene.textures[name], CheckerTexture):
        table["colors"] = [_plain(color) for color in value]
        return
    for key in ("texels", "encoding"):
        table.pop(key, None)
    file = _picture(path, name)
    save_image(file, value)
    table["file"] = file.name


def _picture(path: Path, name: str) -> Path:
    """Return the file in which the texels of a texture are written."""
    return path.with_name(f"{path.stem}.{name}.exr")


def _left_behind(document: Any, scene: SceneDescription) -> list[str]:
    """Return the textures that came along with mesh files of which only arrays are left in the document."""
    pairs = zip(scene.meshes, document.get("meshes", []), strict=True)
    names = [name for mesh, table in pairs if mesh.file and "file" not in table for name in mesh.textures or {}]
    return [name for name in dict.fromkeys(names) if name not in document.get("textures", {})]


def _move_pictures(document: Any, source: Path, path: Path, written: set[str]) -> None:
    """Let names of pictures be right in another folder; those that are written are already."""

    def moved(file: str) -> str:
        return Path(os.path.relpath(source.parent / file, path.parent)).as_posix()

    for table in document.get("textures", {}).values():
        if "file" in table and table["file"] not in written:
            table["file"] = moved(str(table["file"]))
    for fields in document.get("materials", {}).values():
        for field, value in list(fields.items()):
            if file := _picture_in(value):
                fields[field] = _with_texture(value, moved(file))


def _in_group(value: Floats, selector: Selector, scene: SceneDescription) -> Floats:
    """Return a value of a sphere, which is where its group places it, as it is before that."""
    name = scene.spheres[selector.row or 0].group if selector.name.startswith("spheres.") else None
    if name is None:
        return value
    group = scene.groups[name]
    return group.unplaced(value[None])[0] if selector.name.endswith(".center") else value / group.scale


def _plain(value: Floats) -> Any:
    """Return plain numbers, of the digits that float32 has."""
    numbers = [float(str(v)) for v in np.asarray(value, np.float32).ravel()]
    return numbers if np.ndim(value) else numbers[0]


def _put_vertices(document: Any, rows: NDArray[np.intp], places: Floats, text: str, scene: SceneDescription) -> None:
    """Put places (n, 3), in the scene's coordinates, where the rows of `meshes.vertices` come from."""
    first = 0
    for i, (mesh, flat) in enumerate(zip(scene.meshes, scene.flat.meshes, strict=True)):
        own = (first <= rows) & (rows < first + len(mesh.vertices))
        if own.any():
            table = document["meshes"][i]
            if "file" in table:
                _write_out(table, mesh, text)
            for row, place in zip(rows[own] - first, flat.unplaced(places[own]), strict=True):
                table["vertices"][int(row)] = _plain(place)
        first += len(mesh.vertices)
    for row, place in zip(rows, places, strict=True):
        if row >= first:
            triangle, corner = divmod(int(row) - first, 3)
            document["triangles"][triangle]["vertices"][corner] = _plain(place)


def _write_out(table: Any, mesh: MeshDescription, text: str) -> None:
    """Put the arrays of a mesh file in the place of its name."""
    if len(mesh.faces) > MOST_FACES:
        raise SceneError(
            f"{text}: {mesh.file} has {len(mesh.faces)} faces, too many to write them into the fitted scene: take "
            f"jaxrt.fit in Python, or a mesh of at most {MOST_FACES}"
        )
    del table["file"]
    for key in ("vertices", "faces", "uv", "face_uv", "colors"):
        if (rows := getattr(mesh, key)) is not None:
            table[key] = rows.tolist()
    if mesh.material is None and mesh.face_materials is not None:
        table["materials"], table["face_materials"] = mesh.materials, mesh.face_materials.tolist()
