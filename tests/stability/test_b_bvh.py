"""The tree of a mesh against one test per face: cases B1-B6, X7. Both run jitted, on rays of all kinds."""

from dataclasses import replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.alternatives.counted_walk import visits
from jaxrt.core.maths import FAR
from jaxrt.shapes import survey
from jaxrt.shapes.search import walk
from jaxrt.shapes.search.bvh import exact_topology
from jaxrt.shapes.triangle import triangle_table
from tests import meshes
from tests.searches import LEAVES, NODES, assert_same, padded, rays_at, search

N = 102_400


def soup_of(seed, n):
    return meshes.soup(np.random.default_rng(seed).uniform(-1, 1, (n, 3, 3)).astype(np.float32))


def doubled(mesh):
    """Return the mesh with every face twice."""
    return mesh[0], np.concatenate([mesh[1], mesh[1]])


CASES = {
    "one": soup_of(1, 1),
    "two": soup_of(2, 2),
    "three": soup_of(3, 3),
    "icosphere": meshes.icosphere(3),
    "exponential": meshes.exponential(100),
    "coplanar": meshes.coplanar_quads(16),
    "diagonals": meshes.diagonals(np.random.default_rng(4), 200),
    "far off": (meshes.icosphere(2)[0] + 1e6, meshes.icosphere(2)[1]),
    "duplicates": doubled(meshes.icosphere(2)),
}


@cache
def slabs():
    """Return the share of missed rays, all of which start on a face of a box or run within one: the slab test."""
    low, high = np.float32([-1, -1, -1]), np.float32([1, 1, 1])
    o = np.float32([[-1, 0, 0], [1, 0, 0], [0, -1, 0.5], [0.3, 1, 0], [0, 0, 1]])
    d = np.float32([[0, 1, 0], [0, 0, -1], [1, 0, 0], [-1, 0, 0], [0, 1, 0]])

    @jax.jit
    @jax.vmap
    def hit(o, d):
        a, b = (low - o) / d, (high - o) / d
        return jnp.max(jnp.minimum(a, b)) <= jnp.min(jnp.maximum(a, b))

    return 1 - np.mean(hit(o, d))


