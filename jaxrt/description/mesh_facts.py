"""What can be told of a mesh before any ray is traced: areas, edges, volume, inside and outside. NumPy, on the host.

Meshes of a million faces are met here, so all is linear in the faces, or sorts them once.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jaxrt.description.box_tree import Floats, Ints, box_tree, meetings, nearest_members

FEW = 16  # points that look for the nearest triangle together: all triangles may be equally near
COLLINEAR = 1e-12  # twice the area over the square of the longest side, rounding of float64 included
SMALLEST = float(np.finfo(np.float32).tiny)  # of the square of twice the area, which float32 must hold
ASKEW = np.array([0.31830989, 0.27182818])  # slopes of the ray that tells inside from outside
# Vertices of one corner that a CAD program or a text file with six digits tells apart: they differ by 1e-6 of the
# coordinates along each axis, 3.5e-6 in all where both are rounded
SAME_PLACE = 5e-6  # of the mesh's size, that of its box or, as strays have no say, of its faces side by side,
SAME_PLACE_OF_SIDES = 0.1  # or of the median of its faces' longest sides, if that is less


def cross(a: Floats, b: Floats) -> Floats:
    """Return the cross products of rows (…, 3); several times faster than `numpy.cross`."""
    x, y, z = np.moveaxis(a, -1, 0)
    u, v, w = np.moveaxis(b, -1, 0)
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], -1)


def faces_with_area(vertices: Floats, faces: Ints) -> NDArray[np.bool_]:
    """Return for each face (n,) whether it has an area, in float64 and in what float32 can hold."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    with np.errstate(over="ignore", invalid="ignore"):
        squared = np.sum(cross(b - a, c - a) ** 2, -1)
        longest = np.maximum(np.sum((b - a) ** 2, -1), np.maximum(np.sum((c - a) ** 2, -1), np.sum((c - b) ** 2, -1)))
    return (squared > (COLLINEAR * longest) ** 2) & (squared >= SMALLEST)


def weld(vertices: Floats) -> Ints:
    """Return for each vertex (v,) the first one at the very same place."""
    rows = vertices + 0.0  # makes −0 a 0
    order = np.lexsort(rows.T)
    ordered = rows[order]
    first = np.concatenate([[True], np.any(ordered[1:] != ordered[:-1], axis=-1)])
    # lexsort is stable, so the first of each run has the lowest number
    together = np.empty(len(rows), np.int64)
    together[order] = order[np.flatnonzero(first)][np.cumsum(first) - 1]
    return together


def weld_near(vertices: Floats, tolerance: float) -> Ints:
    """Return for each vertex (v,) the one that it is at the same place with: at most `tolerance` away from it.

    Each cluster has a vertex that all others are near to, so that a row of vertices is no chain across a gap.
    """
    tree, pairs = box_tree(vertices, vertices), []
    for a, b in meetings(tree, vertices - tolerance, vertices + tolerance):
        near = np.linalg.norm(vertices[a] - vertices[b], axis=-1) <= tolerance
        pairs.append((a[near], b[near]))
    a, b = (np.concatenate(x) for x in zip(*pairs, strict=True))
    # Of free neighbours the one of the lowest rank leads; ranks are random, so that few rounds do
    rank = np.random.default_rng(0).permutation(len(vertices))
    leader = np.full(len(vertices), -1)
    while len(a):
        lowest = np.full(len(vertices), len(vertices))
        np.minimum.at(lowest, a, rank[b])
        leads = lowest == rank
        follows = leads[b]
        leader[a[follows]] = b[follows]
        leader[leads] = np.flatnonzero(leads)
        free = (leader[a] < 0) & (leader[b] < 0)
        a, b = a[free], b[free]
    return leader


class Edges(NamedTuple):
    """Numbers of edges that a closed surface does not have."""

    open: int  # of one face only
    crowded: int  # of three faces or more
    flipped: int  # of two faces that disagree on which side is outside


def count_edges(vertices: Floats, faces: Ints) -> Edges:
    """Return the numbers of unsound edges; vertices at the same place, within SAME_PLACE, count as one."""
    corners = weld(vertices)[faces]
    edges, loose = _count(corners)
    if not edges.open:
        return edges
    # Only what is open wants a tolerance
    places = vertices[corners]
    sides = np.linalg.norm(places - np.roll(places, 1, axis=1), axis=-1).max(axis=-1)
    usual = float(np.median(sides))
    size = min(float(np.linalg.norm(np.ptp(places.reshape(-1, 3), axis=0))), usual * len(faces) ** 0.5)
    together = np.arange(len(vertices))
    together[loose] = loose[weld_near(vertices[loose], min(SAME_PLACE * size, SAME_PLACE_OF_SIDES * usual))]
    corners = together[corners]
    whole = np.all(corners != np.roll(corners, 1, axis=1), axis=1)
    return _count(corners[whole])[0]


