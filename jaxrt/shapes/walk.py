"""A walk through the tree of a mesh, and how one ray makes it: nearest hit and any hit.

A node's eight boxes are tested at once, then a leaf's eight faces. The stack holds one row of eight keys for each
level: where the child's box is entered, as the bits of a float with the child's number in the last three. The least key
is the next child to visit, so that nothing is ever sorted, and the stack cannot overflow.

Of equally distant faces the one of the smallest number is hit. A ray alone meets a face only inside the face's own box,
padded: what only the error bound of the edge test calls a hit, beyond the tip of a sliver, is not. (A packet that tests
the faces that its hull meets may take such a hit.)
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array, lax

from jaxrt.maths import unit_roundoff
from jaxrt.native import once
from jaxrt.shapes.boxes import LEAF, NODE, Tree
from jaxrt.shapes.bvh import WIDTH
from jaxrt.shapes.edges import along_axis, hit_distance, main_axis, shear
from jaxrt.shapes.order import bits, floats, least, least_of_eight, most

TINY = 1e-20  # least size of a direction component, for its reciprocal alone
NONE = -(2**31)  # no node
RAY = 12  # numbers of a ray's row


def part(flat: Array, start: Array, size: int = WIDTH) -> Array:
    """Return a part of a flat array; `start` is no less than 0."""
    return lax.dynamic_slice(flat, (start,), (size,), allow_negative_indices=False)


def node_at(tree: Tree, node: Array) -> Array:
    """Return where a node's words begin. Within bounds, which saves testing each read."""
    return jnp.clip(node * NODE, 0, tree.words.shape[0] - NODE)


def leaf_at(tree: Tree, leaf: Array) -> Array:
    """Return where a leaf's words begin."""
    return jnp.clip(tree.nodes * NODE + leaf * LEAF, 0, tree.words.shape[0] - LEAF)


def face_of(tree: Tree, leaf: Array, slot: Array) -> Array:
    """Return the face in a slot of a leaf."""
    return part(tree.words, leaf_at(tree, leaf) + 72 + (slot & 7), 1)[0].astype(jnp.int32)


def keys(near: Array, hit: Array) -> Array:
    """Return the eight keys of a node's children: by distance, then number; the largest integer where missed."""
    words = bits(near)
    return jnp.where(hit, (words & ~7) | lax.iota(words.dtype, WIDTH), jnp.iinfo(words.dtype).max)


class _State(NamedTuple):
    """A walk under way. Lanes: () for one ray, (n,) for a packet."""

    top: Array  # () int32 row of the stack in use, −1 when it is empty
    rows: Array  # (depth·8,) keys
    nodes: Array  # (depth,) int32 node that each row belongs to
    code: Array  # () int32 what to visit now: a node, −1 − a leaf, or NONE
    box: Array  # () int32 where its box is among the words of its parent
    farthest: Array  # (lanes) distance of the nearest hit so far
    face: Array  # (lanes) int32 face hit, −1 for none


def walk(tree: Tree, keys_of: Callable, leaf: Callable, farthest: Array) -> tuple[Array, Array]:
    """Return (farthest, face) of the lanes after a walk from the root.

    keys_of(node) gives eight keys; leaf(number, box, farthest, face) gives the last two anew, box being where its box
    is among the words. A lane whose farthest becomes −1 is done; its face is then 0.
    """
    word = tree.words.dtype
    start = _State(
        top=jnp.int32(-1),
        rows=jnp.full(tree.depth * WIDTH, jnp.iinfo(word).max, word),
        nodes=jnp.zeros(tree.depth, jnp.int32),
        code=jnp.int32(0),
        box=jnp.int32(0),
        farthest=farthest,
        face=jnp.full(farthest.shape, -1, jnp.int32),
    )

    def visit(w: _State) -> _State:
        farthest, face = leaf(-1 - w.code, w.box, w.farthest, w.face)
        return w._replace(code=jnp.int32(NONE), farthest=farthest, face=face)

    def step(w: _State) -> _State:
        w = lax.while_loop(lambda w: w.code >= 0, lambda w: _descend(tree, keys_of, w), w)
        w = lax.while_loop(lambda w: (w.code < 0) & (w.code != NONE), visit, w)
        return _pop(tree, w)

    def going(w: _State) -> Array:
        return ((w.top >= 0) | (w.code != NONE)) & (_limit(w) >= 0)

    end = lax.while_loop(going, step, start)
    return end.farthest, jnp.where((farthest >= 0) & (end.farthest < 0), 0, end.face)


def _limit(w: _State) -> Array:
    """Return the largest key that can still matter."""
    return jnp.max(bits(w.farthest)) | 7


def _pick(tree: Tree, node: Array, row: Array, limit: Array) -> tuple[Array, Array, Array, Array]:
    """Return (child of the least key, where its box is, how many of the row can be met, row without the child)."""
    key = least_of_eight(row)
    box = node_at(tree, node) + (key & 7).astype(jnp.int32)
    child = part(tree.words, box + 48, 1)[0].astype(jnp.int32)
    rest = jnp.where(row == key, jnp.iinfo(row.dtype).max, row)
    return jnp.where(key <= limit, child, NONE), box, jnp.sum(row <= limit, dtype=jnp.int32), rest


