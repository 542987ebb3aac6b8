"""The arrays of a glTF file: buffers, views, accessors, checked against what is there."""

import base64
import binascii
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from jaxrt.description import SceneError, show
from jaxrt.description.mesh_facts import Floats, Ints
from jaxrt.description.textures import PICTURES
from jaxrt.io.files import read_bytes
from jaxrt.io.folders import Folders, named_file

_KINDS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_LARGEST = 2**24  # rows of an accessor without bytes of its own

Table = dict[str, Any]


class Broken(ValueError):
    """A file that is not as glTF asks: what is wrong, without the file's name."""


def rows(table: Table, name: str) -> list[Table]:
    """Return the objects of a list, [] where there is none. Raises Broken."""
    found = table.get(name, [])
    if not isinstance(found, list) or not all(isinstance(row, dict) for row in found):
        raise Broken(f"{name}: is no list of objects: save it again")
    return found


def item(document: Table, name: str, number: Any) -> Table:
    """Return an object by its number in a list of the document. Raises Broken."""
    found = document.get(name, [])
    if not isinstance(found, list) or not _is_whole(number) or number >= len(found):
        raise Broken(f"{name}[{show(number)}] does not exist: save it again")
    if not isinstance(found[number], dict):
        raise Broken(f"{name}[{number}]: is no object: save it again")
    row: Table = found[number]
    return row


def whole(table: Table, name: str, place: str, otherwise: int | None = None) -> int:
    """Return a whole number of an object, `otherwise` where there is none. Raises Broken."""
    value: Any = table.get(name, otherwise)
    if not _is_whole(value):
        raise Broken(f"{place}.{name}: {show(value)} is not a whole number: save it again")
    return int(value)


def extensions_of(table: Table) -> list[str]:
    """Return the names of an object's extensions."""
    found = table.get("extensions")
    return list(found) if isinstance(found, dict) else []


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 2**62


