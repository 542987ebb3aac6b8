"""A tree of boxes over many faces or points, to ask many questions of at once. NumPy, on the host.

The boxes are put in order along a space-filling curve (Morton 1966), and eight neighbours at a time share a box of the
next level. A question goes down from the root as one of many rows (question, box), all of a level tested together.
"""

from collections.abc import Callable, Iterator
from functools import reduce
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Test = Callable[[Ints, Floats, Floats], NDArray[np.bool_]]  # (question, low, high) of the rows: is anything in the box?

WIDTH = 8
AT_ONCE = 4096  # questions that go down together: what bounds the memory


class BoxTree(NamedTuple):
    """Boxes (low, high), each (n, d), of every level from the root's down to the members' own."""

    levels: tuple[tuple[Floats, Floats], ...]
    order: Ints  # (n,) which member each box of the last level is


def box_tree(low: Floats, high: Floats) -> BoxTree:
    """Return the tree over n > 0 boxes (n, d) of d ≤ 4 dimensions."""
    order = np.argsort(_curve(low + high), kind="stable")
    levels = [(low[order], high[order])]
    while len(levels[0][0]) > WIDTH:
        starts = np.arange(0, len(levels[0][0]), WIDTH)
        levels.insert(0, (np.minimum.reduceat(levels[0][0], starts), np.maximum.reduceat(levels[0][1], starts)))
    return BoxTree(tuple(levels), order)


def _curve(middle: Floats) -> NDArray[np.uint64]:
    """Return the place of each row (n, d) on the curve: the bits of its coordinates, one of each in turn."""
    dimensions = middle.shape[1]
    bits = 60 // dimensions
    low, size = middle.min(axis=0), np.maximum(np.ptp(middle, axis=0), np.finfo(float).tiny)
    cells = np.minimum((middle - low) / size * 2**bits, 2**bits - 1).astype(np.uint64)
    place = np.zeros(len(middle), np.uint64)
    for bit in range(bits - 1, -1, -1):
        for cell in cells.T:
            place = place << np.uint64(1) | cell >> np.uint64(bit) & np.uint64(1)
    return place


def descend(tree: BoxTree, test: Test, questions: Ints) -> tuple[Ints, Ints]:
    """Return the rows (question, member) whose boxes pass the test all the way down."""
    asked, box = (
        np.repeat(questions, len(tree.levels[0][0])),
        np.tile(np.arange(len(tree.levels[0][0])), len(questions)),
    )
    for depth, (low, high) in enumerate(tree.levels):
        if depth:
            asked, box = np.repeat(asked, WIDTH), (box[:, None] * WIDTH + np.arange(WIDTH)).ravel()
            there = box < len(low)
            asked, box = asked[there], box[there]
        passed = test(asked, low[box], high[box])
        asked, box = asked[passed], box[passed]
    return asked, tree.order[box]


def meetings(tree: BoxTree, low: Floats, high: Floats) -> Iterator[tuple[Ints, Ints]]:
    """Yield rows (question, member) whose boxes meet, for boxes (n, d), some thousand questions at a time."""

    def meet(asked: Ints, least: Floats, most: Floats) -> NDArray[np.bool_]:
        apart = (low[asked] > most) | (least > high[asked])
        return ~reduce(np.logical_or, apart.T)  # np.any along a short axis takes twice as long

    for start in range(0, len(low), AT_ONCE):
        yield descend(tree, meet, np.arange(start, min(start + AT_ONCE, len(low))))


def box_distances(points: Floats, low: Floats, high: Floats) -> Floats:
    """Return the distances (n,) from points (n, d) to boxes: 0 inside."""
    return np.linalg.norm(np.maximum(np.maximum(low - points, points - high), 0), axis=-1)


def nearest_members(tree: BoxTree, points: Floats, limits: Floats) -> tuple[Ints, Ints]:
    """Return rows (point, member), among them each point's nearest member, if it is within the point's limit.

    Others are in which, by their boxes, may be as near. points: (n, d). limits: (n,), lowered as the search finds out.
    """
    limits = limits.copy()

    def near(asked: Ints, low: Floats, high: Floats) -> NDArray[np.bool_]:
        # Nothing of interest is farther than the far corner of any box
        corner = np.maximum(points[asked] - low, high - points[asked])
        np.minimum.at(limits, asked, np.linalg.norm(corner, axis=-1))
        return box_distances(points[asked], low, high) <= limits[asked]

    return descend(tree, near, np.arange(len(points)))