def put(all_: Array, row: Array, start: Array) -> Array:
    """Return a flat array with a part replaced; `start` is no less than 0."""
    return lax.dynamic_update_slice(all_, row, (start,), allow_negative_indices=False)


def _descend(tree: Tree, keys_of: Callable, w: _State) -> _State:
    row = once(keys_of)(w.code)
    code, box, count, rest = _pick(tree, w.code, row, _limit(w))
    top = w.top + 1
    rows, nodes = put(w.rows, rest, top * WIDTH), put(w.nodes, w.code[None], top)
    # A row of one child need not be kept
    return w._replace(top=jnp.where(count > 1, top, w.top), rows=rows, nodes=nodes, code=code, box=box)


def _pop(tree: Tree, w: _State) -> _State:
    top = jnp.maximum(w.top, 0)
    row, node = once(lambda rows, nodes, top: (part(rows, top * WIDTH), part(nodes, top, 1)[0]))(w.rows, w.nodes, top)
    code, box, count, rest = _pick(tree, node, row, _limit(w))
    code = jnp.where(w.top >= 0, code, NONE)
    rows = put(w.rows, rest, top * WIDTH)
    return w._replace(top=jnp.where(count > 1, w.top, w.top - 1), rows=rows, code=code, box=box)


def nonzero(d: Array) -> Array:
    """Return components of directions, those too small to have a reciprocal replaced."""
    return jnp.where(jnp.abs(d) < TINY, jnp.where(d < 0, -TINY, TINY), d)


def ray_rows(o: Array, d: Array) -> tuple[Array, Array]:
    """Return what a walk reads of rays (3, …): numbers (…, 12) and, int32, where a leaf has its x, y and z (…, 3)."""
    axis = main_axis(d)
    dx, dy, dz = along_axis(axis, d)
    row = jnp.stack([*o, *(1 / nonzero(d)), *along_axis(axis, o), dx / dz, dy / dz, 1 / dz], -1)
    return row, jnp.stack([24 * jnp.where(axis + k > 2, axis + k - 3, axis + k) for k in (1, 2, 0)], -1)


def walk_alone(any_hit: bool, tree: Tree, ray: Array, places: Array, farthest: Array) -> tuple[Array, Array]:
    """Return (distance, face) of one ray, of its row and places; face 0, and distance −1, for any hit."""
    u = unit_roundoff(ray)

    def keys_of(node: Array) -> Array:
        at = node_at(tree, node)
        sides = [floats(part(tree.words, at + 8 * k)) for k in range(6)]
        # Both ends of each slab, whichever comes first: in that many instructions the loop over boxes is vectorised
        a, b = ([(side - ray[k]) * ray[3 + k] for k, side in enumerate(half)] for half in (sides[:3], sides[3:]))
        near, far = ([f(p, q) for p, q in zip(a, b, strict=True)] for f in (least, most))
        enter = most(most(near[0], near[1]), most(near[2], 0))
        leave = least(least(far[0], far[1]), far[2]) * (1 + 8 * u)
        return keys(enter, (enter <= leave) & (sides[0] <= sides[3]))

    def distances(number: Array) -> Array:
        return leaf_distances(tree, number, [places[k] for k in range(3)], [ray[k] for k in range(6, 12)])

    def leaf(number: Array, _: Array, farthest: Array, face: Array) -> tuple[Array, Array]:
        return closest(any_hit, tree, number, once(distances)(number), farthest, face)

    return walk(tree, keys_of, leaf, farthest)


def leaf_distances(tree: Tree, leaf: Array, places: list[Array], ray: list[Array]) -> Array:
    """Return the distances (8,) of a leaf's faces from one ray: origin and slopes along its axis, () or (1,) each."""
    at = leaf_at(tree, leaf)
    corners = [[floats(part(tree.words, at + (places[k] & 56) + 8 * c)) - ray[k] for k in range(3)] for c in range(3)]
    return hit_distance([shear(x, y, z, *ray[3:]) for x, y, z in corners])


def closest(any_hit: bool, tree: Tree, leaf: Array, t: Array, farthest: Array, face: Array) -> tuple[Array, Array]:
    """Return (farthest, face) of one ray after a leaf whose faces are at distances t (8,)."""
    nearest = least_of_eight(bits(t))
    distance = floats(nearest)
    if any_hit:
        return jnp.where(distance < farthest, -1, farthest), face
    faces = part(tree.words, leaf_at(tree, leaf) + 72).astype(jnp.int32)
    first = least_of_eight(jnp.where(bits(t) == nearest, faces, jnp.iinfo(jnp.int32).max))
    closer = (distance < farthest) | ((distance == farthest) & (first < face))
    return jnp.where(closer, distance, farthest), jnp.where(closer, first, face)
