"""OBJ files: vertices, polygons, where these are on textures, and which material each of them uses.

Read here and not by trimesh, which fans concave polygons, takes index 0 for a vertex, counts negative indices from the
end of the file, and skips indented lines and lines with tabs, all without a word.
"""

import re
from collections.abc import Iterator, Sequence
from itertools import groupby
from operator import itemgetter
from typing import NamedTuple, NoReturn

import numpy as np

from jaxrt.description import SceneError, show
from jaxrt.description.mesh_facts import Floats, Ints
from jaxrt.io.meshes.colors import vertex_colors
from jaxrt.io.meshes.obj_uv import places, rows_of_corners
from jaxrt.io.meshes.polygons import Polygons
from jaxrt.io.meshes.soundness import Mesh, check_polygons, check_vertices, cut, cut_corners, no_faces
from jaxrt.io.meshes.text import BadRow, counts_of_words, floats, number_hint, numbers

# Of no consequence for the picture: normals, groups, names, rules for smoothing and detail
_PASSED = frozenset("vn vp o g s mg bevel c_interp d_interp lod shadow_obj trace_obj maplib usemap call csh".split())
_LINES = frozenset("l p".split())
_CURVES = frozenset(
    "surf curv curv2 cstype deg bmat step parm trim hole scrv sp end con ctech stech bzp bsp cdc cdp res".split()
)
_CONTINUED = re.compile(r"\\[ \t]*\n")


class Use(NamedTuple):
    """One `usemtl`."""

    polygon: int  # the first that it is for
    name: str  # as it stands in the file, with what may be a comment
    line: int


class Library(NamedTuple):
    """One `mtllib`."""

    names: str  # of one file or several, as they stand in the file
    line: int


class Obj(NamedTuple):
    """An OBJ file."""

    mesh: Mesh
    sources: Ints  # (n,) polygon of each face
    uses: list[Use]
    libraries: list[Library]


def read_obj(text: str, source: str) -> Obj:
    """Return what is in the text of an OBJ file. Raises SceneError with file and line."""
    return _Reader(source).read(text)


class _Reader:
    """An OBJ file's statements, sorted by kind."""

    def __init__(self, source: str):
        self.source = source
        self.places: list[str] = []  # of vertices
        self.place_lines: list[int] = []
        self.corners: list[str] = []  # of polygons
        self.corner_lines: list[int] = []
        self.before: list[int] = []  # vertices that come before each polygon
        self.spots: list[str] = []  # places on textures
        self.spots_before: list[int] = []
        self.uses: list[Use] = []
        self.libraries: list[Library] = []
        self.others: dict[str, list[int]] = {"edges and points": [], "curves and surfaces": [], "unknown words": []}

    def read(self, text: str) -> Obj:
        for lines, word, rests in _statements(text):
            if word == "v":
                self.places += rests
                self.place_lines += lines
            elif word == "vt":
                self.spots += rests
            # The old name of a face is fo
            elif word in ("f", "fo"):
                self.corners += rests
                self.corner_lines += lines
                self.before += [len(self.places)] * len(rests)
                self.spots_before += [len(self.spots)] * len(rests)
            elif word not in _PASSED:
                self._other(lines[0], word, rests[0])
        if not self.corners:
            curved = self.others["curves and surfaces"]
            raise no_faces(self.source, ", but curves and surfaces, which are not read" if curved else "")
        vertices, colors, notes = self._vertices()
        rows = _without_comments(self.corners)
        polygons = self._polygons(rows, len(vertices))
        uv, corner_uv, untold = self._uv(rows, polygons)
        if corner_uv is None:
            triangles, sources, crossed = cut(vertices, polygons, self._line)
            face_uv = None
        else:
            corners, sources, crossed = cut_corners(vertices, polygons, self._line)
            triangles, face_uv = polygons.corners[corners], corner_uv[corners]
        notes += [*untold, *crossed, *self._left_out()]
        return Obj(Mesh(vertices, triangles, notes, uv, face_uv, colors), sources, self.uses, self.libraries)

    def _uv(self, rows: list[str], polygons: Polygons) -> tuple[Floats | None, Ints | None, list[str]]:
        """Return places on textures (k, 2), the row of each corner (t,), and what is wrong with them."""
        if not self.spots:
            return None, None, []
        uv = places(_without_comments(self.spots))
        if uv is None:
            return None, None, ["places on textures (vt) are no numbers, and are not read"]
        found = rows_of_corners("\n".join(rows), polygons.sizes, np.array(self.spots_before), len(uv))
        if found is None:
            return None, None, []
        corners, notes = found
        missing = int((corners < 0).sum())
        if missing:
            notes.append(f"{missing} of {len(corners)} corners have no place on a texture, and are at its lower left")
            uv, corners = np.concatenate([uv, np.zeros((1, 2))]), np.where(corners < 0, len(uv), corners)
        return uv, corners, notes

    def _other(self, line: int, word: str, rest: str) -> None:
        if word == "usemtl":
            self.uses.append(Use(len(self.corners), rest.strip(), line))
        elif word == "mtllib":
            self.libraries.append(Library(rest.strip(), line))
        elif word in _LINES:
            self.others["edges and points"].append(line)
        elif word in _CURVES:
            self.others["curves and surfaces"].append(line)
        else:
            self.others["unknown words"].append(line)

    def _left_out(self) -> Iterator[str]:
        for kind, lines in self.others.items():
            if lines:
                yield f"{kind} ({len(lines)}, first on line {lines[0]}) are left out"

    def _line(self, polygon: int) -> str:
        return f"line {self.corner_lines[polygon]}"

    def _refuse(self, line: int, trouble: str) -> NoReturn:
        raise SceneError(f"{self.source}: line {line}: {trouble}")

    def _vertices(self) -> tuple[Floats, Floats | None, list[str]]:
        """Return the vertices, their colours, and what else stands beside them."""
        rows = _without_comments(self.places)
        try:
            vertices = floats(rows, 3)
        except BadRow as error:
            words = " ".join(rows[error.row].split())
            hint = number_hint(words, "write v x y z")
            self._refuse(self.place_lines[error.row], f"vertex {error.row + 1}: {show(words)} is not a place: {hint}")
        check_vertices(self.source, vertices, lambda i: f"line {self.place_lines[i]}: vertex {i + 1}")
        widths = counts_of_words(rows)
        colors, notes = _colors(rows) if (widths == 6).all() else (None, [])
        return vertices, colors, [*notes, *_extras(rows, widths)]

    def _polygons(self, rows: list[str], count: int) -> Polygons:
        """Return the polygons in rows of corners, which are counted from 0."""
        sizes, words = counts_of_words(rows), "\n".join(rows)
        corners = numbers(
            re.sub(r"/[\d/+-]*(?=\s|$)", "", words) if "/" in words else words, int(sizes.sum()), np.int64
        )
        if corners is None:
            self._explain(rows)
        before = np.repeat(np.array(self.before), sizes)
        polygons = Polygons(np.where(corners > 0, corners - 1, before + corners), sizes)
        for wrong, trouble in (
            (corners == 0, "vertex 0 does not exist: count from 1"),
            ((corners < 0) & (corners < -before), "vertex {} does not exist: only {} come before this line"),
        ):
            if wrong.any():
                i = int(np.argmax(wrong))
                self._refuse(self.corner_lines[polygons.owner(i)], trouble.format(corners[i], before[i]))
        beyond = polygons.corners >= count
        if beyond.any():
            known = f"use 1 to {count}" if count else "the file has no vertices"
            owner = polygons.owner(int(np.argmax(beyond)))
            highest = polygons.corners[polygons.starts[owner] :][: sizes[owner]].max() + 1
            self._refuse(self.corner_lines[owner], f"vertex {highest} does not exist: {known}")
        check_polygons(self.source, polygons, count, self._line)
        return polygons

    def _explain(self, rows: list[str]) -> NoReturn:
        """Refuse the first corner that names no vertex."""
        for line, row in zip(self.corner_lines, rows, strict=True):
            for word in row.split():
                if not re.fullmatch(r"[-+]?\d+(?:/[-+]?\d*){0,2}", word, re.ASCII):
                    self._refuse(line, f"{show(word)} does not name a vertex: write its number, such as 7, 7/1 or 7//3")
        raise SceneError(f"{self.source}: a face is written in no way that is known: save it again")


