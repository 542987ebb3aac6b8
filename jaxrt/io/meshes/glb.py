"""GLB files (glTF 2.0): the triangles of the scene, placed by its nodes.

Read here and not by trimesh, which takes normalized and sparse accessors and required extensions for plain ones: the
mesh is then another, without a word.
"""

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jaxrt.description import SceneError, show
from jaxrt.description.mesh_facts import Floats, Ints
from jaxrt.io.folders import Folders
from jaxrt.io.meshes.accessors import Accessors, Broken, extensions_of, item, rows
from jaxrt.io.meshes.glb_materials import glb_materials
from jaxrt.io.meshes.nodes import drawn_nodes
from jaxrt.io.meshes.polygons import Polygons
from jaxrt.io.meshes.soundness import Mesh, check_vertices, no_faces
from jaxrt.io.meshes.strips import fan_triangles, strip_triangles

_JSON, _BIN = 0x4E4F534A, 0x004E4942
# Extensions that change no triangle: how a surface looks, lights, names
_LOOKS = (
    "KHR_materials_",
    "KHR_texture_",
    "EXT_texture_",
    "MSFT_texture_",
    "KHR_lights_",
    "EXT_lights_",
    "KHR_xmp",
    "KHR_animation_",
)
_READ = frozenset(["KHR_mesh_quantization"])
_INSTANCES = "EXT_mesh_gpu_instancing"
_PACKED = frozenset(["KHR_draco_mesh_compression"])
_TRIANGLES = frozenset([4, 5, 6])
Look = Floats | int  # rows of vertices, or how many have none


def read_glb(data: bytes, path: Path, allow_folders: Folders, materials: bool | str) -> tuple[Mesh, dict[str, Any]]:
    """Return the mesh in a GLB file, and its materials where they are wanted, of what type.

    Raises SceneError with the place in its JSON.
    """
    source = str(path)
    try:
        document, binary = _chunks(data)
        reader = _Reader(document, Accessors(document, binary, path, allow_folders), source)
        mesh = reader.read()
        if not materials:
            return mesh, {}
        has = mesh.uv is not None, mesh.colors is not None
        table, notes = glb_materials(reader.accessors, path, reader.materials, *has, materials == "principled")
        return mesh, table | {"notes": notes}
    except Broken as error:
        raise SceneError(f"{source}: {error}") from None
    except RecursionError:
        raise SceneError(f"{source}: cannot be read (nested too deeply): save it again") from None


def _chunks(data: bytes) -> tuple[dict[str, Any], bytes | None]:
    """Return the JSON of a GLB file and the bytes behind it."""
    if data[:4] != b"glTF" or len(data) < 20:
        raise Broken("cannot be read (not a GLB file): save it again")
    version, length = (int.from_bytes(data[i : i + 4], "little") for i in (4, 8))
    if version != 2:
        raise Broken(f"is glTF of version {version}: save it as glTF 2.0")
    if length > len(data):
        raise Broken(f"{length} bytes are announced, but the file has {len(data)}: save it again")
    chunks: list[tuple[int, bytes]] = []
    start = 12
    while start + 8 <= length:
        size, kind = (int.from_bytes(data[i : i + 4], "little") for i in (start, start + 4))
        if start + 8 + size > length:
            raise Broken("cannot be read (a chunk ends beyond the file): save it again")
        chunks.append((kind, data[start + 8 : start + 8 + size]))
        start += 8 + size
    if not chunks or chunks[0][0] != _JSON:
        raise Broken("cannot be read (the first chunk is no JSON): save it again")
    try:
        document = json.loads(chunks[0][1].decode("utf-8-sig"))
    except ValueError as error:
        raise Broken(f"cannot be read (its JSON: {error}): save it again") from None
    if not isinstance(document, dict):
        raise Broken("cannot be read (its JSON is no object): save it again")
    binary = chunks[1][1] if len(chunks) > 1 and chunks[1][0] == _BIN else None
    return document, binary


