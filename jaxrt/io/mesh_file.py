"""Mesh files: OBJ, PLY, STL, GLB and OFF to vertices and faces, read by trimesh and checked here."""

import io
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxrt.description import SceneError, nearest, show
from jaxrt.io.files import StrPath, read_bytes
from jaxrt.io.folders import Folders
from jaxrt.io.mtl import materials_of
from jaxrt.io.obj import PlainObj, explain_obj, face_line, plain_obj
from jaxrt.io.off import plain_off
from jaxrt.io.polygons import CrossedPolygon, triangulate
from jaxrt.mesh_facts import Floats, Ints, weld

SUFFIXES = (".obj", ".ply", ".stl", ".glb", ".off")
FLOAT32_MAX = float(np.finfo(np.float32).max)


class _Soup(NamedTuple):
    vertices: Floats  # (v, 3)
    faces: Ints  # (n, 3)


def load_mesh(path: StrPath, materials: bool = True, allow_folders: Folders = ()) -> dict[str, Any]:
    """Return the mesh in a file as a table of `[[meshes]]`: `file`, `vertices` (v, 3) float64, `faces` (n, 3) int64.

    Vertices keep the order of the file; those of an STL file that share a place become one. An OBJ file that uses the
    materials of an MTL file also gives `materials`, each named `file:name`, and `face_materials` (n,).
    materials: False leaves the MTL file alone, which must lie beside or below the OBJ file or one of `allow_folders`.
    Raises SceneError: file, line where there is one, culprit, remedy.
    """
    path = Path(path)
    source, kind = str(path), path.suffix.lower()
    if kind not in SUFFIXES:
        hint = nearest(kind, SUFFIXES) if kind else f" (known: {', '.join(SUFFIXES)})"
        raise SceneError(f"{source}: unknown kind of mesh file {show(kind)}{hint}: convert it")
    data = read_bytes(path, SUFFIXES, "a mesh file")
    obj = None
    if kind == ".obj":
        text = _decode(data)
        obj = plain_obj(text, source)
        soup = _obj_soup(obj, text, source)
    elif kind == ".off":
        soup = _read(plain_off(_decode(data), source).encode(), kind, source)
    else:
        soup = _read(data, kind, source)
    _check(soup, source, _decode(data) if obj else None, obj)
    table = {"file": source, "vertices": soup.vertices, "faces": soup.faces}
    if obj and materials and obj.uses and obj.libraries:
        table |= materials_of(obj, path, len(soup.faces), allow_folders)
    return table


def _decode(data: bytes) -> str:
    return data.decode("utf-8", errors="replace")


def _obj_soup(obj: PlainObj, text: str, source: str) -> _Soup:
    try:
        return _read(obj.text.encode(), ".obj", source)
    except SceneError:
        explain_obj(text, source)
        raise


def _read(data: bytes, kind: str, source: str) -> _Soup:
    """Return what trimesh reads, all parts of a file as one."""
    import trimesh

    try:
        # No texture: it would part the vertices where pictures meet
        options: dict[str, Any] = {"fix_texture": False} if kind == ".ply" else {}
        loaded = trimesh.load(
            io.BytesIO(data), file_type=kind[1:], process=False, maintain_order=True, skip_materials=True, **options
        )
        parts: list[Any] = loaded.dump() if isinstance(loaded, trimesh.Scene) else [loaded]
        parts = [part for part in parts if len(getattr(part, "faces", ()))]
    except Exception as error:
        # Whatever a parser trips over in a broken file; some of them want a package just to say so
        reason = "broken, or of another kind" if isinstance(error, ImportError) else str(error) or type(error).__name__
        raise SceneError(f"{source}: cannot be read ({' '.join(reason.split())}): save it again") from None
    if not parts:
        raise SceneError(f"{source}: no faces: save the mesh with its faces")
    soups = [_polygons_of(part, source) if kind == ".ply" else _Soup(part.vertices, part.faces) for part in parts]
    first = np.cumsum([0] + [len(soup.vertices) for soup in soups])
    vertices = np.concatenate([np.asarray(soup.vertices, np.float64) for soup in soups])
    faces = np.concatenate([np.asarray(s.faces, np.int64) + start for s, start in zip(soups, first, strict=False)])
    return _merged(vertices, faces) if kind == ".stl" else _Soup(vertices, faces)


