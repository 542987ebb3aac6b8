"""How two surfaces lie to each other: whether they cross, and where they share a plane. NumPy, on the host.

Boxes are compared first, then single faces. A search that has seen PAIRS of them gives up, and of flat parts with more
than ASKED faces a sample is looked at, so that no scene takes minutes.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from jaxrt.description.box_tree import Floats, Ints, box_tree, meetings
from jaxrt.description.mesh_facts import cross, triangle_distances, weld

PAIRS, ASKED = 4_000_000, 30_000
TOUCHING = 1e-6  # of the coordinates: what is nearer than that touches, and does not cross
ROUNDING = 2 * 12 * 2.0**-24  # of coordinates in float32, of both faces: see `triangle._plane_error`
OVERLAP = 0.01  # of the lesser height of two faces in a plane: by what they are no mere neighbours
PLANES = 1e-4  # width of the cells in which faces of one plane are looked for

Surface = tuple[Floats, Ints]  # vertices (v, 3) and faces (n, 3)


def crosses_sphere(corners: Floats, center: Floats, radius: float) -> bool:
    """Return whether a surface of triangles (n, 3, 3) has places both inside and outside of a sphere on one face."""
    low, high = corners.min(axis=1), corners.max(axis=1)
    corners = corners[np.all((low < center + radius) & (high > center - radius), axis=-1)]
    if not len(corners):
        return False
    margin = TOUCHING * (np.abs(center).max() + radius)
    farthest = np.linalg.norm(corners - center, axis=-1).max(axis=-1)
    corners = corners[farthest > radius + margin]
    return bool(np.any(triangle_distances(center, corners) < radius - margin))


def surfaces_cross(one: Surface, other: Surface) -> bool:
    """Return whether an edge of one surface runs through a face of the other; they may touch."""
    corners = [vertices[faces] for vertices, faces in (one, other)]
    if not all(map(len, corners)):
        return False
    low, high = (
        extreme([f(c, axis=(0, 1)) for c in corners], axis=0) for extreme, f in ((np.max, np.min), (np.min, np.max))
    )
    # Only faces in the box that both are in
    corners = [c[np.all((c.min(axis=1) <= high) & (c.max(axis=1) >= low), axis=-1)] for c in corners]
    return all(map(len, corners)) and faces_cross(*corners)


def faces_cross(one: Floats, other: Floats) -> bool:
    """Return whether an edge of some triangles (n, 3, 3) runs through one of others, which may be the same array."""
    margin = TOUCHING * max(np.abs(corners).max() for corners in (one, other))
    return _run_through(one, other, margin) or (one is not other and _run_through(other, one, margin))


def _run_through(one: Floats, other: Floats, margin: float) -> bool:
    """Return whether an edge of triangles (n, 3, 3) runs through one of the others."""
    places = one.reshape(-1, 3)
    corners = weld(places).reshape(-1, 3)
    ends = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1).reshape(-1, 2), axis=-1)
    # Neighbours share their edge
    first, second = np.divmod(np.unique(ends[:, 0] * len(places) + ends[:, 1]), len(places))
    start, end = places[first], places[second]
    tree, seen = box_tree(other.min(axis=1), other.max(axis=1)), 0
    for edge, face in meetings(tree, np.minimum(start, end) - margin, np.maximum(start, end) + margin):
        if _some_edge_runs_through(edge, start[edge], end[edge], other[face], margin):
            return True
        seen += len(edge)
        if seen > PAIRS:
            break
    return False


def _some_edge_runs_through(edge: Ints, start: Floats, end: Floats, faces: Floats, margin: float) -> bool:
    """Return whether, of rows of an edge and a face, an edge runs through one, or through where several meet.

    Where the faces at the place are all run through from the same side, the edge goes in or out there; where they are
    not, it passes along a ridge. An edge that lies in the plane of a face at the place touches it.
    """
    normal = cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    before, after = (np.sum((place - faces[:, 0]) * normal, axis=-1) for place in (start, end))
    through = (np.minimum(before, after) < -margin) & (np.maximum(before, after) > margin)
    if not through.any():
        return False
    flat = np.maximum(np.abs(before), np.abs(after)) <= margin
    kept = through | flat
    edge, start, end, faces, normal = (x[kept] for x in (edge, start, end, faces, normal))
    before, after, through, flat = (x[kept] for x in (before, after, through, flat))
    sides = np.roll(faces, -1, axis=1) - faces
    share = np.where(through, before, 0) / np.where(through, before - after, 1)
    place = start + share[:, None] * (end - start)
    outwards = cross(sides, np.broadcast_to(normal[:, None], sides.shape))
    outwards /= np.linalg.norm(outwards, axis=-1, keepdims=True)
    beyond = np.sum((place[:, None] - faces) * outwards, axis=-1).max(axis=-1)
    if np.any(through & (beyond < -margin)):
        return True
    # At an edge or corner of the other surface
    rim = through & (np.abs(beyond) <= margin)
    if not rim.any():
        return False
    way = np.where(after > before, 1, -1)
    count = int(edge.max()) + 1
    ways = [np.bincount(edge[rim & (way == w)], minlength=count) for w in (1, -1)]
    lying = np.bincount(edge[flat], minlength=count)
    return bool(np.any((np.maximum(*ways) >= 2) & (np.minimum(*ways) == 0) & (lying == 0)))


def coincident_pairs(corners: Floats, bodies: Ints) -> Iterator[Ints]:
    """Yield rows (m, 2) of faces of (n, 3, 3) that lie in one plane, as float32 knows it, and overlap there.

    bodies: (n,) which body each face is of; those with few faces in a plane are looked at first.
    """
    normal = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).max(axis=-1)
    doubled = np.linalg.norm(normal, axis=-1)
    normal /= doubled[:, None]
    height = doubled / longest
    facing = _unsigned(normal)
    size, middle = np.abs(corners).max(axis=(0, 1)), corners.mean(axis=1)
    offset = np.sum(facing * middle, axis=-1, keepdims=True) / size.max()
    margin, seen = ROUNDING * size, 0
    # Off the cells' borders, where planes of round numbers would lie; what a border parts, the second cells do not
    for shift in (0.37, 0.87):
        plane, shared = _shared_cells(np.concatenate([facing, offset], axis=1) / PLANES + shift)
        if not len(shared):
            continue
        low, high = corners[shared].min(axis=1), corners[shared].max(axis=1)
        inner = OVERLAP / 2 * (high - low) - margin
        low, high = (np.concatenate([x, plane[:, None]], axis=1) for x in (low + inner, high - inner))
        asked = _rarest(plane, bodies[shared])
        for a, b in meetings(box_tree(low, high), low[asked], high[asked]):
            a = asked[a]
            pairs = shared[np.stack([a, b], axis=1)[a != b]]
            pairs = np.unique(np.sort(pairs[_coincide(corners, facing, height, *pairs.T)], axis=1), axis=0)
            if len(pairs):
                yield pairs
            seen += len(a)
            if seen > PAIRS:
                return


def _rarest(plane: Floats, bodies: Ints) -> Ints:
    """Return ASKED rows at most of (m,), those first that have fewest others of their plane and body."""
    kinds = plane.astype(np.int64) * (int(bodies.max()) + 1) + bodies
    _, kind, count = np.unique(kinds, return_inverse=True, return_counts=True)
    mixed = np.random.default_rng(0).permutation(len(kinds))
    return mixed[np.argsort(count[kind[mixed]], kind="stable")[:ASKED]]


def _unsigned(normal: Floats) -> Floats:
    """Return normals (n, 3), of the two of a plane always the same one."""
    main = np.take_along_axis(normal, np.abs(normal).argmax(axis=1)[:, None], axis=1)
    return normal * np.sign(main)


def _shared_cells(rows: Floats) -> tuple[Floats, Ints]:
    """Return numbers of the unit cells that hold several of the rows (n, 4), and the rows in them, (m,) each."""
    factors = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0x27D4EB2F165667C5], np.uint64)
    # One number a cell; that two cells may have the same does not matter
    cells = np.sum(np.floor(rows).astype(np.int64).view(np.uint64) * factors, axis=1)
    _, cell, count = np.unique(cells, return_inverse=True, return_counts=True)
    shared = np.flatnonzero(count[cell] > 1)
    return cell[shared].astype(float), shared


def _coincide(corners: Floats, normal: Floats, height: Floats, a: Ints, b: Ints) -> NDArray[np.bool_]:
    """Return whether faces a and b (m,) lie in one plane to rounding, and overlap by more than neighbours do."""
    flat = np.ones(len(a), bool)
    for one, other in ((a, b), (b, a)):
        size = np.maximum(np.abs(corners[one]).max(axis=1), np.abs(corners[other]).max(axis=1))
        bound = ROUNDING * np.sum(np.abs(normal[one]) * size, axis=-1)
        off = np.sum((corners[other] - corners[one, :1]) * normal[one, None], axis=-1)
        flat &= np.abs(off).max(axis=-1) <= bound
    over = np.zeros(len(a), bool)
    a, b = a[flat], b[flat]
    least = OVERLAP * np.minimum(height[a], height[b])
    deep = np.ones(len(a), bool)
    # Two triangles of a plane are apart if a side of one parts them
    for one, other in ((a, b), (b, a)):
        sides = np.roll(corners[one], -1, axis=1) - corners[one]
        outwards = cross(sides, np.broadcast_to(normal[one, None], sides.shape))
        outwards /= np.linalg.norm(outwards, axis=-1, keepdims=True)
        inwards = np.sum((np.roll(corners[one], -2, axis=1) - corners[one]) * outwards, axis=-1)
        outwards = outwards * -np.sign(inwards)[..., None]
        reach = np.einsum("nkc,njkc->nkj", outwards, corners[other][:, :, None] - corners[one][:, None])
        deep &= np.all(-reach.min(axis=-1) > least[:, None], axis=1)
    over[flat] = deep
    return over