def _colors(rows: list[str]) -> tuple[Floats | None, list[str]]:
    try:
        return vertex_colors(floats(rows, 6)[:, 3:])
    except BadRow:
        return None, ["vertex colours are no numbers, and are not read"]


def _extras(rows: list[str], widths: Ints) -> Iterator[str]:
    """Tell what rows of vertices hold besides their places and colours."""
    unlike = np.flatnonzero(widths != widths[:1])
    if len(unlike):
        yield f"vertex {unlike[0] + 1} has {widths[unlike[0]]} numbers, and the first {widths[0]}: one may be lost"
    if (widths >= 6).any() and (widths != 6).any():
        yield "vertex colours are not read, since not each vertex has three numbers of them"
    weighted = [rows[i].split()[3] for i in np.flatnonzero(widths == 4)]
    if any(word not in ("1", "1.0") and not _is_one(word) for word in weighted):
        yield "weights of vertices are not read"


def _is_one(word: str) -> bool:
    try:
        return float(word) == 1
    except ValueError:
        return False


def _statements(text: str) -> Iterator[tuple[Sequence[int], str, list[str]]]:
    """Yield lines, first word and rests of statements, comments on their own lines taken off, continued ones joined.

    Vertices, their places on textures and faces that follow one another come together. Words other than names of files
    and materials may hold a comment, which is theirs to find: a name may have a #.
    """
    text = text.replace("\t", " ").replace("\v", " ").replace("\f", " ")
    numbers: Sequence[int] = range(1, text.count("\n") + 2)
    lines: Sequence[str] = text.split("\n")
    if _CONTINUED.search(text + "\n"):
        numbers, lines = zip(*_joined(text), strict=True)
    place = 0
    for head, group in groupby(lines, itemgetter(slice(2))):
        rows, first = list(group), place
        place += len(rows)
        if head in ("v ", "f "):
            yield numbers[first:place], head[0], [row[2:] for row in rows]
            continue
        if head == "vt" and all(row[2:3] == " " for row in rows):
            yield numbers[first:place], head, [row[3:] for row in rows]
            continue
        for number, row in zip(numbers[first:place], rows, strict=True):
            word, _, rest = row.strip().partition(" ")
            if not word or word[0] == "#":
                continue
            if "#" in word:
                word, rest = word.split("#", 1)[0], ""
            yield [number], word if word in ("v", "f") else word.lower(), [rest]


def _without_comments(rows: list[str]) -> list[str]:
    return [row.split("#", 1)[0] for row in rows] if "#" in "".join(rows) else rows


def _joined(text: str) -> Iterator[tuple[int, str]]:
    """Yield the lines of a text in which a backslash at the end continues a line, under the number of their first."""
    held, start = "", 0
    for number, line in enumerate(text.split("\n"), 1):
        start = start if held else number
        # A comment is not continued
        body = line.rstrip()
        if body.endswith("\\") and "#" not in body:
            held += body[:-1] + " "
            continue
        yield start, held + line
        held = ""
    if held:
        yield start, held
