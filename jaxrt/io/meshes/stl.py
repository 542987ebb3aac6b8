"""STL files, binary and text: triangles, whose corners are made one where they share a place."""

import re

import numpy as np

from jaxrt.description import SceneError, show
from jaxrt.description.mesh_facts import Floats, weld
from jaxrt.io.meshes.soundness import Mesh, check_vertices, left_over, no_faces
from jaxrt.io.meshes.text import BadRow, decode, floats, number_hint, numbers

_HEAD = 84  # bytes: a comment, and the number of triangles
_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_VERTEX = r"vertex\s+(\S+\s+\S+\s+\S+)\s+"
_FACET = re.compile(
    rf"facet\s+normal\s+\S+\s+\S+\s+\S+\s+outer\s+loop\s+{_VERTEX * 3}endloop\s+endfacet", re.IGNORECASE
)

# A facet word by word, numbers left blank
_WORDS = ["facet", "normal", *3 * [""], "outer", "loop", *3 * ["vertex", "", "", ""], "endloop", "endfacet"]
_PIECE = re.compile(r"endloop|endfacet|vertex\s+[-+.\d]", re.IGNORECASE)


def read_stl(data: bytes, source: str) -> Mesh:
    """Return the mesh in an STL file. Raises SceneError with file and facet."""
    count = int.from_bytes(data[80:_HEAD], "little") if len(data) >= _HEAD else -1
    # The size alone tells: many binary files begin with "solid" too
    if len(data) == _HEAD + _RECORD.itemsize * count and count > 0:
        return _binary(data, count, source, [])
    text = decode(data)
    if re.match(r"\s*solid\b", text, re.IGNORECASE) and ("\0" not in text or count < 0):
        return _text(text, source)
    if count < 0:
        raise SceneError(f"{source}: cannot be read (neither text nor binary STL): save it again")
    present = (len(data) - _HEAD) // _RECORD.itemsize
    if count == 0 and present:
        return _binary(data, present, source, [f"0 triangles are announced, and all {present} that follow are read"])
    if count > present:
        raise SceneError(f"{source}: {count} triangles are announced, but {present} follow: save it again")
    rest = len(data) - _HEAD - _RECORD.itemsize * count
    return _binary(data, count, source, [left_over(rest, "triangle")])


def _binary(data: bytes, count: int, source: str, notes: list[str]) -> Mesh:
    if not count:
        raise no_faces(source)
    records = np.frombuffer(data, _RECORD, count, _HEAD)
    if b"COLOR=" in data[:80] or records["attribute"].any():
        notes = ["face colours are not read", *notes]
    return _mesh(records["corners"].astype(np.float64), source, notes)


def _text(text: str, source: str) -> Mesh:
    corners = _regular(text)
    if corners is not None:
        return _mesh(corners, source, [])
    found = list(_FACET.finditer(text))
    rows = [row for match in found for row in match.groups()]
    broken, notes = _look_at_rest(_FACET.sub(lambda match: "\n" * match[0].count("\n"), text))
    if broken is not None:
        raise SceneError(f"{source}: line {broken}: a facet is not whole, or not of three corners: save it again")
    if not rows:
        raise no_faces(source)
    try:
        corners = floats([" ".join(row.split()) for row in rows], 3)
    except BadRow as error:
        row = " ".join(rows[error.row].split())
        line = 1 + text.count("\n", 0, found[error.row // 3].start(error.row % 3 + 1))
        hint = number_hint(row, "write vertex x y z")
        raise SceneError(f"{source}: line {line}: {show(row)} is not a place: {hint}") from None
    ended = re.search(r"^\s*endsolid\b", text[found[-1].end() :], re.IGNORECASE)
    notes += [] if ended else ["there is no endsolid: some triangles may be missing"]
    return _mesh(corners.reshape(-1, 3, 3), source, notes)


def _regular(text: str) -> Floats | None:
    """Return the corners (n, 3, 3) of one solid in the plainest words, which nearly all large files are; else None."""
    start = max(text.find("facet normal"), 0)
    words = text[start:].split()
    count, width = len(words) // len(_WORDS), len(_WORDS)
    end = count * width
    if not count or words[end : end + 1] != ["endsolid"] or "\n" in text[:start].strip():
        return None
    # What stands around the facets may be a broken one
    around = text[:start] + " ".join(words[end:])
    if _PIECE.search(around) or "facet" in around:
        return None
    if any(word and words[i:end:width].count(word) != count for i, word in enumerate(_WORDS)):
        return None
    places = [words[i:end:width] for i, word in enumerate(_WORDS) if not word][3:]
    found = numbers(" ".join([" ".join(column) for column in places]), 9 * count, np.float64)
    return None if found is None else found.reshape(3, 3, count).transpose(2, 0, 1)


def _look_at_rest(rest: str) -> tuple[int | None, list[str]]:
    """Return the line of a piece of a facet, None where there is none, and a note of other words that are left out.

    rest: the text without its sound facets. The name of a solid may be made of the words of a facet.
    """
    unknown = 0
    for number, line in enumerate(rest.split("\n"), 1):
        words = line.lower().split()
        if words and (words[0] in _WORDS or _PIECE.search(line)):
            return number, []
        unknown += bool(words) and words[0] not in ("solid", "endsolid")
    return None, [f"unknown words ({unknown} lines) are left out"] * bool(unknown)


def _mesh(corners: Floats, source: str, notes: list[str]) -> Mesh:
    """Return the mesh of triangles (n, 3, 3), vertices at the same place made one."""
    vertices = corners.reshape(-1, 3)
    check_vertices(source, vertices, lambda i: f"facet {i // 3}")
    together = weld(vertices)
    kept = together == np.arange(len(vertices))
    faces = (np.cumsum(kept) - 1)[together].reshape(-1, 3)
    return Mesh(vertices[kept], faces, notes)
