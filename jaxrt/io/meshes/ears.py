"""One polygon of any shape to triangles, by clipping ears (Meisters 1975; O'Rourke, Computational Geometry in C, 1.4).

Only a corner that turns right can lie in another's ear, and to clip an ear changes what its two neighbours are, no
other: so each clip costs two tests, and a test looks at the right turns within the ear's width alone.
"""

from collections import deque

import numpy as np

from jaxrt.description.mesh_facts import Floats, Ints, cross

ROUNDING = 1e-12  # of the sum of all areas
LOOKS = 32  # at all corners anew, where no neighbour of a clipped ear is one: rounding, and seams


def clip_ears(corners: Floats) -> Ints | None:
    """Return triangles (k − 2, 3) that fill one polygon (k, 3), None where it crosses itself.

    The polygon is seen along its mean normal, that of Newell's formula.
    """
    points = _flatten(corners)
    if not _turns_once(points):
        return None
    filled = _Ring(points).clip()
    if filled is None:
        return None
    areas = _turn(*(points[filled[:, i]] for i in range(3)))
    return filled if (areas >= -ROUNDING * np.abs(areas).sum()).all() else None


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


def _turns_once(points: Floats) -> bool:
    """Return whether the outline (k, 2) turns by 360° in all, as one that does not cross itself."""
    sides = np.roll(points, -1, axis=0) - points
    sides = sides[np.any(sides != 0, axis=-1)]
    after = np.roll(sides, -1, axis=0)
    sine = sides[:, 0] * after[:, 1] - sides[:, 1] * after[:, 0]
    cosine = np.sum(sides * after, -1)
    # A spike turns by half a circle, to either side
    spikes = int(np.sum((sine == 0) & (cosine < 0)))
    return abs(float(np.arctan2(sine, cosine).sum()) / (2 * np.pi) - 1) < spikes + 0.25


class _Ring:
    """The corners that are left of a polygon."""

    def __init__(self, points: Floats):
        self.points = points
        count = len(points)
        self.before = [count - 1, *range(count - 1)]
        self.after = [*range(1, count), 0]
        self.left = np.ones(count, bool)
        self.turns = _turn(np.roll(points, 1, axis=0), points, np.roll(points, -1, axis=0))
        # Corners that may lie in an ear, from left to right
        right = np.flatnonzero(self.turns <= 0)
        self.right = right[np.argsort(points[right, 0])]
        self.places = points[self.right, 0]
        self.blocks = self.turns <= 0

    def clip(self) -> Ints | None:
        """Return the triangles, None where no ear is found."""
        triangles, looks, count = [], 0, len(self.points)
        waiting = deque((i, 0) for i in range(count))
        # How often a corner was put off: a clipped ear's neighbours wait for another round, or all would make one fan
        # of slivers, each as wide as the polygon
        put_off = [0] * count
        while count > 3:
            if not waiting:
                looks += 1
                waiting.extend((i, put_off[i]) for i in (self._look_anew() if looks <= LOOKS else ()))
                if not waiting:
                    return None
            i, entry = waiting.popleft()
            if not self.left[i] or entry != put_off[i] or not self._is_ear(i, flat=looks > 0):
                continue
            triangles.append([self.before[i], i, self.after[i]])
            for j in self._remove(i):
                put_off[j] += 1
                waiting.append((j, put_off[j]))
            count -= 1
        last = int(np.flatnonzero(self.left)[0])
        triangles.append([last, self.after[last], self.after[self.after[last]]])
        return np.array(triangles)

    def _look_anew(self) -> list[int]:
        """Return the corners that are ears after all; where there are none, one on a straight line."""
        left = [int(i) for i in np.flatnonzero(self.left)]
        ears = [i for i in left if self._is_ear(i, flat=False)]
        return ears or [i for i in left if self._is_ear(i, flat=True)][:1]

    def _remove(self, i: int) -> tuple[int, int]:
        """Take a corner away, and return its neighbours."""
        before, after = self.before[i], self.after[i]
        self.after[before], self.before[after], self.left[i] = after, before, False
        self.blocks[i] = False
        for j in (before, after):
            self.turns[j] = _turn(self.points[self.before[j]], self.points[j], self.points[self.after[j]])
            self.blocks[j] = self.turns[j] <= 0
        return before, after

    def _is_ear(self, i: int, flat: bool) -> bool:
        """Return whether a corner turns left, or not at all where it may be flat, with no other in its triangle."""
        if self.turns[i] <= 0:
            return flat and self.turns[i] == 0
        trio = self.points[[self.before[i], i, self.after[i]]]
        low = np.searchsorted(self.places, trio[:, 0].min(), side="left")
        high = np.searchsorted(self.places, trio[:, 0].max(), side="right")
        near = self.right[low:high]
        others = self.points[near[self.blocks[near]]]
        a, b, c = trio
        inside = (_turn(a, b, others) >= 0) & (_turn(b, c, others) >= 0) & (_turn(c, a, others) >= 0)
        others = others[inside]
        # A corner at the same place as one of the three is a seam of the polygon, and blocks nothing
        return not len(others) or bool(np.all(np.any(np.all(others[:, None] == trio, axis=-1), axis=-1)))
