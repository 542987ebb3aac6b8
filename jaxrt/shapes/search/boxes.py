"""The boxes of a mesh's tree around its vertices of the moment, and all that a walk reads, in one array."""

import jax.numpy as jnp
from jax import Array, lax

from jaxrt.core.maths import FAR, unit_roundoff
from jaxrt.core.pytree import pytree, static
from jaxrt.shapes.search.bvh import WIDTH, Topology
from jaxrt.shapes.search.order import bits

# Words of a node: least, then largest x, y, z of eight children, padded; where the children begin,
# −1 − that for a leaf. Of a leaf: x, y, z of the first, second, third corners of eight faces, or x, y, z, radius,
# x, y, z of the base and constant of eight spheres (`SphereTable`), then nothing; their rows, −1 where there are fewer
NODE, LEAF = 7 * WIDTH, 10 * WIDTH


@pytree
class Tree:
    """A tree with its boxes, flat, as the walk reads it."""

    words: Array  # (n·NODE + m·LEAF,) the nodes, then the leaves; floats by their bits, so that a cache line has both
    low: Array  # (3,) of the box around all
    high: Array  # (3,)
    pad: Array  # () what a face's box is padded by at most
    side: Array  # () that of a leaf, as a share of the tree's: 1/√n of n leaves
    nodes: int = static()
    depth: int = static()
    wide: bool = static(default=False)  # of `Triangles`
    balls: bool = static(default=False)  # leaves hold spheres
    packets: bool = static(default=True)  # of `Topology`

    @property
    def reach(self) -> Array:
        """Return the largest side () of the box around all."""
        return jnp.max(self.high - self.low)


def tree_of(topology: Topology, corners: Array, wide: bool = False) -> Tree:
    """Return the tree around corners (f, 3, 3) where they are now. Runs once a render, in vector operations."""
    slots = topology.faces
    own = corners[jnp.where(slots < 0, slots[:, :1], slots)]  # leaf, slot, corner, coordinate
    # A place without face has a point for a face: never hit
    own = jnp.where((slots < 0)[..., None, None], own[:, :, :1], own)
    return _tree_around(topology, own.min((1, 2)), own.max((1, 2)), own.transpose(0, 3, 2, 1), wide=wide)


def ball_tree(topology: Topology, center: Array, radius: Array, base: Array, constant: Array) -> Tree:
    """Return the tree around spheres (n, …) where they are now; those that it does not name are not in it."""
    slots = topology.faces
    first = jnp.where(slots[:, :1] < 0, slots[0, 0], slots[:, :1])
    rows, empty = jnp.where(slots < 0, first, slots), slots < 0
    # A place without sphere has one of no size: never hit
    middle, size = center[rows].transpose(0, 2, 1), jnp.where(empty, 0, radius[rows])[:, None]
    origin = jnp.where(empty[:, None], middle, base[rows].transpose(0, 2, 1))
    offset = jnp.where(empty, 0, constant[rows])[:, None]
    numbers = jnp.concatenate([middle, size, origin, offset, jnp.zeros_like(size)], 1)
    return _tree_around(topology, (middle - size).min(2), (middle + size).max(2), numbers, balls=True)


def _tree_around(
    topology: Topology, low: Array, high: Array, numbers: Array, wide: bool = False, balls: bool = False
) -> Tree:
    """Return the tree of leaves with these boxes (m, 3) and numbers (m, …, 8)."""
    pad = 32 * unit_roundoff(low) * jnp.maximum(jnp.abs(low), jnp.abs(high)).max(1, keepdims=True)
    low, high = low - pad, high + pad
    first, last = topology.first, topology.last
    lows = _least_of_ranges(low, first, last)
    highs = -_least_of_ranges(-high, first, last)
    none = (first == last)[..., None]
    boxes = jnp.concatenate([jnp.where(none, FAR, lows), jnp.where(none, -FAR, highs)], -1)
    children, size = topology.children, topology.children.shape[0] * NODE
    children = jnp.where(children < 0, -1 - size - (-1 - children) * LEAF, children * NODE)
    nodes = _words(boxes.swapaxes(1, 2), children)
    return Tree(
        words=jnp.concatenate([nodes, _words(numbers, topology.faces)]),
        low=low.min(0),
        high=high.max(0),
        pad=pad.max(),
        side=lax.rsqrt(last[0].max().astype(low.dtype)),
        nodes=topology.children.shape[0],
        depth=topology.depth,
        wide=wide,
        balls=balls,
        packets=topology.packets,
    )


def _words(numbers: Array, links: Array) -> Array:
    words = bits(numbers.reshape(len(links), -1))
    return jnp.concatenate([words, links.astype(words.dtype)], 1).ravel()


def _least_of_ranges(rows: Array, first: Array, last: Array) -> Array:
    """Return the least (n, 8, 3) over ranges of rows (m, 3): of two overlapping ranges of 2ᵏ rows each."""
    tables, count = [rows], rows.shape[0]
    while 2 ** len(tables) <= count:
        step = 2 ** (len(tables) - 1)
        shifted = jnp.concatenate([tables[-1][step:], jnp.broadcast_to(rows[-1:], (step, 3))])
        tables.append(jnp.minimum(tables[-1], shifted))
    table = jnp.concatenate(tables)
    k = 31 - lax.clz(jnp.maximum(last - first, 1))
    return jnp.minimum(table[k * count + first], table[k * count + jnp.maximum(last - (1 << k), 0)])
