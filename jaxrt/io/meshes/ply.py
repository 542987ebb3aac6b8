"""PLY files, text and binary: polygons and strips of triangles under any of their names.

trimesh passes over strips and carriage returns, takes the rows that are there for those announced, and reads text in
the precision of its type, which is less than it holds.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray

from jaxrt.description import SceneError, show
from jaxrt.description.mesh_facts import Floats, Ints
from jaxrt.io.meshes.colors import vertex_colors
from jaxrt.io.meshes.ply_head import Element, Head, Property, read_head
from jaxrt.io.meshes.polygons import Polygons
from jaxrt.io.meshes.soundness import Mesh, check_polygons, check_vertices, cut_corners, left_over, no_faces
from jaxrt.io.meshes.strips import strip_triangles
from jaxrt.io.meshes.text import BadRow, decode, floats, number_hint, numbers

_LISTS = ("vertex_indices", "vertex_index")
_COLOURS = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"))
_FACE_COLOURS = ("red", "diffuse_red", "r", "green", "blue")
_PLACES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))

Numbers = NDArray[np.float64]


class Lists(NamedTuple):
    """One list a row, their values in one row."""

    values: Numbers
    sizes: Ints


Columns = dict[str, Numbers | Lists]  # by property


def read_ply(data: bytes, source: str) -> Mesh:
    """Return the mesh in a PLY file. Raises SceneError with file and line, face or vertex."""
    head = read_head(data, source)
    body: _Text | _Binary = _Binary(data, head, source) if head.order else _Text(data, head, source)
    columns = {element.name: body.columns(element) for element in head.elements}
    notes = list(_notes(head))
    rest = body.rest()
    if rest:
        notes.append(rest)
    vertices = _vertices(columns.get("vertex", {}), source)
    faces, corner_uv, crossed = _faces(head, columns, vertices, source)
    uv, untold = _uv(columns.get("vertex", {})) if corner_uv is None else (corner_uv, [])
    face_uv = None if corner_uv is None else np.arange(faces.size).reshape(-1, 3)
    colors, pale = _colors(head, columns.get("vertex", {}))
    return Mesh(vertices, faces, [*notes, *crossed, *untold, *pale], uv, face_uv, colors)


def _notes(head: Head) -> Iterator[str]:
    if any(e.name == "face" and e.number and e.find(*_FACE_COLOURS) for e in head.elements):
        yield "face colours are not read"
    if head.textures:
        yield "textures are not read: name them in the scene file"


def _uv(columns: Columns) -> tuple[Numbers | None, list[str]]:
    """Return places on textures (v, 2), and what is wrong with them."""
    for names in _PLACES:
        parts = [columns.get(name) for name in names]
        if all(isinstance(part, np.ndarray) for part in parts):
            uv = np.stack([np.asarray(part, np.float64) for part in parts], -1)
            if np.isfinite(uv).all():
                return uv, []
            return None, ["places on textures are not finite, and are not read"]
    return None, []


def _colors(head: Head, columns: Columns) -> tuple[Numbers | None, list[str]]:
    """Return linear colours (v, 3) of vertices, and what is wrong with them."""
    for names in _COLOURS:
        parts = [columns.get(name) for name in names]
        if all(isinstance(part, np.ndarray) for part in parts):
            (vertex,) = (element for element in head.elements if element.name == "vertex")
            kind = next(p.kind for p in vertex.properties if p.name == names[0])
            largest = None if kind.startswith("f") else float(np.iinfo(kind).max)
            return vertex_colors(np.stack([np.asarray(part, np.float64) for part in parts], -1), largest)
    return None, []


def _vertices(columns: Columns, source: str) -> Floats:
    parts = [columns.get(axis) for axis in "xyz"]
    if not columns:
        return np.zeros((0, 3))
    for axis, part in zip("xyz", parts, strict=True):
        if not isinstance(part, np.ndarray):
            raise SceneError(f"{source}: vertices have no {axis}: save them with x, y and z")
    vertices = np.stack([np.asarray(part, np.float64) for part in parts], -1)
    check_vertices(source, vertices, lambda i: f"vertex {i}")
    return vertices


def _faces(
    head: Head, columns: dict[str, Columns], vertices: Floats, source: str
) -> tuple[Ints, Floats | None, list[str]]:
    """Return the triangles of faces, then those of strips; places on textures (3n, 2) of their corners, if faces tell.

    Third, what was done to crossed polygons, and what is not read.
    """
    found, uv = [np.zeros((0, 3), np.int64)], None
    notes: list[str] = []
    for element in head.elements:
        if element.name == "face" and element.number:
            polygons = _whole(columns["face"][_corners_of(element, source).name], source)
            check_polygons(source, polygons, len(vertices), _face)
            corners, _, notes = cut_corners(vertices, polygons, _face)
            found.append(polygons.corners[corners])
            places, untold = _corner_places(columns["face"].get("texcoord"), polygons)
            uv = None if places is None else places[corners.ravel()]
            notes += untold
        elif element.name == "tristrips" and element.number:
            strips = _whole(columns["tristrips"][_corners_of(element, source).name], source)
            triangles = strip_triangles(strips)
            check_polygons(source, Polygons(triangles.ravel(), np.full(len(triangles), 3)), len(vertices), _strip_face)
            found.append(triangles)
    faces = np.concatenate(found)
    if not len(faces):
        raise no_faces(source)
    if uv is not None and 3 * len(faces) != len(uv):
        uv, notes = None, [*notes, "places on textures of faces are not read, since strips have none"]
    return faces, uv, notes


def _corner_places(lists: Numbers | Lists | None, polygons: Polygons) -> tuple[Floats | None, list[str]]:
    """Return the places on textures (t, 2) of polygons' corners, and what is wrong with them."""
    if not isinstance(lists, Lists):
        return None, []
    if (lists.sizes != 2 * polygons.sizes).any() or not np.isfinite(lists.values).all():
        return None, ["places on textures of faces (texcoord) are not two numbers a corner, and are not read"]
    return lists.values.reshape(-1, 2), []