class _Reader:
    def __init__(self, document: dict[str, Any], accessors: Accessors, source: str):
        self.document, self.accessors, self.source = document, accessors, source
        self.said: dict[str, None] = {}  # notes, each once
        self.materials: list[tuple[Any, int]] = []  # number of each part's, and how many faces it has

    def read(self) -> Mesh:
        self._check_extensions()
        parts, looks, first = [], [], 0
        for node, matrix in drawn_nodes(self.document, self._say):
            number = node.get("mesh")
            if number is None:
                continue
            mesh = item(self.document, "meshes", number)
            self._tell(node, mesh)
            for i, primitive in enumerate(rows(mesh, "primitives")):
                part = self._primitive(primitive, f"meshes[{number}].primitives[{i}]")
                if part is not None:
                    looks.append(self._looks(primitive, len(part[0]), f"meshes[{number}].primitives[{i}]"))
                    parts.append(_placed(*part, matrix, first))
                    self.materials.append((primitive.get("material"), len(part[1])))
                    first += len(part[0])
        if not sum(len(faces) for _, faces in parts):
            raise no_faces(self.source)
        vertices, faces = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
        check_vertices(self.source, vertices, lambda i: f"vertex {i}")
        uv, colors = (_joined(column) for column in zip(*looks, strict=True))
        if uv is not None:
            uv = np.stack([uv[:, 0], 1 - uv[:, 1]], -1)  # glTF counts from the top
        return Mesh(vertices, faces, list(self.said), uv, colors=colors)

    def _say(self, note: str) -> None:
        self.said[note] = None

    def _check_extensions(self) -> None:
        required = self.document.get("extensionsRequired", [])
        for name in map(str, required if isinstance(required, list) else [required]):
            if name not in _READ and not name.startswith(_LOOKS):
                raise Broken(f"needs the extension {show(name)}, which is not read: save it without")

    def _tell(self, node: dict[str, Any], mesh: dict[str, Any]) -> None:
        """Note what moves a mesh besides its node."""
        weights = node.get("weights", mesh.get("weights", []))
        if isinstance(weights, list) and any(weights):
            self._say("morph targets are left out")
        if "skin" in node:
            self._say("skins are left out: the mesh is drawn as modelled, unposed")
        if _INSTANCES in extensions_of(node):
            self._say(f"{_INSTANCES} is not read: one instance is drawn of many")

    def _primitive(self, primitive: dict[str, Any], place: str) -> tuple[Floats, Ints] | None:
        """Return vertices and faces of a primitive, None for points and lines."""
        mode = primitive.get("mode", 4)
        if not isinstance(mode, int) or mode not in range(7):
            raise Broken(f"{place}.mode: {show(mode)} is none of 0 to 6: save it again")
        if mode not in _TRIANGLES:
            self._say("points and lines are left out")
            return None
        attributes = primitive.get("attributes")
        if not isinstance(attributes, dict) or "POSITION" not in attributes:
            raise Broken(f"{place}: has no POSITION: save it again")
        packed = _PACKED.intersection(extensions_of(primitive))
        if packed and not self.accessors.has_data(attributes["POSITION"]):
            raise Broken(f"{place}: needs the extension {show(min(packed))}, which is not read: save it without")
        vertices = self.accessors.positions(attributes["POSITION"])
        if "indices" in primitive:
            corners = self.accessors.indices(primitive["indices"])
        else:
            corners = np.arange(len(vertices))
        faces = self._triangles(corners, mode)
        wrong = np.flatnonzero((faces >= len(vertices)).any(axis=-1))
        if len(wrong):
            beyond = faces[wrong[0]].max()
            raise Broken(f"{place}: face {wrong[0]}: vertex {beyond} does not exist: use 0 to {len(vertices) - 1}")
        return vertices, faces

    def _looks(self, primitive: dict[str, Any], count: int, place: str) -> tuple[Look, Look]:
        """Return places on textures (v, 2) and linear colours (v, 3); of a primitive without, how many there are."""
        attributes = primitive["attributes"]
        found: list[Look] = [count, count]
        for i, (name, kinds) in enumerate((("TEXCOORD_0", ("VEC2",)), ("COLOR_0", ("VEC3", "VEC4")))):
            if name in attributes:
                found[i] = values = self.accessors.shares(attributes[name], *kinds)[:, :3]
                if len(values) != count:
                    raise Broken(f"{place}: {name} has {len(values)} rows for {count} vertices: save it again")
        if isinstance(found[1], np.ndarray):
            found[1] = np.clip(found[1], 0, 1)
        more = sorted(name for name in attributes if re.fullmatch(r"(TEXCOORD|COLOR)_[1-9]\d*", name))
        if more:
            self._say(f"{', '.join(more)[:60]} are not read")
        return found[0], found[1]

    def _triangles(self, corners: Ints, mode: int) -> Ints:
        if mode == 5:
            return strip_triangles(Polygons(corners, np.array([len(corners)])))
        if mode == 6:
            return fan_triangles(corners)
        if len(corners) % 3:
            self._say(f"{len(corners) % 3} corners after the last whole triangle are left out")
        return corners[: len(corners) // 3 * 3].reshape(-1, 3)


def _joined(column: Sequence[Look]) -> Floats | None:
    """Return the rows of all primitives, ones for those that have none; None where none has any."""
    widths = [values.shape[1] for values in column if isinstance(values, np.ndarray)]
    if not widths:
        return None
    return np.concatenate([x if isinstance(x, np.ndarray) else np.ones((x, widths[0])) for x in column])


def _placed(vertices: Floats, faces: Ints, matrix: Floats, first: int) -> tuple[Floats, Ints]:
    """Return vertices in the scene's axes and faces counted from `first`; a mirroring node turns them round."""
    with np.errstate(over="ignore", invalid="ignore"):
        placed = vertices @ matrix[:3, :3].T + matrix[:3, 3]
        mirrored = np.linalg.det(matrix[:3, :3]) < 0
    return placed, (faces[:, ::-1] if mirrored else faces) + first
