"""The nodes of a glTF file: which are drawn, and where they stand."""

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from jaxrt.description import show
from jaxrt.description.mesh_facts import Floats
from jaxrt.io.meshes.accessors import Broken, Table, item, rows


def drawn_nodes(document: Table, say: Callable[[str], None]) -> Iterator[tuple[Table, Floats]]:
    """Yield the nodes of the default scene, children after parents, each with its world matrix (4, 4).

    The first scene is the default where none is named; without scenes, all nodes are drawn. Raises Broken.
    """
    waiting = [(number, np.eye(4)) for number in reversed(_roots(document, say))]
    seen: set[int] = set()
    while waiting:
        number, parent = waiting.pop()
        node = item(document, "nodes", number)
        if number in seen:
            raise Broken(f"nodes[{number}]: is drawn twice, or holds itself: save it again")
        seen.add(number)
        with np.errstate(over="ignore", invalid="ignore"):
            matrix = parent @ _matrix(node, f"nodes[{number}]")
        yield node, matrix
        waiting += [(child, matrix) for child in reversed(_numbers(node, "children", f"nodes[{number}]"))]


def _roots(document: Table, say: Callable[[str], None]) -> list[int]:
    scenes = rows(document, "scenes")
    if not scenes:
        children = {child for node in rows(document, "nodes") for child in _numbers(node, "children", "nodes")}
        return [i for i in range(len(rows(document, "nodes"))) if i not in children]
    if "scene" not in document and len(scenes) > 1:
        say(f"{len(scenes)} scenes are there and none is the default: the first is read")
    number = document.get("scene", 0)
    return _numbers(item(document, "scenes", number), "nodes", f"scenes[{number}]")


def _numbers(table: Table, name: str, place: str) -> list[int]:
    found = table.get(name, [])
    if not isinstance(found, list) or not all(isinstance(i, int) for i in found):
        raise Broken(f"{place}.{name}: is no list of whole numbers: save it again")
    return found


def _matrix(node: Table, place: str) -> Floats:
    """Return the matrix (4, 4) of a node: its own, or scale, then rotation, then translation."""
    if "matrix" in node:
        return _vector(node, "matrix", 16, (), place).reshape(4, 4).T
    x, y, z, w = _vector(node, "rotation", 4, (0, 0, 0, 1), place)
    length = math.sqrt(x * x + y * y + z * z + w * w)
    if not 0 < length < math.inf:
        raise Broken(f"{place}.rotation: is no quaternion: save it again")
    x, y, z, w = x / length, y / length, z / length, w / length
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    matrix = np.eye(4)
    matrix[:3, :3] = turn * _vector(node, "scale", 3, (1, 1, 1), place)
    matrix[:3, 3] = _vector(node, "translation", 3, (0, 0, 0), place)
    return matrix


def _vector(node: Table, name: str, size: int, otherwise: tuple[float, ...], place: str) -> Floats:
    value: Any = node.get(name, otherwise)
    numeric = isinstance(value, list | tuple) and all(
        isinstance(x, int | float) and not isinstance(x, bool) for x in value
    )
    if not numeric or len(value) != size or not all(abs(x) < 1e300 for x in value):
        raise Broken(f"{place}.{name}: {show(value)} is not {size} numbers: save it again")
    return np.array([float(x) for x in value])