def _face(i: int) -> str:
    return f"face {i}"


def _strip_face(i: int) -> str:
    return f"face {i} of the strips"


def _corners_of(element: Element, source: str) -> Property:
    """Return the list that holds the vertices of a face, whatever its name."""
    lists = [p for p in element.properties if p.size_kind and not p.kind.startswith("f")]
    named = [p for p in lists if p.name in _LISTS] or [p for p in lists if "vert" in p.name] or lists
    if len(named) != 1:
        names = ", ".join(p.name for p in element.properties[:8]) or "nothing"
        raise SceneError(f"{source}: {element.name} has no list of vertices ({names}): name it vertex_indices")
    return named[0]


def _whole(lists: Numbers | Lists, source: str) -> Polygons:
    """Return lists of vertices as whole numbers."""
    assert isinstance(lists, Lists)
    whole = np.rint(lists.values) == lists.values
    polygons = Polygons(np.where(whole, np.clip(lists.values, -(2.0**62), 2.0**62), 0).astype(np.int64), lists.sizes)
    wrong = np.flatnonzero(~whole)
    if len(wrong):
        value = lists.values[wrong[0]]
        raise SceneError(
            f"{source}: face {polygons.owner(int(wrong[0]))}: {value} does not name a vertex: save it again"
        )
    return polygons


class _Text:
    """The rows of a text file, one a line."""

    def __init__(self, data: bytes, head: Head, source: str):
        self.source = source
        lines = decode(data[head.size :]).split("\n")
        self.rows = [row for row in lines if row and not row.isspace()]
        self.lines = [head.lines + i for i, row in enumerate(lines, 1) if row and not row.isspace()]
        self.at = 0

    def columns(self, element: Element) -> Columns:
        """Return the columns of an element, whose rows come next."""
        rows = self.rows[self.at : self.at + element.number]
        if len(rows) < element.number:
            self._refuse_count(element, len(rows))
        first, self.at = self.at, self.at + element.number
        text = "\n".join(rows)
        starts = np.cumsum([0] + [len(row.split()) for row in rows])
        values = numbers(text, int(starts[-1]), np.float64)
        if values is None:
            values = self._values(text.split(), starts, first)
        found, ends = _take_columns(
            element, starts[:-1], starts[1:], lambda at, _: values[np.minimum(at, len(values) - 1)], _one
        )
        wrong = np.flatnonzero(ends != starts[1:])
        if len(wrong) and element.properties:
            self._refuse(first + int(wrong[0]), f"not as many numbers as the head says of {element.name}: correct it")
        return found

    def _values(self, words: list[str], starts: Ints, first: int) -> Numbers:
        """Return the numbers of words that are not as plain as most, or refuse the first that is none."""
        try:
            return floats(words, 1)[:, 0]
        except BadRow as error:
            row = int(np.searchsorted(starts, error.row, side="right")) - 1
            hint = number_hint(words[error.row], "save it again")
            self._refuse(first + row, f"{show(words[error.row])} is not a number: {hint}")

    def rest(self) -> str:
        """Refuse rows that the head does not announce."""
        if self.at < len(self.rows):
            self._refuse(self.at, "more rows than the head announces: correct its counts")
        return ""

    def _refuse(self, row: int, trouble: str) -> NoReturn:
        raise SceneError(f"{self.source}: line {self.lines[row]}: {trouble}")

    def _refuse_count(self, element: Element, present: int) -> NoReturn:
        raise SceneError(
            f"{self.source}: {element.number} rows of {element.name} are announced, but {present} follow: save it again"
        )


