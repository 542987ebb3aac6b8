"""Mesh files to vertices and faces: one dialect a file, the door here."""

import warnings
from os import PathLike
from pathlib import Path
from typing import Any

from jaxrt.description import SceneError, SceneWarning, nearest, show
from jaxrt.io.files import read_bytes
from jaxrt.io.folders import Folders
from jaxrt.io.meshes.glb import read_glb
from jaxrt.io.meshes.mtl import materials_of
from jaxrt.io.meshes.obj import read_obj
from jaxrt.io.meshes.off import read_off
from jaxrt.io.meshes.ply import read_ply
from jaxrt.io.meshes.soundness import Mesh
from jaxrt.io.meshes.stl import read_stl
from jaxrt.io.meshes.text import decode

TYPES = ("diffuse", "principled")  # of the materials that a file brings along
SUFFIXES = (".obj", ".ply", ".stl", ".glb", ".off")
PACKED = {b"\x1f\x8b": "gzip", b"PK\x03\x04": "zip", b"BZh": "bzip2", b"\xfd7zXZ": "xz", b"\x28\xb5\x2f\xfd": "zstd"}


def load_mesh(path: str | PathLike[str], materials: bool | str = True, allow_folders: Folders = ()) -> dict[str, Any]:
    """Return the mesh in a file as a table of `[[meshes]]`: `file`, `vertices` (v, 3) float64, `faces` (n, 3) int64.

    And `uv` (k, 2), `face_uv` (n, 3) and `colors` (v, 3), linear, where the file has places on textures and colours.
    Vertices keep the order of the file; those of an STL file that share a place become one. An OBJ file that uses the
    materials of an MTL file, and a GLB file with materials, also give `materials`, each named `file:name`,
    `face_materials` (n,), and `textures` where these have some. materials: False leaves them alone; "principled" has
    those of a GLB file with metal and roughness, which are diffuse otherwise. allow_folders: folders besides the file's
    own, and those below it, from which what the file names may be read. Warns once (SceneWarning) of all that the file
    holds and the mesh does not.
    Raises SceneError: file, line where there is one, culprit, remedy.
    """
    mesh = read_mesh(path, materials, allow_folders)
    notes = mesh.pop("notes", None)
    if notes:
        warnings.warn(f"{path}: {notes}", SceneWarning, stacklevel=2)
    return mesh


def read_mesh(path: str | PathLike[str], materials: bool | str, allow_folders: Folders) -> dict[str, Any]:
    """Return the table of `load_mesh`, what it would warn of under the key `notes`, in one line."""
    path = Path(path)
    source, kind = str(path), path.suffix.lower()
    if kind not in SUFFIXES:
        if kind in (".gz", ".zip", ".bz2", ".xz", ".zst"):
            raise SceneError(f"{source}: is packed: unpack it first")
        hint = nearest(kind, SUFFIXES) if kind else f" (known: {', '.join(SUFFIXES)})"
        raise SceneError(f"{source}: unknown kind of mesh file {show(kind)}{hint}: convert it")
    if isinstance(materials, str):
        if materials not in TYPES:
            raise SceneError(f"{source}: materials: {show(materials)} is unknown{nearest(materials, TYPES)}")
        if materials != "diffuse" and kind != ".glb":
            raise SceneError(f"{source}: materials: only those of GLB files can be {show(materials)}: leave it out")
    data = read_bytes(path, SUFFIXES, "a mesh file")
    for magic, name in PACKED.items():
        if data.startswith(magic):
            raise SceneError(f"{source}: is packed by {name}: unpack it first")
    try:
        mesh, more = _read(data, kind, path, materials, allow_folders)
    except MemoryError:
        raise SceneError(f"{source}: does not fit into memory: make it smaller") from None
    notes = mesh.notes + more.pop("notes", [])
    table = {"file": source, **mesh.table} | more
    return table | ({"notes": "; ".join(notes)} if notes else {})


def _read(data: bytes, kind: str, path: Path, materials: bool | str, folders: Folders) -> tuple[Mesh, dict[str, Any]]:
    """Return the mesh, and the materials of an OBJ file where they are wanted."""
    source = str(path)
    match kind:
        case ".obj":
            obj = read_obj(decode(data), source)
            return obj.mesh, materials_of(obj, path, folders) if materials else {}
        case ".off":
            return read_off(decode(data), source), {}
        case ".ply":
            return read_ply(data, source), {}
        case ".stl":
            return read_stl(data, source), {}
        case _:
            return read_glb(data, path, folders, materials)
