"""The tree of a mesh against one test per face: cases B1-B6. Both run jitted, on rays of all kinds."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxrt.maths import FAR
from jaxrt.shapes import survey, topology_of
from tests import meshes
from tests.searches import assert_same, padded, rays_at, search

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


@pytest.mark.parametrize("name", CASES)
def test_b_tree_finds_what_the_loop_finds(name):
    vertices, faces = CASES[name]
    vertices = vertices.astype(np.float32).astype(float)
    rng = np.random.default_rng(5)
    o, d = rays_at(rng, vertices, faces, N)
    farthest = np.where(rng.uniform(size=N) < 0.7, FAR, 10 ** rng.uniform(-2, 0.5, N) * np.ptp(vertices, axis=0).max())
    face = assert_same(padded(vertices, faces), o, d, farthest)
    assert 0.1 < (face >= 0).mean() < 0.999
    if name == "duplicates":
        assert face.max() < len(faces) // 2


def test_b1_moved_vertices_are_found_where_they_are():
    vertices, faces = meshes.icosphere(3)
    triangles, rng = padded(vertices, faces), np.random.default_rng(6)
    moved = (vertices * [1, 0.2, 3] + 0.3 * rng.normal(size=vertices.shape)).astype(np.float32)
    now = triangles.vertices.at[: len(moved)].set(moved)
    o, d = rays_at(rng, moved.astype(float), faces, N)
    assert_same(replace(triangles, vertices=now), o, d, np.full(N, FAR))


def test_b2_coincident_faces_give_the_first():
    corners = np.tile(np.float32([[-1, -1, 0], [1, -1, 0], [0, 1, 0]]), (10_000, 1, 1))
    tree = topology_of(*meshes.soup(corners))
    assert tree.depth <= 2 * np.log2(10_000) + 8
    triangles, rng = padded(*meshes.soup(corners[:1300])), np.random.default_rng(7)
    o, d = rays_at(rng, corners[0].astype(float), np.array([[0, 1, 2]]), N)
    _, face, blocked = search(triangles, o, d, np.full(N, FAR))
    _, lone, _ = search(padded(*meshes.soup(corners[:1])), o, d, np.full(N, FAR))
    assert np.array_equal(face, lone) and np.array_equal(blocked, lone == 0) and lone.max() == 0


def test_b3_depth_is_bounded():
    for mesh in (meshes.exponential(100), meshes.soup(2.0 ** -np.arange(100.0)[:, None, None] * np.eye(3))):
        assert topology_of(*mesh, least=1).depth <= 2 * np.log2(100) + 8


def test_b4_no_face_has_no_tree():
    assert topology_of(np.zeros((0, 3)), np.zeros((0, 3), int), least=0) is None


def test_b6_thin_diagonals_cost_more_visits_than_a_compact_mesh():
    """No spatial splits: 200 crossing diagonals overlap nearly everywhere; noted, with the number."""
    thin = survey(*meshes.diagonals(np.random.default_rng(4), 2000))
    compact = survey(*meshes.icosphere(4))
    assert compact.node_visits < 15 < thin.node_visits


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