@pytest.mark.parametrize("name", CASES)
def test_b_tree_finds_what_the_loop_finds(figures, name):
    vertices, faces = CASES[name]
    vertices = vertices.astype(np.float32).astype(float)
    rng = np.random.default_rng(5)
    o, d = rays_at(rng, vertices, faces, N)
    farthest = np.where(rng.uniform(size=N) < 0.7, FAR, 10 ** rng.uniform(-2, 0.5, N) * np.ptp(vertices, axis=0).max())
    face = assert_same(padded(vertices, faces), o, d, farthest)
    assert 0.1 < (face >= 0).mean() < 0.999
    wrong = 0  # or `assert_same` had raised
    figures(
        "B1",
        "rays of 26 directions with ±0, on faces and edges, unlike brute force",
        naive=slabs(),
        ours=wrong,
        at_most=0,
    )
    if name == "duplicates":
        figures(
            "B5", "of equal faces, hits of another than the first", ours=(face >= len(faces) // 2).mean(), at_most=0
        )


def test_b1_moved_vertices_are_found_where_they_are():
    vertices, faces = meshes.icosphere(3)
    triangles, rng = padded(vertices, faces), np.random.default_rng(6)
    moved = (vertices * [1, 0.2, 3] + 0.3 * rng.normal(size=vertices.shape)).astype(np.float32)
    now = triangles.vertices.at[: len(moved)].set(moved)
    o, d = rays_at(rng, moved.astype(float), faces, N)
    assert_same(replace(triangles, vertices=now), o, d, np.full(N, FAR))


def test_b2_coincident_faces_give_the_first(figures):
    corners = np.tile(np.float32([[-1, -1, 0], [1, -1, 0], [0, 1, 0]]), (10_000, 1, 1))
    tree = exact_topology(*meshes.soup(corners))
    limit = 2 * np.log2(10_000) + 8
    figures(
        "B2",
        "depth of a tree of 10 000 coincident faces; naive: halved in space",
        naive="does not end",
        ours=tree.depth,
        at_most=limit,
    )
    triangles, rng = padded(*meshes.soup(corners[:1300])), np.random.default_rng(7)
    o, d = rays_at(rng, corners[0].astype(float), np.array([[0, 1, 2]]), N)
    _, face, blocked = search(triangles, o, d, np.full(N, FAR))
    _, lone, _ = search(padded(*meshes.soup(corners[:1])), o, d, np.full(N, FAR))
    assert np.array_equal(face, lone) and np.array_equal(blocked, lone == 0) and lone.max() == 0


def halvings(mesh):
    """Return the depth of a tree whose boxes are cut through the middle of their longest side."""
    middles, depth = mesh[0][mesh[1]].mean(1), 0
    while len(middles) > 1:
        low, high = middles.min(0), middles.max(0)
        axis = np.argmax(high - low)
        upper = middles[:, axis] > (low + high)[axis] / 2
        middles, depth = max(middles[upper], middles[~upper], key=len), depth + 1
    return depth


def test_b3_depth_is_bounded(figures):
    for mesh in (meshes.exponential(100), meshes.soup(2.0 ** -np.arange(100.0)[:, None, None] * np.eye(3))):
        depth, bad, limit = exact_topology(*mesh, least=1).depth, halvings(mesh), 2 * np.log2(100) + 8
        figures(
            "B3", "depth of a tree of 100 faces, each half as far as the last", naive=bad, ours=depth, at_most=limit
        )


def test_b4_no_face_has_no_tree(figures):
    tree = exact_topology(np.zeros((0, 3)), np.zeros((0, 3), int), least=0)
    figures("B4", "trees made for a mesh without faces", ours=int(tree is not None), at_most=0)


def test_b6_thin_diagonals_cost_more_visits_than_a_compact_mesh(figures):
    """No spatial splits: 200 crossing diagonals overlap nearly everywhere; noted, with the number."""
    thin = survey(*meshes.diagonals(np.random.default_rng(4), 2000))
    compact = survey(*meshes.icosphere(4))
    visits = thin.node_visits / compact.node_visits
    figures("B6", "visits of boxes on crossing diagonals, per visit on a compact mesh", ours=visits, at_most=5)
    assert compact.node_visits < 10 < thin.node_visits


ADVERSE = {
    "exponential": meshes.exponential(100),
    "coincident": meshes.soup(np.tile(np.float32([[-1, -1, 0], [1, -1, 0], [0, 1, 0]]), (1300, 1, 1))),
    "diagonals": meshes.diagonals(np.random.default_rng(4), 1300),
}


@jax.jit
def steps_of(triangles, o, d, farthest, forget):
    """Return (nodes, each return counted, and leaves visited (n, 2); levels of the stack in use) of rays, in lockstep.

    forget: to which children of a node the walk has been. It then ends at twice the steps that it may take.
    """
    tree = triangle_table(triangles).tree

    def before(w):
        return w._replace(left=jnp.where(forget, walk.ALL, w.left))

    return jax.vmap(lambda *ray: visits(False, tree, *ray, before, 2 * (NODES + LEAVES)))(o, d, farthest)


@pytest.mark.parametrize("name", ADVERSE)
def test_x7_walks_end(figures, name):
    """Each visit of a node takes one of its children, or finds those left out of reach: never more visits than links.

    In lockstep, where a lane that does not end keeps all. Naive: a return to a node begins it anew, up to a limit.
    """
    vertices, faces = ADVERSE[name]
    vertices = vertices.astype(np.float32).astype(float)
    tree = exact_topology(vertices, faces, least=1)
    o, d = rays_at(np.random.default_rng(10), vertices, faces, 1024)
    arguments = padded(vertices, faces), o, d, np.full(len(o), FAR, np.float32)
    counts, levels = steps_of(*arguments, False)
    nodes, leaves = np.asarray(counts).T
    links = int(np.sum(np.asarray(tree.first) < np.asarray(tree.last)))
    assert leaves.max() > 0
    bad = steps_of(*arguments, True)[0][:, 0].max() / links if name == "coincident" else None
    what = "nodes that a ray visits or returns to, per link of an adverse tree; naive: all children each time"
    figures("X7", what, naive=bad, ours=nodes / links, at_most=1)
    figures("X7", "leaves that a ray visits, per leaf of the tree", ours=leaves / len(tree.faces), at_most=1)
    figures(
        "X7", "levels in use of a walk's stack, per level of the tree", ours=np.asarray(levels) / tree.depth, at_most=1
    )


coordinates = st.floats(-1, 1, width=16)


@settings(max_examples=25, deadline=None, derandomize=True)
@given(st.lists(st.tuples(*[st.tuples(*[coordinates] * 3)] * 3), min_size=1, max_size=24))
def test_b_any_mesh(corners):
    vertices, faces = meshes.soup(np.asarray(corners, np.float32))
    o, d = rays_at(np.random.default_rng(8), vertices.astype(float), faces, 4096)
    assert_same(padded(vertices, faces), o, d, np.full(4096, FAR))


def test_b_star_mesh_has_no_leak_through_the_tree():
    """T1 through the tree: 0 leaks of rays at edges and vertices, at three scales."""
    rng = np.random.default_rng(1)
    for scale in (1e-3, 1.0, 1e3):
        mesh = meshes.star_mesh(rng, 15, scale)
        aim = np.concatenate([meshes.aim_at_edges(rng, mesh, 51_200), meshes.aim_at_vertices(rng, mesh, 51_200)])
        o = (0.1 * scale * rng.uniform(-0.5, 0.5, aim.shape)).astype(np.float32)
        d = aim - o
        d = (d / np.linalg.norm(d, axis=1, keepdims=True)).astype(np.float32)
        _, face, blocked = search(padded(*meshes.soup(mesh)), o, d, np.full(len(o), FAR))
        assert np.all(face >= 0) and np.all(blocked)


def test_b_zero_reach_finds_nothing():
    vertices, faces = meshes.icosphere(2)
    o, d = rays_at(np.random.default_rng(9), vertices, faces, 4096)
    _, face, blocked = search(padded(vertices, faces), o, d, jnp.zeros(4096))
    assert np.all(face == -1) and not blocked.any()
