"""The bounding volume hierarchy of a mesh, built on the host: which faces stand together, as integers only.

A binary tree is grown level by level, all nodes of a level at once, each split where the binned surface-area heuristic
is least (Wald, "On fast construction of SAH-based bounding volume hierarchies", 2007). It is then collapsed to eight
children a node, so that the areas of all nodes sum up to the least there is (Ylitie, Karras and Laine, "Efficient
incoherent ray traversal on GPUs through compressed wide BVHs", 2017, section 3.1).
Boxes are not kept: `boxes.py` derives them from the vertices of the moment, so that moved vertices find true boxes.
"""

import math
import time
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxrt.core.pytree import pytree, static

WIDTH = 8  # children of a node, faces of a leaf: what one vector instruction tests
BINS = 16
SAMPLE = 512  # faces of a node that its split is chosen by
# Leaves and nodes a face, of which real meshes have .125 to .137 and .025 to .029; and levels, of which they have few
LEAVES, NODES, DEPTH = 0.14, 0.03, 16
MIN_FACES = 48  # fewer are tested one by one: there random rays break even, camera rays earlier (benchmarks/meshes.py)


@pytree
class Topology:
    """A tree of nodes with eight children, integers only. Node 0 is the root."""

    children: Array  # (n, 8) int32: number of a node, or −1 − number of a leaf
    first: Array  # (n, 8) int32 first leaf below the child
    last: Array  # (n, 8) int32 one past its last; equal to `first` where there is no child
    faces: Array  # (m, 8) int32 faces of each leaf, −1 where it has fewer
    depth: int = static()  # levels of nodes at most: what a stack must hold
    packets: bool = static(default=True)  # rays that stay together walk together


class Survey(NamedTuple):
    """What `jaxrt info` tells of a mesh's tree."""

    depth: int
    nodes: int
    leaves: int
    seconds: float  # of building
    node_visits: float  # expected of a ray that meets the mesh's box, by surface area
    leaf_visits: float


class _Binary(NamedTuple):
    """Nodes of the binary tree; each owns a range of `order`."""

    left: np.ndarray  # (k,) child, −1 for a leaf; the right child follows it
    begin: np.ndarray  # (k,)
    end: np.ndarray  # (k,)
    area: np.ndarray  # (k,) half surface area of the box
    order: np.ndarray  # (f,) faces
    levels: np.ndarray  # (l + 1,) first node of each level, and k


def topology_of(vertices: np.ndarray, faces: np.ndarray, least: int = MIN_FACES) -> Topology | None:
    """Return the tree over the faces (f, 3) of vertices (v, 3), None below `least` faces, where it would not pay.

    Its arrays have room to spare, as much for each mesh of so many faces, so that one program serves them all.
    """
    if len(faces) < max(least, 1):
        return None
    return topology_of_boxes(*_boxes_of(vertices, faces))


def topology_of_boxes(low: np.ndarray, high: np.ndarray) -> Topology:
    """Return the tree over things of whatever kind, at least one, by their boxes (n, 3)."""
    tree, n = _collapse(_grow(low, high)), len(low)
    nodes, leaves = (_room(len(x), n, share) for x, share in ((tree.children, NODES), (tree.faces, LEAVES)))
    children, first, last = (_filled(x, nodes, 0) for x in (tree.children, tree.first, tree.last))
    return Topology(children, first, last, _filled(tree.faces, leaves, -1), _doubled(DEPTH, tree.depth))


def exact_topology(vertices: np.ndarray, faces: np.ndarray, least: int = MIN_FACES) -> Topology | None:
    """Return the same tree without room to spare."""
    if len(faces) < max(least, 1):
        return None
    return _collapse(_grow(*_boxes_of(vertices, faces)))


def _room(count: int, faces: int, share: float) -> int:
    """Return the rows that a tree over so many faces gets, at least `count`: more than nearly all trees need."""
    return _doubled(math.ceil(share * faces + math.sqrt(faces)), count)


