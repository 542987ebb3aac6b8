"""OBJ text made plain before trimesh reads it: one triangle a line, absolute indices, no comments.

trimesh 5.2 fans concave polygons, takes index 0 for a vertex, counts negative indices from the end of the file, and
skips indented lines and lines with tabs, all without a word. So a file with any line beyond the plainest is read here
line by line; the plainest, of which most large files consist, goes to it as it is.
"""

import math
import re
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from jaxrt.description import SceneError, show
from jaxrt.io.polygons import CrossedPolygon, triangulate
from jaxrt.mesh_facts import Ints

_NUMBER = r"-?\d+\.?\d*(?:[eE][-+]?\d+)?"
_INDEX = r"[1-9]\d*(?:/\d*){0,2}"
_OTHER = r"(?:vn|vt|o|g|s|usemtl|mtllib) .*|#[^\\\n]*"
# A line that trimesh might misread
_ODD = re.compile(rf"^(?!v(?: +{_NUMBER}){{3}} *$|f(?: +{_INDEX}){{3}} *$|(?:{_OTHER})$|$)", re.MULTILINE)


class PlainObj(NamedTuple):
    """What trimesh is given, and what it is not asked for."""

    text: str  # lines `v x y z` and `f a b c` alone
    lines: Ints | None  # (n,) line of the file of each face, None where faces stand one a line
    uses: list[tuple[int, str, int]]  # first face, material's name and line, of each `usemtl`
    libraries: list[str]  # files named by `mtllib`


def plain_obj(text: str, source: str) -> PlainObj:
    """Return the OBJ file `text` in its plainest form. Raises SceneError with file and line."""
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    if _ODD.search(text) or "\\\n" in text:
        return _Reader(source).read(text)
    uses, faces, start = [], 0, 0
    for match in re.finditer(r"^usemtl (.*)$", text, re.MULTILINE):
        faces += _count_faces(text, start, match.start())
        start = match.start()
        uses.append((faces, match[1].strip(), text.count("\n", 0, start) + 1))
    libraries = [name.strip() for name in re.findall(r"^mtllib (.*)$", text, re.MULTILINE)]
    bare = re.sub(r"^(?![vf] ).*\n?", "", text, flags=re.MULTILINE)
    return PlainObj(re.sub(r"/\S*", "", bare), None, uses, libraries)


def explain_obj(text: str, source: str) -> None:
    """Read the text line by line for the SceneError that says what is wrong with it, if anything is."""
    _Reader(source).read(text)


def face_line(text: str, face: int) -> int:
    """Return the line of the `face`-th line that begins with f."""
    lines = (i for i, line in enumerate(text.splitlines(), 1) if line.startswith("f "))
    return next(line for n, line in enumerate(lines) if n == face)


def _count_faces(text: str, start: int, end: int) -> int:
    return text.count("\nf ", start, end) + text.startswith("f ", start, end)


class _Reader:
    """An OBJ file read line by line."""

    def __init__(self, source: str):
        self.source = source
        self.vertices: list[list[float]] = []
        self.polygons: list[list[int]] = []
        self.lines: list[int] = []  # of each polygon
        self.uses: list[tuple[int, str, int]] = []
        self.libraries: list[str] = []

    def read(self, text: str) -> PlainObj:
        for line, words in _logical_lines(text):
            if words[0] == "v":
                self.vertices.append(self._vertex(line, words[1:]))
            elif words[0] == "f":
                self.polygons.append([self._index(line, word) for word in self._corners(line, words[1:])])
                self.lines.append(line)
            elif words[0] == "usemtl":
                self.uses.append((len(self.polygons), " ".join(words[1:]), line))
            elif words[0] == "mtllib":
                self.libraries.append(" ".join(words[1:]))
        return self._plain()

    def _plain(self) -> PlainObj:
        if not self.polygons:
            return PlainObj("", None, [], [])
        for line, polygon in zip(self.lines, self.polygons, strict=True):
            if max(polygon) >= len(self.vertices):
                count = len(self.vertices)
                known = f"use 1 to {count}" if count else "the file has no vertices"
                self._refuse(line, f"vertex {max(polygon) + 1} does not exist: {known}")
        try:
            faces, polygons = triangulate(np.array(self.vertices), self.polygons)
        except CrossedPolygon as error:
            self._refuse(self.lines[error.number], "the polygon crosses itself: split it into triangles")
        text = "".join([f"v {x!r} {y!r} {z!r}\n" for x, y, z in self.vertices])
        text += "".join([f"f {a} {b} {c}\n" for a, b, c in (faces + 1).tolist()])
        uses = [(int(np.searchsorted(polygons, first)), name, line) for first, name, line in self.uses]
        return PlainObj(text, np.array(self.lines)[polygons], uses, self.libraries)

    def _refuse(self, line: int, trouble: str) -> None:
        raise SceneError(f"{self.source}: line {line}: {trouble}")

    def _vertex(self, line: int, words: list[str]) -> list[float]:
        try:
            place = [float(word) for word in words[:3]]
        except ValueError:
            place = []
        if len(place) < 3 or "_" in "".join(words[:3]):
            hint = "write decimals with a point" if "," in "".join(words) else "write v x y z"
            self._refuse(line, f"vertex {len(self.vertices) + 1}: {show(' '.join(words))} is not a place: {hint}")
        if not all(map(math.isfinite, place)):
            self._refuse(line, f"vertex {len(self.vertices) + 1}: {show(place)} is not finite: repair the mesh")
        return place

    def _corners(self, line: int, words: list[str]) -> list[str]:
        if len(words) < 3:
            self._refuse(line, f"a face of {len(words)} vertices: name 3 or more")
        return words

    def _index(self, line: int, word: str) -> int:
        """Return the row of the vertex that a face's corner such as 7, 7/1, 7//3 or -1 names."""
        try:
            index = int(word.split("/", 1)[0])
        except ValueError:
            self._refuse(line, f"{show(word)} does not name a vertex: write its number, such as 7, 7/1 or 7//3")
        if index == 0:
            self._refuse(line, "vertex 0 does not exist: count from 1")
        if index < -len(self.vertices):
            self._refuse(line, f"vertex {index} does not exist: only {len(self.vertices)} come before this line")
        return index - 1 if index > 0 else len(self.vertices) + index


def _logical_lines(text: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the number and words of each line that has any, comments taken off and continued lines joined."""
    words: list[str] = []
    start = 1
    for number, line in enumerate(text.splitlines(), 1):
        start = start if words else number
        body = line.split("#", 1)[0].rstrip()
        if body.endswith("\\"):
            words += body[:-1].split()
            continue
        words += body.split()
        if words:
            yield start, words
        words = []
    if words:
        yield start, words
