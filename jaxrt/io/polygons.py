"""Polygons to triangles: a fan where that is right, ear clipping where a corner points inwards. NumPy, on the host."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from jaxrt.mesh_facts import Floats, Ints, cross

FLAT = 1e-12  # of the polygon's own size squared: an area below this is rounding


class CrossedPolygon(ValueError):
    """A polygon that no triangles fill: it crosses itself. `number` says which."""

    def __init__(self, number: int):
        super().__init__(f"polygon {number} crosses itself")
        self.number = number


def triangulate(vertices: Floats, polygons: Sequence[Sequence[int]]) -> tuple[Ints, Ints]:
    """Return triangles (n, 3) that fill the polygons, in their order, and the polygon (n,) that each comes from.

    Raises CrossedPolygon.
    """
    sizes = np.array([len(p) for p in polygons])
    parts: list[tuple[Ints, Ints]] = []
    for size in np.unique(sizes):
        numbers = np.flatnonzero(sizes == size)
        corners = np.array([polygons[int(i)] for i in numbers], np.int64)
        fan = _fan(corners)
        folded = _folds(vertices[corners]) if size > 3 else np.zeros(len(corners), bool)
        for i in np.flatnonzero(folded):
            clipped = clip_ears(vertices[corners[i]])
            if clipped is None:
                raise CrossedPolygon(int(numbers[i]))
            fan[i] = corners[i][clipped]
        parts.append((fan.reshape(-1, 3), np.repeat(numbers, size - 2)))
    triangles, sources = (np.concatenate(part) for part in zip(*parts, strict=True))
    order = np.argsort(sources, kind="stable")
    return triangles[order], sources[order]


def _fan(corners: Ints) -> Ints:
    """Return the triangles (m, k − 2, 3) around the first corner of polygons (m, k)."""
    m, k = corners.shape
    first = np.broadcast_to(corners[:, :1], (m, k - 2))
    return np.stack([first, corners[:, 1:-1], corners[:, 2:]], -1)


def _folds(corners: Floats) -> NDArray[np.bool_]:
    """Return for polygons (m, k, 3) whether a triangle of their fan faces the other way than the whole."""
    spokes = corners[:, 1:] - corners[:, :1]
    areas = cross(spokes[:, :-1], spokes[:, 1:])
    whole = areas.sum(axis=1)
    size = np.sum(whole * whole, -1, keepdims=True)
    return np.any(np.sum(areas * whole[:, None], -1) < -FLAT * size, axis=-1)


def clip_ears(corners: Floats) -> Ints | None:
    """Return triangles (k − 2, 3) that fill one polygon (k, 3), None where none do (Meisters 1975).

    The polygon is seen along its mean normal, that of Newell's formula.
    """
    points = _flatten(corners)
    left, triangles = list(range(len(points))), []
    while len(left) > 3:
        ears = (i for i in range(len(left)) if _is_ear(points, left, i))
        ear = next(ears, None)
        if ear is None:
            return None
        triangles.append([left[ear - 1], left[ear], left[(ear + 1) % len(left)]])
        del left[ear]
    triangles.append(left)
    filled = np.array(triangles)
    areas = _turn(*(points[filled[:, i]] for i in range(3)))
    return filled if (areas >= -FLAT * np.abs(areas).sum()).all() else None


def _flatten(corners: Floats) -> Floats:
    """Return the corners (k, 2) in the plane of the mean normal, counter-clockwise."""
    spokes = corners - corners[0]
    normal = cross(spokes[:-1], spokes[1:]).sum(axis=0)
    axis = int(np.argmax(np.abs(normal)))
    flat = spokes[:, [(axis + 1) % 3, (axis + 2) % 3]]
    return flat if normal[axis] >= 0 else flat[:, ::-1]


def _turn(a: Floats, b: Floats, c: Floats) -> Floats:
    """Return twice the signed areas of triangles with corners (…, 2)."""
    turn: Floats = (b - a)[..., 0] * (c - a)[..., 1] - (b - a)[..., 1] * (c - a)[..., 0]
    return turn


def _is_ear(points: Floats, left: list[int], i: int) -> bool:
    """Return whether corner `i` turns left and no other corner lies in its triangle."""
    trio = [left[i - 1], left[i], left[(i + 1) % len(left)]]
    a, b, c = points[trio]
    if _turn(a, b, c) <= 0:
        return False
    others = points[[j for j in left if j not in trio]]
    # A corner at the same place as one of the three is a seam of the polygon, and blocks nothing
    others = others[~np.any(np.all(others[:, None] == points[trio], axis=-1), axis=-1)]
    inside = (_turn(a, b, others) >= 0) & (_turn(b, c, others) >= 0) & (_turn(c, a, others) >= 0)
    return not inside.any()
