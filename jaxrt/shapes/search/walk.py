"""A walk through the tree of a mesh, and how one ray makes it: nearest hit and any hit.

A node's eight boxes are tested at once, then a leaf's eight faces. The stack holds, for each level at most, a node and
which of its children are still to be visited: their boxes are tested again when their turn comes. That is cheaper than
to keep their distances, nothing is ever sorted, what has come to lie behind a hit is left out, and the stack cannot
overflow.

Of equally distant faces the one of the smallest number is hit. A ray alone meets a face only inside the face's own box,
padded: what only the error bound of the edge test calls a hit, beyond the tip of a sliver, is not. (A packet that tests
the faces that its hull meets may take such a hit.)
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array, lax

from jaxrt.core.maths import unit_roundoff
from jaxrt.kernels.gather import part, put
from jaxrt.kernels.native import once
from jaxrt.shapes.edges import along_axis, hit_distance, main_axis, shear, slopes_along
from jaxrt.shapes.roots import root_distance
from jaxrt.shapes.search.boxes import LEAF, NODE, Tree
from jaxrt.shapes.search.bvh import WIDTH
from jaxrt.shapes.search.order import bits, floats, least, least_of_eight, most

TINY = 1e-20  # least size of a direction component, for its reciprocal alone
NONE = -(2**31)  # no node
ALL = 2**WIDTH - 1  # children of a node, as bits
RAY = 12  # numbers of a ray's row
Rows = Sequence[Array] | Array


def node_at(tree: Tree, code: Array) -> Array:
    """Return where a node's words begin. Within bounds, which saves testing each read; unsigned, which saves half."""
    return jnp.minimum(code.astype(jnp.uint32), jnp.uint32((tree.nodes - 1) * NODE))


def leaf_at(tree: Tree, code: Array) -> Array:
    """Return where a leaf's words begin."""
    return jnp.minimum((-1 - code).astype(jnp.uint32), jnp.uint32(tree.words.shape[0] - LEAF))


def face_of(tree: Tree, leaf: Array, slot: Array) -> Array:
    """Return the face in a slot of a leaf."""
    return part(tree.words, leaf_at(tree, leaf) + 72 + (slot & 7).astype(jnp.uint32), 1)[0].astype(jnp.int32)


class State(NamedTuple):
    """A walk under way. Lanes: () for one ray, (n,) for a packet."""

    top: Array  # () int32 level of the stack in use, −1 when it is empty
    # Of each level a node, and its children still to be visited as bits; one level more, to be written in vain
    stack: Array  # (2·depth + 2,) int32
    code: Array  # () int32 what to visit now: a node, a leaf (negative), or NONE
    left: Array  # () int32 children of the node still to be visited
    box: Array  # () uint32 where its box is among the words of its parent
    farthest: Array  # (lanes) distance of the nearest hit so far
    face: Array  # (lanes) int32 face hit, −1 for none


def walk(tree: Tree, boxes: Callable, leaf: Callable, farthest: Array) -> tuple[Array, Array]:
    """Return (farthest, face) of the lanes after a walk from the root.

    boxes(at) gives, of the node whose words begin there, where its children are entered, and whether they are met.
    leaf(code, box, farthest, face) gives the last two anew, box being where its box is among the words. A lane whose
    farthest becomes −1 is done; its face is then 0.
    """

    def step(w: State) -> State:
        w = lax.while_loop(at_node, lambda w: descend(tree, boxes, w), w)
        w = lax.while_loop(at_leaf, lambda w: visit(leaf, w), w)
        return pop(w)

    return found(lax.while_loop(going, step, start(tree, farthest)), farthest)


def found(end: State, farthest: Array) -> tuple[Array, Array]:
    """Return (farthest, face) of the lanes of a walk that has ended. farthest: what it began with."""
    return end.farthest, jnp.where((farthest >= 0) & (end.farthest < 0), 0, end.face)


def start(tree: Tree, farthest: Array) -> State:
    """Return the walk that is to begin at the root."""
    return State(
        top=jnp.int32(-1),
        stack=jnp.zeros(2 * tree.depth + 2, jnp.int32),
        code=jnp.int32(0),
        left=jnp.int32(ALL),
        box=jnp.uint32(0),
        farthest=farthest,
        face=jnp.full(farthest.shape, -1, jnp.int32),
    )