def _count(corners: Ints) -> tuple[Edges, Ints]:
    """Return the numbers of unsound edges of faces (n, 3), and the vertices at open ones."""
    start, end = corners.ravel(), np.roll(corners, -1, axis=1).ravel()
    top = int(corners.max(initial=0)) + 1
    key = np.minimum(start, end) * top + np.maximum(start, end)
    order = np.argsort(key)
    key, forward = key[order], (start < end)[order].astype(np.int64)
    begin = np.flatnonzero(np.diff(key, prepend=-1))
    count = np.diff(np.append(begin, len(key)))
    balance = np.add.reduceat(forward, begin) if len(begin) else begin
    alone = key[begin[count == 1]]
    edges = Edges(len(alone), int(np.sum(count > 2)), int(np.sum((count == 2) & (balance != 1))))
    return edges, np.unique(np.concatenate([alone // top, alone % top]))


def signed_volume(vertices: Floats, faces: Ints) -> float:
    """Return the volume that a closed mesh holds, negative where its faces wind the wrong way round."""
    a, b, c = (vertices[faces[:, i]] - vertices[faces[0, 0]] for i in range(3))
    return float(np.sum(a * cross(b, c))) / 6


def winding_number(point: Floats, vertices: Floats, faces: Ints) -> int:
    """Return how often a closed mesh winds around a point: 0 outside, ±1 inside."""
    return int(winding_numbers(np.asarray(point, float)[None], vertices, faces)[0])


def winding_numbers(points: Floats, vertices: Floats, faces: Ints) -> Ints:
    """Return how often a closed mesh winds around each of the points (p, 3).

    A ray from the point counts the faces that it leaves through, less those that it enters through. It is askew, so
    that it runs along no edge of what people build.
    """

    def flat(places: Floats) -> Floats:
        return places[..., 1:] - places[..., :1] * ASKEW

    seen, aims = flat(vertices)[faces], flat(points)
    tree = box_tree(seen.min(axis=1), seen.max(axis=1))
    numbers = np.zeros(len(points), np.int64)
    for point, face in meetings(tree, aims, aims):
        (ay, az), (by, bz), (cy, cz) = (flat(vertices[faces[face, i]] - points[point]).T for i in range(3))
        # Where the ray's line meets the face's plane, and whether that is within and ahead
        weights = np.stack([by * cz - bz * cy, cy * az - cz * ay, ay * bz - az * by])
        side = np.sign(weights.sum(axis=0))
        along = (vertices[faces[face], 0] - points[point, :1]).T
        met = np.all(weights * side >= 0, axis=0) & (side * np.sum(weights * along, axis=0) > 0)
        np.add.at(numbers, point, np.where(met, side, 0).astype(np.int64))
    return numbers


def nearest_distances(points: Floats, corners: Floats, limits: Floats) -> Floats:
    """Return the distance (p,) from each point (p, 3) to the nearest of the triangles (n, 3, 3), ∞ beyond its limit."""
    tree = box_tree(corners.min(axis=1), corners.max(axis=1))
    distances = np.full(len(points), np.inf)
    for start in range(0, len(points), FEW):
        few = slice(start, start + FEW)
        point, face = nearest_members(tree, points[few], limits[few])
        for part in np.array_split(np.arange(len(point)), len(point) // 100_000 + 1):
            found = triangle_distances(points[few][point[part]], corners[face[part]])
            np.minimum.at(distances, start + point[part], found)
    return np.where(distances <= limits, distances, np.inf)


def triangle_distances(points: Floats, corners: Floats) -> Floats:
    """Return the distances (n,) from a point (3,), or one each (n, 3), to triangles (n, 3, 3)."""
    points = np.asarray(points)[..., None, :]
    start, edge = corners, np.roll(corners, -1, axis=1) - corners
    # Distance to each edge
    t = np.sum((points - start) * edge, axis=-1) / np.sum(edge * edge, axis=-1)
    to_edges = np.linalg.norm(start + np.clip(t, 0, 1)[..., None] * edge - points, axis=-1).min(axis=-1)
    # Distance to the plane, where the foot of the perpendicular is inside all three edges
    normal = cross(edge[:, 0], edge[:, 1])
    side = np.sum(cross(edge, points - start) * normal[:, None], axis=-1)
    to_plane = np.abs(np.sum((points[..., 0, :] - start[:, 0]) * normal, axis=-1)) / np.linalg.norm(normal, axis=-1)
    return np.where((side >= 0).all(axis=-1), to_plane, to_edges)