class Accessors:
    """The arrays of one document."""

    def __init__(self, document: Table, binary: bytes | None, path: Path, allow_folders: Folders):
        self.document, self.binary, self.path, self.allow_folders = document, binary, path, allow_folders
        self.buffers: dict[int, bytes] = {}

    def has_data(self, number: Any) -> bool:
        """Return whether an accessor has bytes of its own."""
        accessor = item(self.document, "accessors", number)
        return "bufferView" in accessor or "sparse" in accessor

    def positions(self, number: Any) -> Floats:
        """Return vertices (v, 3)."""
        if not self.has_data(number):
            raise Broken(f"accessors[{number}]: has no data: save it without compression")
        return self._array(number, "VEC3").astype(np.float64)

    def shares(self, number: Any, *kinds: str) -> Floats:
        """Return rows (v, n) of numbers, those that are whole as what they stand for. kinds: such as "VEC2"."""
        accessor = item(self.document, "accessors", number)
        kind = accessor.get("type")
        if accessor.get("componentType") not in (5121, 5123, 5126):
            raise Broken(f"accessors[{number}]: must be floats, or normalized unsigned numbers: save it again")
        array = self._array(number, kind if kind in kinds else kinds[0]).astype(np.float64)
        if not np.isfinite(array).all():
            raise Broken(f"accessors[{number}]: has numbers that are not finite: save it again")
        return array

    def indices(self, number: Any) -> Ints:
        """Return corners (t,)."""
        accessor = item(self.document, "accessors", number)
        if accessor.get("componentType") not in (5121, 5123, 5125):
            raise Broken(f"accessors[{number}]: indices must be unsigned whole numbers: save it again")
        return self._array(number, "SCALAR")[:, 0].astype(np.int64)

    def image(self, number: Any) -> bytes:
        """Return the bytes of an image: those of a buffer view, of the JSON, or of another file."""
        image, place = item(self.document, "images", number), f"images[{number}]"
        if "bufferView" not in image:
            uri = image.get("uri")
            if not isinstance(uri, str):
                raise Broken(f"{place}.uri: {show(uri)} is not a name: save it again")
            return self._read(uri, place, PICTURES)
        view, name = item(self.document, "bufferViews", image["bufferView"]), f"bufferViews[{image['bufferView']}]"
        data = self._buffer(view.get("buffer"), [])
        offset, length = whole(view, "byteOffset", name, 0), whole(view, "byteLength", name)
        if offset + length > len(data):
            raise Broken(f"{place}: does not fit into its buffer: save it again")
        return data[offset : offset + length]

    def _array(self, number: int, kind: str) -> NDArray[Any]:
        """Return the rows of an accessor, normalized ones as what they stand for, sparse ones filled in."""
        accessor, place = item(self.document, "accessors", number), f"accessors[{number}]"
        component = accessor.get("componentType")
        if accessor.get("type") != kind or not isinstance(component, int) or component not in _KINDS:
            told = f"{show(accessor.get('type'))} of {show(component)}"
            raise Broken(f"{place}: {told} where {kind} is expected: save it again")
        count, dtype, width = whole(accessor, "count", place), np.dtype(_KINDS[component]), _WIDTHS[kind]
        if "bufferView" in accessor:
            start = whole(accessor, "byteOffset", place, 0)
            array = self._view(accessor["bufferView"], start, count, width, dtype, place)
        elif count <= _LARGEST:
            array = np.zeros((count, width), dtype)
        else:
            raise Broken(f"{place}.count: {count} rows of zeros: save it again")
        if "sparse" in accessor:
            array = self._filled(array, accessor["sparse"], width, dtype, f"{place}.sparse")
        if accessor.get("normalized") is True and dtype.kind != "f":
            return np.maximum(array / np.float64(np.iinfo(dtype).max), -1)
        return array

    def _filled(self, array: NDArray[Any], sparse: Any, width: int, dtype: np.dtype[Any], place: str) -> NDArray[Any]:
        """Return an array with the rows that differ put in."""
        if not (isinstance(sparse, dict) and all(isinstance(sparse.get(k), dict) for k in ("indices", "values"))):
            raise Broken(f"{place}: lacks indices or values: save it again")
        indices, values = sparse["indices"], sparse["values"]
        count = whole(sparse, "count", place)
        kind = indices.get("componentType")
        if kind not in (5121, 5123, 5125):
            raise Broken(f"{place}.indices: must be unsigned whole numbers: save it again")
        at = self._view(
            indices.get("bufferView"), whole(indices, "byteOffset", place, 0), count, 1, np.dtype(_KINDS[kind]), place
        )[:, 0]
        new = self._view(values.get("bufferView"), whole(values, "byteOffset", place, 0), count, width, dtype, place)
        if (at >= len(array)).any():
            raise Broken(f"{place}: row {at.max()} does not exist: save it again")
        filled = array.copy()
        filled[at] = new
        return filled

    def _view(self, number: Any, start: int, count: int, width: int, dtype: np.dtype[Any], place: str) -> NDArray[Any]:
        """Return rows (count, width) that begin `start` bytes into a buffer view."""
        view = item(self.document, "bufferViews", number)
        name = f"bufferViews[{number}]"
        packed = [n for n in extensions_of(view) if "meshopt" in n]
        data = self._buffer(view.get("buffer"), packed)
        offset, length = whole(view, "byteOffset", name, 0), whole(view, "byteLength", name)
        size = width * dtype.itemsize
        stride = whole(view, "byteStride", name, size)
        if not count:
            return np.zeros((0, width), dtype)
        end = start + stride * (count - 1) + size
        if stride < size or end > length or offset + length > len(data):
            raise Broken(f"{place}: {count} rows do not fit into {name}: save it again")
        return np.ndarray((count, width), dtype, data, offset + start, (stride, dtype.itemsize))

    def _buffer(self, number: Any, packed: list[str]) -> bytes:
        """Return the bytes of a buffer: those of the file, of its JSON, or of another file."""
        buffer, place = item(self.document, "buffers", number), f"buffers[{number}]"
        if number in self.buffers:
            return self.buffers[number]
        uri = buffer.get("uri")
        if uri is None:
            if number != 0 or self.binary is None:
                needs = f"needs the extension {show(packed[0])}, which is not read" if packed else "has no data"
                raise Broken(f"{place}: {needs}: save it without compression")
            data = self.binary
        elif isinstance(uri, str):
            data = self._read(uri, place)
        else:
            raise Broken(f"{place}.uri: {show(uri)} is not a name: save it again")
        if whole(buffer, "byteLength", place) > len(data):
            raise Broken(f"{place}: {len(data)} bytes are there, fewer than announced: save it again")
        self.buffers[number] = data
        return data

    def _read(self, uri: str, place: str, kinds: Sequence[str] = (".bin",)) -> bytes:
        if not uri.startswith("data:"):
            if "://" in uri:
                raise Broken(f"{place}.uri: {show(uri)} is not opened: save the mesh with its data inside")
            file = named_file(unquote(uri), self.path, f"{place}.uri", self.allow_folders)
            try:
                return read_bytes(file, kinds, remedy="save the mesh with its data inside")
            except SceneError as error:
                raise Broken(f"{place}.uri: {error}") from None
        try:
            return base64.b64decode(uri.partition(",")[2], validate=True)
        except (binascii.Error, ValueError):
            raise Broken(f"{place}.uri: holds no base64: save it again") from None
