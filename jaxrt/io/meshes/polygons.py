"""Polygons to triangles: a fan where that is right, else a better cut. NumPy, on the host."""

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from jaxrt.description.mesh_facts import Floats, Ints, cross
from jaxrt.io.meshes.ears import clip_ears

FLAT = 1e-12  # of the polygon's own size squared: an area below this is rounding
LESS = 1 - 1e-6  # of the largest area that four corners can have: the share that a crossed order stays below
THICK = 0.1  # of its size: how far four corners may leave their plane, and still have a right order

Bools = NDArray[np.bool_]


class Polygons(NamedTuple):
    """Polygons of any sizes, their corners in one row."""

    corners: Ints  # (t,) vertices
    sizes: Ints  # (n,) corners of each polygon

    @classmethod
    def of(cls, polygons: Sequence[Sequence[int]]) -> Self:
        """Return polygons given as lists."""
        return cls(np.array([i for p in polygons for i in p], np.int64), np.array([len(p) for p in polygons], np.int64))

    @property
    def starts(self) -> Ints:
        """Place in `corners` (n,) of each polygon's first corner."""
        starts: Ints = np.cumsum(self.sizes) - self.sizes
        return starts

    def owner(self, corner: int) -> int:
        """Return the polygon that a place in `corners` belongs to."""
        return int(np.searchsorted(np.cumsum(self.sizes), corner, side="right"))


class Triangles(NamedTuple):
    """Triangles that fill polygons, in their order."""

    triangles: Ints  # (m, 3) vertices
    sources: Ints  # (m,) polygon of each triangle
    uncrossed: Ints  # quads whose corners stood in crossed order
    crossed: Ints  # polygons that cross themselves, which no triangles fill: they are fans


def triangulate(vertices: Floats, polygons: Polygons) -> Triangles:
    """Return the triangles of polygons of 3 corners or more."""
    triangles, sources, uncrossed, crossed = ([np.zeros(0, np.int64)] for _ in range(4))
    for size in np.unique(polygons.sizes):
        numbers = np.flatnonzero(polygons.sizes == size)
        corners = polygons.corners[polygons.starts[numbers][:, None] + np.arange(size)]
        if size == 4:
            corners, mended = _uncross(vertices, corners)
            uncrossed.append(numbers[mended])
        cut, failed = _cut(vertices, corners)
        triangles.append(cut.ravel())
        sources.append(np.repeat(numbers, size - 2))
        crossed.append(numbers[failed])
    source = np.concatenate(sources)
    order = np.argsort(source, kind="stable")
    bad = [np.sort(np.concatenate(part)) for part in (uncrossed, crossed)]
    return Triangles(np.concatenate(triangles).reshape(-1, 3)[order], source[order], *bad)


def _cut(vertices: Floats, corners: Ints) -> tuple[Ints, Bools]:
    """Return the triangles (m, k − 2, 3) of polygons (m, k), and for each whether it crosses itself."""
    fan, failed = _fan(corners), np.zeros(len(corners), bool)
    if corners.shape[1] == 3:
        return fan, failed
    folded = np.flatnonzero(_folds(vertices[corners]))
    if corners.shape[1] == 4:
        # A quad has one other diagonal
        turned = np.roll(corners[folded], -1, axis=1)
        failed[folded] = _folds(vertices[turned])
        fan[folded[~failed[folded]]] = _fan(turned[~failed[folded]])
        return fan, failed
    for i in folded:
        clipped = clip_ears(vertices[corners[i]])
        failed[i] = clipped is None
        fan[i] = fan[i] if clipped is None else corners[i][clipped]
    return fan, failed


def _fan(corners: Ints) -> Ints:
    """Return the triangles (m, k − 2, 3) around the first corner of polygons (m, k)."""
    m, k = corners.shape
    first = np.broadcast_to(corners[:, :1], (m, k - 2))
    return np.stack([first, corners[:, 1:-1], corners[:, 2:]], -1)


def _folds(corners: Floats) -> Bools:
    """Return for polygons (m, k, 3) whether their fan does not fill them: parts of it face the other way, or overlap.

    That the area vector is all but zero, though its parts are not, tells a crossing too.
    """
    spokes = corners[:, 1:] - corners[:, :1]
    areas = cross(spokes[:, :-1], spokes[:, 1:])
    whole = areas.sum(axis=1)
    size = np.sum(whole * whole, -1)
    parts = np.sqrt(np.sum(areas * areas, -1))
    folded = np.any(np.sum(areas * whole[:, None], -1) < -FLAT * size[:, None], axis=-1)
    folded |= (size <= FLAT * parts.sum(axis=-1) ** 2) & (parts.sum(axis=-1) > 0)
    if corners.shape[1] > 4:
        sweep = np.arctan2(parts, np.sum(spokes[:, :-1] * spokes[:, 1:], -1)).sum(axis=-1)
        folded |= sweep > 2 * np.pi * (1 + FLAT)
    return folded


def _uncross(vertices: Floats, corners: Ints) -> tuple[Ints, Bools]:
    """Return quads (m, 4) with crossed ones put in order, and which those are.

    The sides b–c and d–a of a crossed quad meet, which exchanging c and d undoes; or a–b and c–d, then b and c. So a
    side keeps its direction, and with it the quads of a grid agree on which side is outside.
    """
    a, b, c, d = np.moveaxis(vertices[corners], 1, 0)
    given, other, third = cross(c - a, d - b), cross(d - a, c - b), cross(b - a, d - c)
    sizes = np.linalg.norm(np.stack([given, other, third]), axis=-1)
    largest = sizes[1:].max(axis=0)
    near = np.flatnonzero(sizes[0] < LESS * largest)
    if not len(near):
        return corners, np.zeros(len(corners), bool)
    a, b, c, d = (corner[near] for corner in (a, b, c, d))
    normal = np.where((sizes[1] >= sizes[2])[near, None], other[near], third[near])
    thickness = np.abs(np.sum((b - a) * cross(c - a, d - a), -1)) / largest[near]
    plane = thickness <= THICK * np.sqrt(largest[near])
    swap_last, swap_middle = plane & _meet(normal, b, c, d, a), plane & _meet(normal, a, b, c, d)
    mended, put = corners.copy(), np.zeros(len(corners), bool)
    for swapped, order in ((swap_last, [0, 1, 3, 2]), (swap_middle, [0, 2, 1, 3])):
        mended[near[swapped]] = corners[near[swapped]][:, order]
        put[near[swapped]] = True
    return mended, put


def _meet(normal: Floats, a: Floats, b: Floats, c: Floats, d: Floats) -> Bools:
    """Return whether the sides a–b and c–d (m, 3) cross, seen along `normal`."""

    def side(p: Floats, q: Floats, r: Floats) -> Floats:
        turn: Floats = np.sign(np.sum(normal * cross(q - p, r - p), -1))
        return turn

    crossing: Bools = (side(a, b, c) * side(a, b, d) < 0) & (side(c, d, a) * side(c, d, b) < 0)
    return crossing