def at_node(w: State) -> Array:
    """Return whether a node is to be visited now."""
    return w.code >= 0


def at_leaf(w: State) -> Array:
    """Return whether a leaf is to be visited now."""
    return (w.code < 0) & (w.code != NONE)


def going(w: State) -> Array:
    """Return whether anything is left to be visited."""
    return ((w.top >= 0) | (w.code != NONE)) & (_limit(w) >= 0)


def _limit(w: State) -> Array:
    """Return the largest distance that can still matter."""
    return floats(jnp.max(bits(w.farthest)))


def descend(tree: Tree, boxes: Callable, w: State) -> State:
    """Return the walk gone on to the nearest child of a node."""
    slot, met, at = once(partial(_nearest_child, tree, boxes))(w.code, w.left, _limit(w))
    rest = met & ~(1 << slot)
    # Here `at` and not w.code, which would then be copied
    stack = put(w.stack, jnp.stack([at.astype(jnp.int32), rest]), 2 * w.top + 2)
    box = at + slot.astype(jnp.uint32)
    child = part(tree.words, box + 48, 1)[0].astype(jnp.int32)
    code = jnp.where(met != 0, child, NONE)
    return w._replace(top=w.top + (rest != 0).astype(jnp.int32), stack=stack, code=code, left=jnp.int32(ALL), box=box)


def _nearest_child(tree: Tree, boxes: Callable, code: Array, left: Array, limit: Array) -> tuple[Array, Array, Array]:
    """Return (slot of the child that is entered first, those met as bits, where the node's words begin)."""
    at = node_at(tree, code)
    near, met = boxes(at)
    lane = lax.iota(jnp.int32, WIDTH)
    met &= (near <= limit * (1 + 8 * unit_roundoff(limit))) & ((left >> lane) & 1 == 1)
    words = bits(near)
    key = jnp.where(met, (words & ~7) | lane.astype(words.dtype), jnp.iinfo(words.dtype).max)

    # Both at once, in the loop that tests the boxes: it is then vectorised to the end
    def both(a: tuple[Array, Array], b: tuple[Array, Array]) -> tuple[Array, Array]:
        return least(a[0], b[0]), a[1] | b[1]

    found = jnp.where(met, 1 << lane, 0)
    first, all_ = lax.reduce((key, found), (jnp.iinfo(key.dtype).max, jnp.int32(0)), both, (0,))
    return (first & 7).astype(jnp.int32), all_, at


def visit(leaf: Callable, w: State) -> State:
    """Return the walk after a leaf."""
    farthest, face = leaf(w.code, w.box, w.farthest, w.face)
    return w._replace(code=jnp.int32(NONE), farthest=farthest, face=face)


def pop(w: State) -> State:
    """Return the walk gone back to the last node of which children are left."""
    top = 2 * jnp.maximum(w.top, 0)
    node, left = once(lambda stack, top: (part(stack, top, 1)[0], part(stack, top + 1, 1)[0]))(w.stack, top)
    return w._replace(top=w.top - 1, code=jnp.where(w.top >= 0, node, NONE), left=left)


def nonzero(d: Array) -> Array:
    """Return components of directions, those too small to have a reciprocal replaced."""
    return jnp.where(jnp.abs(d) < TINY, jnp.where(d < 0, -TINY, TINY), d)


def places_of(axis: Array) -> list[Array]:
    """Return where a leaf has the x, y and z of a ray that goes along `axis`, uint32 each."""
    return [24 * jnp.where(axis + k > 2, axis + k - 3, axis + k).astype(jnp.uint32) for k in (1, 2, 0)]


def ray_rows(balls: bool, o: Array, d: Array) -> tuple[Array, Array]:
    """Return what a walk reads of rays (3, …): numbers (…, 12) and `places_of` their axes (…, 3)."""
    axis = main_axis(d)
    own = [*o, *d] if balls else [*along_axis(axis, o), *slopes_along(axis, d)]
    return jnp.stack([*o, *(1 / nonzero(d)), *own], -1), jnp.stack(places_of(axis), -1)


