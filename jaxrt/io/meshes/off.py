"""OFF files: OFF, COFF, NOFF, STOFF, 4OFF and their mixtures, with or without the word, one thing a line or one stream.

After Geomview's page of the format. trimesh reads OFF and COFF of one thing a line, and fans concave polygons.
"""

import re
from typing import NamedTuple, NoReturn

import numpy as np

from jaxrt.description import SceneError, show
from jaxrt.io.meshes.polygons import Polygons
from jaxrt.io.meshes.soundness import Mesh, Place, check_polygons, check_vertices, cut, no_faces
from jaxrt.io.meshes.text import BadRow, floats, integers, is_count, number_hint
from jaxrt.mesh_facts import Floats

_HEAD = re.compile(r"(ST)?(C)?(N)?(4)?(n)?OFF(?![A-Za-z])")
_NO_OFF = "the first line is not OFF: check that this is an OFF file"


class _Row(NamedTuple):
    line: int
    words: list[str]


class _Kind(NamedTuple):
    """What the first word says of each vertex."""

    textured: bool
    coloured: bool
    normals: bool
    homogeneous: bool

    @property
    def width(self) -> int:
        """Numbers of a vertex, colours of four."""
        return 3 + self.homogeneous + 3 * self.normals + 4 * self.coloured + 2 * self.textured


def read_off(text: str, source: str) -> Mesh:
    """Return the mesh in the text of an OFF file. Raises SceneError with file and line."""
    return _Reader(source).read(text)