def _doubled(size: int, least: int) -> int:
    """Return the size, doubled until it is no less than `least`."""
    while size < least:
        size *= 2
    return size


def _filled(rows: Array, count: int, value: int) -> Array:
    return jnp.pad(rows, ((0, count - len(rows)), (0, 0)), constant_values=value)


def survey(vertices: np.ndarray, faces: np.ndarray) -> Survey | None:
    """Return what a tree over the faces costs to build and to walk; None where the faces are tested one by one."""
    start = time.process_time()
    topology = exact_topology(vertices, faces)
    if topology is None:
        return None
    seconds = time.process_time() - start
    low, high = _boxes_of(vertices, faces)
    order = np.asarray(topology.faces).ravel()
    rows = order >= 0
    starts = np.concatenate([[0], np.cumsum(rows.reshape(-1, WIDTH).sum(1))])
    children, first, last = (np.asarray(x).ravel() for x in (topology.children, topology.first, topology.last))
    inner, leaf = children > 0, (children < 0) & (last > first)
    sides = np.concatenate([low.T, -high.T])[:, order[rows]]
    ranges = np.stack([starts[first], starts[last]], -1).ravel()  # which may overlap, or be empty: of no meaning then
    area = _area(np.minimum.reduceat(np.append(sides, sides[:, :1], 1), ranges, 1)[:, ::2])
    whole = max(_area(sides.min(1)), np.finfo(float).tiny)
    visits = [1 + area[inner].sum() / whole, area[leaf].sum() / whole]
    return Survey(topology.depth, len(topology.children), len(topology.faces), seconds, *visits)


