"""Second readers of mesh files, to compare with: faces, least and largest area that they can be cut to.

A quad that is not plane has an area for each diagonal; that of a plane concave polygon is told by its outline.
"""

import io
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import trimesh


def area_of(vertices: Any, faces: Any) -> float:
    """Return the area of triangles."""
    a, b, c = (np.asarray(vertices, np.float64)[np.asarray(faces)[:, i]] for i in range(3))
    with np.errstate(all="ignore"):
        return float(np.linalg.norm(np.cross(b - a, c - a), axis=-1).sum() / 2)


def second_readers(path: Path) -> list[tuple[int, float, float]]:
    """Return what trimesh and the plainest reader of words find, where they read the file at all."""
    found = []
    plain = {".obj": _plain_obj, ".off": _plain_off, ".stl": _plain_stl, ".ply": _plain_ply}.get(path.suffix)
    for read in (_by_trimesh, plain):
        try:
            found += [read(path)] if read else []
        except Exception:  # a reader that fails has no say
            continue
    return [other for other in found if other[0]]


def _by_trimesh(path: Path) -> tuple[int, float, float]:
    if path.suffix == ".glb" and re.search(rb'"(sparse|normalized)"', path.read_bytes()):
        raise ValueError("trimesh passes over these")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        loaded = trimesh.load(io.BytesIO(path.read_bytes()), file_type=path.suffix[1:], process=False)
    parts = [p for p in (loaded.dump() if isinstance(loaded, trimesh.Scene) else [loaded]) if len(p.faces)]
    area = sum(area_of(p.vertices, p.faces) for p in parts)
    return sum(len(p.faces) for p in parts), area, area


def _text(path: Path) -> str:
    """Return the words that matter."""
    return re.sub(r"#.*", "", path.read_text("utf-8-sig", "replace"))


def _plain_obj(path: Path) -> tuple[int, float, float]:
    vertices: list[list[float]] = []
    polygons: list[list[int]] = []
    for line in _text(path).replace("\\\n", " ").split("\n"):
        words = line.split()
        if words[:1] == ["v"]:
            vertices.append([float(word) for word in words[1:4]])
        elif words[:1] in (["f"], ["fo"]):
            corners = [int(word.split("/")[0]) for word in words[1:]]
            polygons.append([i - 1 if i > 0 else len(vertices) + i for i in corners])
    return _filled(vertices, polygons)


def _plain_off(path: Path) -> tuple[int, float, float]:
    """Read a stream of words, each face without colours."""
    head, body = re.match(r"\s*(\w*OFF)?(.*)", _text(path), re.DOTALL | re.IGNORECASE).groups()
    head, words = (head or "").upper(), body.split()
    edges = 3 if len(body.strip().splitlines()[0].split()) != 2 else 2
    weight = "4" in head
    width = 3 + weight + 3 * ("NO" in head) + 4 * ("C" in head) + 2 * ("ST" in head)
    v, n, at = int(words[0]), int(words[1]), edges
    numbers = np.array([float(word) for word in words[at : at + v * width]]).reshape(v, width)
    places = numbers[:, :3] / numbers[:, 3:4] if weight else numbers[:, :3]
    at += v * width
    return _filled(places.tolist(), _take_lists(words[at:], n))


def _plain_ply(path: Path) -> tuple[int, float, float]:
    """Read text of vertices of three numbers and faces of one list, in this order."""
    head, body = _text(path).split("end_header", 1)
    v, n = (int(re.search(rf"element {name} (\d+)", head)[1]) for name in ("vertex", "face"))
    words = body.split()
    vertices = [[float(word) for word in words[i : i + 3]] for i in range(0, 3 * v, 3)]
    return _filled(vertices, _take_lists(words[3 * v :], n))


def _take_lists(words: list[str], count: int) -> list[list[int]]:
    at, lists = 0, []
    for _ in range(count):
        size = int(words[at])
        lists.append([int(word) for word in words[at + 1 : at + 1 + size]])
        at += 1 + size
    return lists


def _plain_stl(path: Path) -> tuple[int, float, float]:
    rows = re.findall(r"vertex\s+(\S+)\s+(\S+)\s+(\S+)", _text(path), re.IGNORECASE)
    vertices = [[float(word) for word in row] for row in rows]
    return _filled(vertices, np.arange(len(rows)).reshape(-1, 3).tolist())


def _filled(vertices: list[list[float]], polygons: list[list[int]]) -> tuple[int, float, float]:
    """Return the faces, and the least and the largest area that they can be cut to."""
    places = np.array(vertices)
    least = most = 0.0
    for polygon in polygons:
        corners = places[polygon]
        areas = [_fan_area(np.roll(corners, -i, axis=0)) for i in range(len(polygon))]
        # Of a concave polygon that is plane
        areas.append(float(np.linalg.norm(np.cross(corners, np.roll(corners, -1, axis=0)).sum(axis=0))) / 2)
        least, most = least + min(areas), most + max(areas)
    return sum(len(p) - 2 for p in polygons), least, most


def _fan_area(corners: Any) -> float:
    spokes = corners[1:] - corners[0]
    return float(np.linalg.norm(np.cross(spokes[:-1], spokes[1:]), axis=-1).sum() / 2)