class _Reader:
    def __init__(self, source: str):
        self.source = source
        self.notes: list[str] = []

    def read(self, text: str) -> Mesh:
        rows = [_Row(i, line.split("#", 1)[0].split()) for i, line in enumerate(text.split("\n"), 1)]
        rows = [row for row in rows if row.words]
        kind, rows = self._head(rows)
        v, n, rows = self._counts(rows)
        if n == 0:
            raise no_faces(self.source)
        by_lines = self._by_lines(rows, kind, v, n)
        vertices, polygons, places = by_lines or self._as_stream(rows, kind, v, n)
        check_polygons(self.source, polygons, v, places)
        triangles, _, crossed = cut(vertices, polygons, places)
        if kind.coloured:
            self.notes.insert(0, "vertex colours are not read")
        return Mesh(vertices, triangles, self.notes + crossed)

    def _refuse(self, trouble: str, line: int | None = None) -> NoReturn:
        raise SceneError(f"{self.source}: {'' if line is None else f'line {line}: '}{trouble}")

    def _head(self, rows: list[_Row]) -> tuple[_Kind, list[_Row]]:
        """Return what the first word says, and the rows after it. Without one, the file begins with its counts."""
        if not rows:
            self._refuse(_NO_OFF)
        line, words = rows[0]
        match = _HEAD.match(words[0]) or _HEAD.match(words[0].upper())
        if match is None:
            if not (len(words) in (2, 3) and all(map(is_count, words))):
                self._refuse(_NO_OFF)
            return _Kind(False, False, False, False), rows
        rest = [words[0][match.end() :], *words[1:]]
        rest = [word for word in rest if word]
        if rest and rest[0].upper() == "BINARY":
            self._refuse("is a binary OFF file, which is not read: save it as text")
        kind = _Kind(*map(bool, match.groups()[:4]))
        rows = ([_Row(line, rest)] if rest else []) + rows[1:]
        if match[5]:
            rows = self._skip_dimension(rows)
        return kind, rows

    def _skip_dimension(self, rows: list[_Row]) -> list[_Row]:
        """Return the rows after the number of dimensions of an nOFF file, which must be 3."""
        line, words = rows[0] if rows else _Row(1, [""])
        if words[0] != "3":
            self._refuse(f"{show(words[0])} dimensions: save the mesh with 3", line)
        return ([_Row(line, words[1:])] if words[1:] else []) + rows[1:]

    def _counts(self, rows: list[_Row]) -> tuple[int, int, list[_Row]]:
        """Return the numbers of vertices and of faces, and the rows after them. The number of edges may be missing."""
        if not rows:
            self._refuse("no counts of vertices and faces: save it again")
        taken = rows[0].words if len(rows[0].words) in (2, 3) else [w for row in rows[:3] for w in row.words][:3]
        if len(taken) < 2 or not all(map(is_count, taken)):
            self._refuse(f"{show(' '.join(taken))} is not 2 finite numbers: write the counts", rows[0].line)
        v, n = int(taken[0]), int(taken[1])
        # Three numbers that are not on a line of their own
        left = len(taken)
        while left:
            words = rows[0].words
            rows = rows[1:] if len(words) <= left else [_Row(rows[0].line, words[left:]), *rows[1:]]
            left -= min(left, len(words))
        if 3 * v + 4 * n > sum(len(row.words) for row in rows):
            self._refuse(f"{v} vertices and {n} faces are announced, but the file ends early: save it again")
        return v, n, rows

    def _by_lines(self, rows: list[_Row], kind: _Kind, v: int, n: int) -> tuple[Floats, Polygons, Place] | None:
        """Return vertices, polygons and their places where each stands on a line of its own, colours behind it."""
        vertex_rows, face_rows = rows[:v], rows[v : v + n]
        width = 3 + kind.homogeneous
        if len(face_rows) < n or any(len(row.words) < width for row in vertex_rows):
            return None
        sizes = [int(row.words[0]) if is_count(row.words[0]) else -1 for row in face_rows]
        if any(len(row.words) <= size for row, size in zip(face_rows, sizes, strict=True)):
            return None
        if len(rows) > v + n:
            self._refuse(f"{n} faces are announced, but more follows: correct the counts", rows[v + n].line)
        lines = [row.line for row in face_rows]
        for line, size, row in zip(lines, sizes, face_rows, strict=True):
            if size < 0:
                self._refuse(f"{show(' '.join(row.words))} is not a face: write its size and its vertices", line)
        vertices = self._vertices([row.words[:width] for row in vertex_rows], [row.line for row in vertex_rows])
        flat = [w for row, size in zip(face_rows, sizes, strict=True) for w in row.words[1 : 1 + size]]
        corners = integers(" ".join(flat), len(flat))
        if corners is None:
            self._refuse_corner(face_rows, sizes)
        if any(len(row.words) > 1 + size for row, size in zip(face_rows, sizes, strict=True)):
            self.notes.append("face colours are not read")
        return vertices, Polygons(corners, np.array(sizes, np.int64)), lambda i: f"line {lines[i]}"

    def _refuse_corner(self, rows: list[_Row], sizes: list[int]) -> NoReturn:
        for row, size in zip(rows, sizes, strict=True):
            for word in row.words[1 : 1 + size]:
                if not re.fullmatch(r"-?\d+", word, re.ASCII):
                    self._refuse(f"{show(word)} does not name a vertex: write its number, from 0", row.line)
        self._refuse("a face is written in no way that is known: save it again")

    def _as_stream(self, rows: list[_Row], kind: _Kind, v: int, n: int) -> tuple[Floats, Polygons, Place]:
        """Return vertices, polygons and their places of a file in which line ends mean nothing."""
        words = [word for row in rows for word in row.words]
        lines = np.repeat([row.line for row in rows], [len(row.words) for row in rows])
        end = v * kind.width
        if end > len(words):
            self._refuse(f"{v} vertices are announced, but the file ends in them: save it again")
        vertices = self._vertices(
            [words[i : i + 3 + kind.homogeneous] for i in range(0, end, kind.width)], lines[: end : kind.width].tolist()
        )
        starts, at = [], end
        for i in range(n):
            size = words[at] if at < len(words) else ""
            if not size or (is_count(size) and at + int(size) >= len(words)):
                self._refuse(f"{n} faces are announced, but the file ends in face {i}: save it again")
            if not is_count(size):
                self._refuse(f"{show(size)} is not the size of a face: write one face a line", int(lines[at]))
            starts.append(at)
            at += 1 + int(size)
        # A file that has lines for its faces begins each on a new one
        inside = [i for i in starts[1:] if lines[i] == lines[i - 1]]
        if inside and rows[-1].line - lines[end] >= n:
            self._refuse("a face begins in mid-line: write one face a line", int(lines[inside[0]]))
        if at < len(words):
            self._refuse(f"{n} faces are announced, but more follows: correct the counts", int(lines[at]))
        sizes = np.array([int(words[i]) for i in starts], np.int64)
        flat = [w for i, size in zip(starts, sizes.tolist(), strict=True) for w in words[i + 1 : i + 1 + size]]
        corners = integers(" ".join(flat), len(flat))
        if corners is None:
            parts = [_Row(int(lines[i]), words[i:]) for i in starts]
            self._refuse_corner(parts, sizes.tolist())
        return vertices, Polygons(corners, sizes), lambda i: f"line {lines[starts[i]]}"

    def _vertices(self, words: list[list[str]], lines: list[int]) -> Floats:
        width = len(words[0]) if words else 3
        rows = [" ".join(row) for row in words]
        try:
            vertices = floats(rows, width)
        except BadRow as error:
            row = rows[error.row]
            hint = number_hint(row, "correct it")
            self._refuse(f"{show(row)} is not {width} finite numbers: {hint}", lines[error.row])
        if width == 4:
            # Homogeneous: the place is that of x/w, y/w, z/w
            with np.errstate(divide="ignore", invalid="ignore"):
                vertices = vertices[:, :3] / vertices[:, 3:]
        check_vertices(self.source, vertices, lambda i: f"line {lines[i]}: vertex {i}")
        return vertices
