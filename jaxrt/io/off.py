"""OFF text with every polygon cut into triangles before trimesh reads it, which fans concave ones."""

import numpy as np

from jaxrt.description import SceneError, show
from jaxrt.io.polygons import CrossedPolygon, triangulate


def plain_off(text: str, source: str) -> str:
    """Return the OFF file `text` with triangles alone. Raises SceneError with file and line."""
    lines = [(i, line.split("#", 1)[0].split()) for i, line in enumerate(text.splitlines(), 1)]
    lines = [(i, words) for i, words in lines if words]
    if not lines or lines[0][1][0] not in ("OFF", "COFF"):
        raise SceneError(f"{source}: the first line is not OFF: check that this is an OFF file")
    # The counts may share the first line
    if len(lines[0][1]) > 1:
        lines.insert(1, (lines[0][0], lines[0][1][1:]))
    v, n = (_numbers(source, *lines[1], int, 2) if len(lines) > 1 else [0, 0])[:2]
    if v < 0 or n < 0 or len(lines) < 2 + v + n:
        raise SceneError(f"{source}: {v} vertices and {n} faces are announced, but the file ends early: save it again")
    vertices = np.array([_numbers(source, i, words, float, 3)[:3] for i, words in lines[2 : 2 + v]])
    polygons = [_polygon(source, i, words, v) for i, words in lines[2 + v : 2 + v + n]]
    if not polygons:
        return "OFF\n0 0 0\n"
    try:
        faces, _ = triangulate(vertices, polygons)
    except CrossedPolygon as error:
        line = lines[2 + v + error.number][0]
        raise SceneError(f"{source}: line {line}: the polygon crosses itself: split it into triangles") from None
    rows = [f"{x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()] + [f"3 {a} {b} {c}" for a, b, c in faces.tolist()]
    return "\n".join(["OFF", f"{v} {len(faces)} 0", *rows]) + "\n"


def _numbers(source: str, line: int, words: list[str], kind: type, least: int) -> list:
    try:
        numbers = [kind(word) for word in words]
    except ValueError:
        numbers = []
    if len(numbers) < least or not np.isfinite(numbers[:3]).all():
        raise SceneError(f"{source}: line {line}: {show(' '.join(words))} is not {least} finite numbers: correct it")
    return numbers


def _polygon(source: str, line: int, words: list[str], vertices: int) -> list[int]:
    size = _numbers(source, line, words[:1], int, 1)[0]
    corners = _numbers(source, line, words[1 : size + 1], int, max(size, 1))
    if size < 3:
        raise SceneError(f"{source}: line {line}: a face of {size} vertices: name 3 or more")
    for corner in corners:
        if not 0 <= corner < vertices:
            raise SceneError(f"{source}: line {line}: vertex {corner} does not exist: use 0 to {vertices - 1}")
    return corners