def _merged(vertices: Floats, faces: Ints) -> _Soup:
    """Return the mesh with vertices at the same place made one: an STL file repeats them for every face."""
    together = weld(vertices)
    kept = together == np.arange(len(vertices))
    return _Soup(vertices[kept], (np.cumsum(kept) - 1)[together[faces]])


def _polygons_of(part: Any, source: str) -> _Soup:
    """Return a part of a PLY file, its polygons cut anew where there are any: trimesh fans concave ones."""
    data = part.metadata.get("_ply_raw", {}).get("face", {}).get("data")
    lists = None
    names = (data.dtype.names if isinstance(data, np.ndarray) else data) or ()
    for name in ("vertex_index", "vertex_indices"):
        if name in names:
            lists = data[name]["f1"] if isinstance(data, np.ndarray) else data[name]
    if lists is None and isinstance(data, np.ndarray) and data.ndim == 2:
        lists = data
    if lists is None or all(len(polygon) == 3 for polygon in lists):
        return _Soup(part.vertices, part.faces)
    polygons = [[int(i) for i in polygon] for polygon in lists]
    for face, polygon in enumerate(polygons):
        if len(polygon) < 3:
            raise SceneError(f"{source}: face {face}: has {len(polygon)} vertices: name 3 or more")
        if not (min(polygon) >= 0 and max(polygon) < len(part.vertices)):
            raise SceneError(f"{source}: face {face}: {_no_vertex(polygon, len(part.vertices))}")
    try:
        return _Soup(part.vertices, triangulate(np.asarray(part.vertices, np.float64), polygons)[0])
    except CrossedPolygon as error:
        raise SceneError(
            f"{source}: face {error.number}: the polygon crosses itself: split it into triangles"
        ) from None


def _no_vertex(face: Any, count: int) -> str:
    wrong = next(i for i in face if not 0 <= i < count)
    return f"vertex {wrong} does not exist: use 0 to {count - 1}"


def _check(soup: _Soup, source: str, text: str | None, obj: PlainObj | None) -> None:
    """Raise SceneError for indices out of range and for vertices that are not finite or too large."""
    count = len(soup.vertices)
    wrong = np.flatnonzero(np.any((soup.faces < 0) | (soup.faces >= count), axis=-1))
    if len(wrong):
        face = int(wrong[0])
        if text is not None:
            explain_obj(text, source)
        place = f"line {face_line(text, face)}" if text is not None else f"face {face}"
        raise SceneError(f"{source}: {place}: {_no_vertex(soup.faces[face].tolist(), count)}")
    wrong = np.flatnonzero(np.any(~(np.abs(soup.vertices) <= FLOAT32_MAX), axis=-1))
    if len(wrong):
        vertex = int(wrong[0])
        place = f"line {_vertex_line(text, vertex)}: vertex {vertex + 1}" if text is not None else f"vertex {vertex}"
        trouble = "is too large for float32: stay within ±3.4e38"
        if not np.isfinite(soup.vertices[vertex]).all():
            trouble = "is not finite: repair the mesh"
        raise SceneError(f"{source}: {place}: {show(soup.vertices[vertex].tolist())} {trouble}")


def _vertex_line(text: str, vertex: int) -> int:
    """Return the line of an OBJ file's vertex."""
    lines = (i for i, line in enumerate(text.splitlines(), 1) if line.split()[:1] == ["v"])
    return next(line for n, line in enumerate(lines) if n == vertex)
