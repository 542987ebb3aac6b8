"""OFF files: OFF, COFF, NOFF, STOFF, 4OFF and their mixtures, with or without the word, one thing a line or one stream.

After Geomview's page of the format. trimesh reads OFF and COFF of one thing a line, and fans concave polygons.
"""

import re
from typing import NamedTuple, NoReturn

import numpy as np

from jaxrt.description import SceneError, show
from jaxrt.description.mesh_facts import Floats, Ints
from jaxrt.io.meshes.polygons import Polygons
from jaxrt.io.meshes.soundness import Mesh, Place, check_polygons, check_vertices, cut, no_faces
from jaxrt.io.meshes.text import BadRow, floats, is_count, number_hint, numbers

_HEAD = re.compile(r"(ST)?(C)?(N)?(4)?(n)?OFF(?![A-Za-z])")


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
    """An OFF file's lines, as far as they are not read yet."""

    def __init__(self, source: str):
        self.source = source
        self.rows: list[str] = []
        self.lines: list[int] = []  # their numbers
        self.notes: list[str] = []

    def read(self, text: str) -> Mesh:
        text = re.sub(r"#.*", "", text) if "#" in text else text
        for number, row in enumerate(text.split("\n"), 1):
            if row and not row.isspace():
                self.rows.append(row)
                self.lines.append(number)
        kind = self._head()
        v, n, edges = self._counts()
        if n == 0:
            raise no_faces(self.source)
        found = self._by_lines(kind, v, n)
        if found is None:
            # Where line ends mean little, the number of edges stands on the next line rather than nowhere
            self._take(0 if edges else 1)
            found = self._as_stream(kind, v, n)
        vertices, polygons, places = found
        check_polygons(self.source, polygons, v, places)
        triangles, _, crossed = cut(vertices, polygons, places)
        if kind.coloured:
            self.notes.insert(0, "vertex colours are not read")
        return Mesh(vertices, triangles, self.notes + crossed)

    def _refuse(self, trouble: str, line: int | None = None) -> NoReturn:
        raise SceneError(f"{self.source}: {'' if line is None else f'line {line}: '}{trouble}")

    def _take(self, count: int) -> list[str]:
        """Return the next words, at most `count`, and be done with them."""
        taken: list[str] = []
        done = 0
        while len(taken) < count and done < len(self.rows):
            words = self.rows[done].split()
            missing = count - len(taken)
            taken += words[:missing]
            if len(words) > missing:
                self.rows[done] = " ".join(words[missing:])
                break
            done += 1
        self.rows, self.lines = self.rows[done:], self.lines[done:]
        return taken

    def _head(self) -> _Kind:
        """Return what the first word says. Without one, the file begins with its counts."""
        words = self.rows[0].split() if self.rows else [""]
        match = _HEAD.match(words[0]) or _HEAD.match(words[0].upper())
        if match is None:
            if not (len(words) in (2, 3) and all(map(is_count, words))):
                self._refuse("the first line is not OFF: check that this is an OFF file")
            return _Kind(False, False, False, False)
        # The counts may follow at once
        self.rows[0] = self.rows[0].strip()[match.end() :]
        if not self.rows[0].strip():
            self.rows, self.lines = self.rows[1:], self.lines[1:]
        elif self.rows[0].split()[0].upper() == "BINARY":
            self._refuse("is a binary OFF file, which is not read: save it as text")
        if match[5] and (dimensions := " ".join(self._take(1))) != "3":
            self._refuse(f"{dimensions[:20]} dimensions: save the mesh with 3")
        return _Kind(*map(bool, match.groups()[:4]))

    def _counts(self) -> tuple[int, int, bool]:
        """Return the numbers of vertices and of faces, and whether that of edges, which may be missing, was there."""
        line = self.lines[0] if self.lines else 1
        on_line = len(self.rows[0].split()) if self.rows else 0
        taken = self._take(on_line if on_line in (2, 3) else 3)
        if len(taken) < 2 or not all(map(is_count, taken)):
            self._refuse(f"{show(' '.join(taken))} is not 2 finite numbers: write the counts", line)
        v, n = int(taken[0]), int(taken[1])
        # Each takes two characters at least
        if 3 * v + 4 * n > sum(map(len, self.rows)):
            self._refuse_end(v, n)
        return v, n, len(taken) == 3

    def _refuse_end(self, v: int, n: int) -> NoReturn:
        self._refuse(f"{v} vertices and {n} faces are announced, but the file ends early: save it again")

    def _by_lines(self, kind: _Kind, v: int, n: int) -> tuple[Floats, Polygons, Place] | None:
        """Return vertices, polygons and their places where each stands on a line of its own, colours behind it."""
        width = 3 + kind.homogeneous
        # A row that is longer or shorter than the others has lost a number, or is none
        widths = {len(row.split()) for row in self.rows[:v]} or {kind.width}
        if len(self.rows) < v + n or len(widths) > 1 or min(widths) < kind.width - kind.coloured:
            return None
        rows, lines = self.rows[v : v + n], self.lines[v : v + n]
        polygons = _equal_polygons(" ".join(rows), n) or self._polygons(rows, lines)
        if polygons is None:
            return None
        if max(widths) > kind.width and not kind.coloured:
            self.notes.append("vertex colours are not read")
        if len(self.rows) > v + n:
            self._refuse(f"{n} faces are announced, but more follows: correct the counts", self.lines[v + n])
        return self._vertices(self.rows[:v], self.lines[:v], width), polygons, lambda i: f"line {lines[i]}"

    def _polygons(self, rows: list[str], lines: list[int]) -> Polygons | None:
        """Return polygons of any sizes, one a line, None where a line is too short for what it begins with."""
        words = [row.split() for row in rows]
        sizes = [int(row[0]) if is_count(row[0]) else -1 for row in words]
        if any(len(row) <= size for row, size in zip(words, sizes, strict=True)):
            return None
        if min(sizes) < 0:
            i = sizes.index(-1)
            self._refuse(f"{show(rows[i].strip())} is not a face: write its size and its vertices", lines[i])
        if any(len(row) > 1 + size for row, size in zip(words, sizes, strict=True)):
            self.notes.append("face colours are not read")
        return self._ragged([row[1 : 1 + size] for row, size in zip(words, sizes, strict=True)], lines)

    def _ragged(self, polygons: list[list[str]], lines: list[int]) -> Polygons:
        flat = [word for polygon in polygons for word in polygon]
        corners = numbers(" ".join(flat), len(flat), np.int64)
        if corners is not None:
            return Polygons(corners, np.array([len(polygon) for polygon in polygons], np.int64))
        for polygon, line in zip(polygons, lines, strict=True):
            for word in polygon:
                if not re.fullmatch(r"-?\d+", word, re.ASCII):
                    self._refuse(f"{show(word)} does not name a vertex: write its number, from 0", line)
        self._refuse("a face is written in no way that is known: save it again")

    def _as_stream(self, kind: _Kind, v: int, n: int) -> tuple[Floats, Polygons, Place]:
        """Return vertices, polygons and their places of a file in which line ends mean little."""
        words = " ".join(self.rows).split()
        lines = np.repeat(self.lines, [len(row.split()) for row in self.rows])
        at = v * kind.width
        if at > len(words):
            self._refuse_end(v, n)
        rows = [" ".join(words[i : i + 3 + kind.homogeneous]) for i in range(0, at, kind.width)]
        vertices = self._vertices(rows, lines[: at : kind.width].tolist(), 3 + kind.homogeneous)
        polygons = _equal_polygons(" ".join(words[at:]), n)
        starts = (
            self._face_starts(words, lines, at, n) if polygons is None else range(at, len(words), len(words[at:]) // n)
        )
        # A file of as many lines as things begins each thing on a new one
        begins = np.array([*range(kind.width, v * kind.width, kind.width), *starts[v == 0 :]], np.int64)
        inside = begins[lines[begins] == lines[begins - 1]]
        if len(inside) and len(self.rows) >= v + n:
            self._refuse("a vertex or face begins in mid-line: write one a line", int(lines[inside[0]]))
        at_lines = lines[list(starts)].tolist()
        if polygons is None:
            polygons = self._ragged([words[i + 1 : i + 1 + int(words[i])] for i in starts], at_lines)
        return vertices, polygons, lambda i: f"line {at_lines[i]}"

    def _face_starts(self, words: list[str], lines: Ints, at: int, n: int) -> list[int]:
        """Return where each face begins among the words, the first at `at`."""
        starts: list[int] = []
        while len(starts) < n:
            size = words[at] if at < len(words) else "0"
            if at >= len(words) or (is_count(size) and at + int(size) >= len(words)):
                self._refuse(f"{n} faces are announced, but the file ends early: save it again")
            if not is_count(size):
                self._refuse(f"{show(size)} is not the size of a face: write one face a line", int(lines[at]))
            starts.append(at)
            at += 1 + int(size)
        if at < len(words):
            self._refuse(f"{n} faces are announced, but more follows: correct the counts", int(lines[at]))
        return starts

    def _vertices(self, rows: list[str], lines: list[int], width: int) -> Floats:
        try:
            vertices = floats(rows, width)
        except BadRow as error:
            row = " ".join(rows[error.row].split()[:width])
            hint = number_hint(row, "correct it")
            self._refuse(f"{show(row)} is not {width} finite numbers: {hint}", lines[error.row])
        if width == 4:
            # Homogeneous: the place is that of x/w, y/w, z/w
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                vertices = vertices[:, :3] / vertices[:, 3:]
        check_vertices(self.source, vertices, lambda i: f"line {lines[i]}: vertex {i}")
        return vertices


def _equal_polygons(words: str, count: int) -> Polygons | None:
    """Return polygons of one size, as nearly all files have them, read at once; None for others."""
    size = (words.split(None, 1) or [""])[0]
    if not is_count(size) or int(size) > len(words):
        return None
    flat = numbers(words, count * (1 + int(size)), np.int64)
    if flat is None or (flat[:: 1 + int(size)] != int(size)).any():
        return None
    return Polygons(flat.reshape(count, -1)[:, 1:].ravel(), np.full(count, int(size)))