def _boxes_of(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return least and largest coordinates (f, 3) of each face."""
    a, b, c = (np.asarray(vertices, float).take(np.asarray(faces)[:, k], 0) for k in range(3))
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)


def _area(sides: np.ndarray) -> np.ndarray:
    """Return half the surface of boxes: least x, y, z, then least −x, −y, −z, (6, …); 0 for an empty one."""
    x, y, z = np.maximum(-(sides[:3] + sides[3:]), 0)
    return x * y + y * z + z * x


def _grow(low: np.ndarray, high: np.ndarray) -> _Binary:
    """Return the binary tree. After log₂ f levels nodes are halved by number, so that the depth is at most 2 log₂ f."""
    n, origin = len(low), low.min(0)
    width, order = (high - origin).max() or 1, np.arange(n)
    # In columns, and of half the memory: nothing but the choice of splits depends on it
    sides = np.concatenate([(low - origin).T, (origin - high).T]).astype(np.float32) / np.float32(width)
    begin, end = [np.zeros(1, int)], [np.full(1, n)]
    left: list[np.ndarray] = []
    area = [_area(sides.min(1))[None]]
    nodes, level, limit = 1, 0, int(np.ceil(np.log2(n + 1))) + 2
    while len(begin[-1]):
        grown = end[-1] - begin[-1] > WIDTH
        children = np.full(len(grown), -1)
        children[grown] = nodes + 2 * np.arange(grown.sum())
        left.append(children)
        a, b = begin[-1][grown], end[-1][grown]
        size = b - a
        rows = np.repeat(a, size) + _counting(size)
        own = sides[:, rows]
        moved, cut = _split(own, size, level >= limit)
        own, order[rows] = own[:, moved], order[rows[moved]]
        sides[:, rows] = own
        begin.append(np.stack([a, a + cut], -1).ravel())
        end.append(np.stack([a + cut, b], -1).ravel())
        if len(a):
            sizes = end[-1] - begin[-1]
            area.append(_area(np.minimum.reduceat(own, np.cumsum(sizes) - sizes, 1)))
        nodes, level = nodes + 2 * len(a), level + 1
    parts = [np.concatenate(x) for x in (left, begin, end, area)]
    return _Binary(parts[0], parts[1], parts[2], parts[3].astype(float), order, np.cumsum([0, *map(len, left)]))


def _counting(size: np.ndarray) -> np.ndarray:
    """Return 0 … size−1 for each size, one after another."""
    return np.arange(size.sum()) - np.repeat(np.cumsum(size) - size, size)


def _split(sides: np.ndarray, size: np.ndarray, halve: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return (order of the rows, rows of each node that go left). Each node owns `size` columns, one after another."""
    if not len(size):
        return np.zeros(0, int), size
    node, starts = np.repeat(np.arange(len(size)), size), np.cumsum(size) - size
    middle = sides[:3] - sides[3:]
    low = np.minimum.reduceat(middle, starts, 1)
    extent = np.maximum.reduceat(middle, starts, 1) - low
    scale = np.divide(BINS, extent, out=np.zeros_like(extent), where=extent > 0)
    scale[~np.isfinite(scale)] = 0
    bins = np.minimum((middle - low[:, node]) * scale[:, node], BINS - 1).astype(np.uint8)
    axis, cut, cost = _cheapest(sides, bins, size)
    right = bins[axis[node], np.arange(len(node))] > cut[node]
    # Where all middles coincide, or too deep: halve by number along the longest axis
    stuck = np.full(len(size), True) if halve else ~np.isfinite(cost)
    if stuck.any():
        rows = np.flatnonzero(stuck[node])
        along = middle[extent.argmax(0)[node[rows]], rows]
        rank = np.empty(len(rows), int)
        rank[np.lexsort((along, node[rows]))] = _counting(size[stuck])
        right[rows] = rank >= size[node[rows]] // 2
    went: np.ndarray = np.cumsum(right) - right
    went = went - went[starts][node]  # how many of the node's earlier rows went right
    cut = size - np.add.reduceat(right.astype(int), starts)
    moved = np.empty(len(node), int)
    moved[np.where(right, (starts + cut)[node] + went, np.arange(len(node)) - went)] = np.arange(len(node))
    return moved, cut


def _cheapest(sides: np.ndarray, bins: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return (axis, last bin of the left side, cost) of each node's best split; infinite cost where there is none.

    Of a large node a sample is looked at: every so many rows of it.
    """
    nodes, every = len(size), -(-size // SAMPLE)
    node = np.repeat(np.arange(nodes), size)
    if every.max() > 1:
        seen = np.flatnonzero(_counting(size) % every[node] == 0)
        sides, bins, node = sides[:, seen], bins[:, seen], node[seen]
    best: tuple[np.ndarray, ...] = np.zeros(nodes, int), np.zeros(nodes, int), np.full(nodes, np.inf)
    for axis in range(3):
        # Rows stand node by node: a stable sort of small numbers, which NumPy does by counting, leaves that in each bin
        order = np.argsort(bins[axis], kind="stable")
        count = np.bincount(bins[axis].astype(int) * nodes + node, minlength=BINS * nodes)
        used = np.flatnonzero(count)
        boxes = np.full((6, BINS * nodes), np.inf, sides.dtype)
        boxes[:, used] = np.minimum.reduceat(sides[:, order], (np.cumsum(count) - count)[used], 1)
        cost = _split_costs(boxes.reshape(6, BINS, nodes), count.reshape(BINS, nodes) * every)
        cut = cost.argmin(0)
        least = cost[cut, np.arange(nodes)]
        better = least < best[2]
        best = tuple(np.where(better, a, b) for a, b in zip((axis, cut, least), best, strict=True))
    return best


def _split_costs(boxes: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Return the cost (15, k) of splitting after each bin: area times leaves, summed over the two sides."""
    total = np.zeros((BINS - 1, count.shape[1]))
    for side in (slice(None), slice(None, None, -1)):
        n = np.cumsum(count[side], 0)[:-1]
        area = _area(np.minimum.accumulate(boxes[:, side], 1)[:, :-1])
        # An empty side is no split
        total += np.where(n > 0, area * np.ceil(n / WIDTH), np.inf)[side]
    return total


def _collapse(tree: _Binary) -> Topology:
    """Return the tree of eight children a node."""
    leaf_nodes = np.flatnonzero(tree.left < 0)
    leaf_nodes = leaf_nodes[np.argsort(tree.begin[leaf_nodes])]
    starts = tree.begin[leaf_nodes]
    leaf_of = np.full(len(tree.left), -1)
    leaf_of[leaf_nodes] = np.arange(len(leaf_nodes))
    share, levels, frontier, nodes = _share(tree), [], np.zeros(1, int), 1
    while len(frontier):
        slots = _open(tree, share, frontier)
        inner = (slots >= 0) & (tree.left[slots] >= 0)
        children = -1 - leaf_of[slots]
        children[inner] = nodes + np.arange(inner.sum())
        children[slots < 0] = -1
        levels.append((children, slots))
        frontier, nodes = slots[inner], nodes + inner.sum()
    children, slots = (np.concatenate(x) for x in zip(*levels, strict=True))
    empty = slots < 0
    first = np.where(empty, 0, np.searchsorted(starts, tree.begin[slots]))
    last = np.where(empty, 0, np.searchsorted(starts, tree.end[slots]))
    size = tree.end[leaf_nodes] - starts
    faces = np.full((len(leaf_nodes), WIDTH), -1)
    faces[np.repeat(np.arange(len(size)), size), _counting(size)] = tree.order
    # Ascending, so that of equal distances the first slot has the smallest face
    faces = np.where(faces < 0, len(tree.order), faces)
    faces = np.sort(faces, 1)
    faces[faces == len(tree.order)] = -1
    a, b, c, d = (jnp.asarray(x, jnp.int32) for x in (children, first, last, faces))
    return Topology(a, b, c, d, depth=len(levels))


def _share(tree: _Binary) -> np.ndarray:
    """Return (k, 8): where a node may take up to j of its ancestor's slots, how many of them its left child may take.

    At [:, j - 1]; 0 where it takes one as a node, or is a leaf. At [:, 0], the share of a node's own eight slots.
    """
    # No area costs a little, too: of equal sums the one of fewest nodes
    area = tree.area / (tree.area[0] or 1) + 1e-6
    cost, share = np.zeros((len(area), WIDTH)), np.zeros((len(area), WIDTH), np.int8)
    for begin, end in zip(tree.levels[-2::-1], tree.levels[:0:-1], strict=True):
        node = begin + np.flatnonzero(tree.left[begin:end] >= 0)
        left, right = cost[tree.left[node]], cost[tree.left[node] + 1]
        ways = [left[:, :j] + right[:, j - 1 :: -1] for j in range(1, WIDTH)]
        cost[node, 0], share[node, 0] = ways[-1].min(1) + area[node], ways[-1].argmin(1) + 1
        fewer, taken = cost[node, 0], np.zeros(len(node), np.int8)
        for j, way in enumerate(ways, 1):
            taken = np.where(way.min(1) < fewer, way.argmin(1) + 1, taken)
            fewer = np.minimum(way.min(1), fewer)
            cost[node, j], share[node, j] = fewer, taken
    return share


def _open(tree: _Binary, share: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Return up to eight descendants (n, 8) of each node, −1 for none, as they share its slots."""
    slots, free = np.full((len(nodes), WIDTH), -1), np.zeros((len(nodes), WIDTH), int)
    slots[:, 0], free[:, 0] = nodes, WIDTH
    lefts = share[nodes, 0]
    row, place = np.flatnonzero(lefts), np.zeros(np.count_nonzero(lefts), int)
    lefts = lefts[row]
    while len(row):
        child, count = tree.left[slots[row, place]], free[row, place]
        slots[row, place], free[row, place] = child, lefts
        slots[row, place + lefts], free[row, place + lefts] = child + 1, count - lefts
        row, place = np.nonzero(free > 1)
        lefts = share[slots[row, place], free[row, place] - 1]
        free[row[lefts == 0], place[lefts == 0]] = 1
        row, place, lefts = (x[lefts > 0] for x in (row, place, lefts))
    return slots