def _one(kind: str) -> int:
    return 1


class _Binary:
    """The rows of a binary file, one after the other."""

    def __init__(self, data: bytes, head: Head, source: str):
        self.source, self.order = source, head.order
        self.bytes = np.frombuffer(data, np.uint8)
        self.data = data
        self.at = head.size

    def columns(self, element: Element) -> Columns:
        """Return the columns of an element, whose rows come next."""
        if not element.properties or not element.number:
            return {p.name: np.zeros(0) for p in element.properties}
        starts = self._starts(element)
        found, ends = _take_columns(element, starts, np.full(len(starts), len(self.data)), self._take, _bytes)
        self.at = int(ends[-1])
        return found

    def rest(self) -> str:
        """Tell of bytes that the head does not announce."""
        left = len(self.data) - self.at
        return left_over(left, "row") if left else ""

    def _take(self, at: Ints, kind: str) -> Numbers:
        """Return the numbers that begin at places of the file, which all lie in it."""
        size = _bytes(kind)
        cells = np.ascontiguousarray(self.bytes[at[:, None] + np.arange(size)])
        return cells.view(f"{self.order}{kind}")[:, 0].astype(np.float64)

    def _starts(self, element: Element) -> Ints:
        """Return where each row begins; all lie whole in the file."""
        fixed = sum(_bytes(p.kind) for p in element.properties if p.size_kind is None)
        if all(p.size_kind is None for p in element.properties):
            if self.at + element.number * fixed > len(self.data):
                self._refuse_end(element)
            return self.at + np.arange(element.number) * fixed
        return self._equal_rows(element) if self._are_equal(element) else self._walk(element)

    def _row_length(self, element: Element, at: int) -> int:
        """Return the bytes of the row that begins at a place, which must lie in the file."""
        start = at
        for p in element.properties:
            if p.size_kind is None:
                at += _bytes(p.kind)
                continue
            size = _bytes(p.size_kind)
            signed = p.size_kind.startswith("i")
            count = int.from_bytes(self.data[at : at + size], "big" if self.order == ">" else "little", signed=signed)
            at += size + max(count, 0) * _bytes(p.kind)
            if count < 0 or at > len(self.data):
                self._refuse_end(element)
        if at > len(self.data):
            self._refuse_end(element)
        return at - start

    def _are_equal(self, element: Element) -> bool:
        """Return whether all lists are as long as those of the first row, as in a mesh of triangles alone."""
        length = self._row_length(element, self.at)
        if self.at + element.number * length > len(self.data):
            return False
        starts = self.at + np.arange(element.number) * length
        at = starts
        for p in element.properties:
            if p.size_kind is not None:
                sizes = self._take(at, p.size_kind)
                if (sizes != sizes[0]).any():
                    return False
                at = at + _bytes(p.size_kind) + int(sizes[0]) * _bytes(p.kind)
            else:
                at = at + _bytes(p.kind)
        return True

    def _equal_rows(self, element: Element) -> Ints:
        return self.at + np.arange(element.number) * self._row_length(element, self.at)

    def _walk(self, element: Element) -> Ints:
        at, starts = self.at, []
        for _ in range(element.number):
            starts.append(at)
            at += self._row_length(element, at)
        return np.array(starts, np.int64)

    def _refuse_end(self, element: Element) -> NoReturn:
        raise SceneError(
            f"{self.source}: {element.number} rows of {element.name} are announced, but the file ends in them: "
            "save it again"
        )


def _bytes(kind: str) -> int:
    return int(kind[1])


def _take_columns(
    element: Element, at: Ints, limits: Ints, take: Callable[[Ints, str], Numbers], size_of: Callable[[str], int]
) -> tuple[Columns, Ints]:
    """Return the columns of rows that begin at places (n,), and where the rows end: beyond `limits` if they are wrong.

    take: gives the numbers of a type at places; size_of: what a number of a type takes there.
    """
    found: Columns = {}
    for p in element.properties:
        step = size_of(p.kind)
        if p.size_kind is None:
            found[p.name] = take(at, p.kind)
            at = at + step
            continue
        told = take(at, p.size_kind)
        at = at + size_of(p.size_kind)
        right = (told >= 0) & (told * step <= limits - at) & (told == np.rint(told))
        sizes = np.where(right, told, 0).astype(np.int64)
        within = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        places = np.repeat(at, sizes) + within * step
        found[p.name] = Lists(take(places, p.kind) if len(places) else np.zeros(0), sizes)
        at = np.where(right, at + sizes * step, limits + 1)
    return found, at