def slabs(low: Rows, high: Rows, origin: Rows, inverse: Rows) -> tuple[Array, Array]:
    """Return where rays enter and leave boxes, by coordinate (x, y, z) of whatever shapes; none enters before 0.

    inverse: reciprocals of the directions. Both ends of each slab count, whichever comes first: in that many
    instructions the loop over boxes is vectorised.
    """
    a, b = ([(x - o) * i for x, o, i in zip(end, origin, inverse, strict=True)] for end in (low, high))
    near, far = ([f(p, q) for p, q in zip(a, b, strict=True)] for f in (least, most))
    return most(most(near[0], near[1]), most(near[2], 0)), least(least(far[0], far[1]), far[2])


def walk_alone(any_hit: bool, tree: Tree, ray: Array, places: Array, farthest: Array) -> tuple[Array, Array]:
    """Return (distance, face) of one ray, of its row and places; face 0, and distance −1, for any hit."""
    return walk(tree, *tests_of(any_hit, tree, ray, places), farthest)


def tests_of(any_hit: bool, tree: Tree, ray: Rows, places: Rows) -> tuple[Callable, Callable]:
    """Return `boxes` and `leaf` of one ray, of its row and places, as `walk` wants them."""
    u = unit_roundoff(tree.low)

    def boxes(at: Array) -> tuple[Array, Array]:
        sides = [floats(part(tree.words, at + 8 * k, WIDTH)) for k in range(6)]
        enter, leave = slabs(sides[:3], sides[3:], [ray[k] for k in range(3)], [ray[k] for k in range(3, 6)])
        return enter, (enter <= leave * (1 + 8 * u)) & (sides[0] <= sides[3])

    def distances(code: Array) -> Array:
        return leaf_distances(tree, code, [places[k] for k in range(3)], [ray[k] for k in range(6, 12)])

    def leaf(code: Array, _: Array, farthest: Array, face: Array) -> tuple[Array, Array]:
        return closest(any_hit, tree, code, once(distances)(code), farthest, face)

    return boxes, leaf


def leaf_distances(tree: Tree, leaf: Array, places: list[Array], ray: Rows, slot: Array | None = None) -> Array:
    """Return the distances of a leaf's eight faces from one ray, or of one face in a slot from many.

    ray: origin and slopes along its axis, of spheres origin and direction; () or (1,) each, or (lanes,).
    """
    at, size = leaf_at(tree, leaf), WIDTH
    if slot is not None:
        at, size = at + (slot & 7).astype(jnp.uint32), 1
    if tree.balls:
        numbers = [floats(part(tree.words, at + 8 * k, size)) for k in range(8)]
        center, base = numbers[:3], numbers[4:7]
        shift = [c - b for c, b in zip(center, base, strict=True)]
        return root_distance((center, numbers[3], base, shift, numbers[7]), ray[:3], ray[3:])
    corners = [
        [floats(part(tree.words, at + (places[k] & 56) + 8 * c, size)) - ray[k] for k in range(3)] for c in range(3)
    ]
    return hit_distance([shear(x, y, z, *ray[3:], wide=tree.wide) for x, y, z in corners])


def leaf_boxes(tree: Tree, leaf: Array, places: list[Array]) -> list[Array]:
    """Return least and largest numbers of a leaf's faces along the axes that `places` names, (8,) each."""
    at, sides = leaf_at(tree, leaf), []
    for k in places:
        if tree.balls:
            middle, radius = (floats(part(tree.words, at + row, WIDTH)) for row in (k // 3 & 24, 24))
            sides += [middle - radius, middle + radius]
        else:
            a, b, c = (floats(part(tree.words, at + (k & 56) + 8 * corner, WIDTH)) for corner in range(3))
            sides += [least(least(a, b), c), most(most(a, b), c)]
    return sides


def closest(any_hit: bool, tree: Tree, leaf: Array, t: Array, farthest: Array, face: Array) -> tuple[Array, Array]:
    """Return (farthest, face) of one ray after a leaf whose faces are at distances t (8,)."""
    nearest = least_of_eight(bits(t))
    distance = floats(nearest)
    if any_hit:
        return jnp.where(distance < farthest, -1, farthest), face
    faces = part(tree.words, leaf_at(tree, leaf) + 72, WIDTH).astype(jnp.int32)
    first = least_of_eight(jnp.where(bits(t) == nearest, faces, jnp.iinfo(jnp.int32).max))
    closer = (distance < farthest) | ((distance == farthest) & (first < face))
    return jnp.where(closer, distance, farthest), jnp.where(closer, first, face)
