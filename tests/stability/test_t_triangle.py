"""Ray and triangle: cases T1-T5 and T8. Where a naive method exists, its failure is asserted."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

import jaxrt
from jaxrt.core.maths import FAR
from jaxrt.core.records import Ray
from jaxrt.shapes.edges import hit_distance
from jaxrt.shapes.triangle import (
    Triangles,
    corner_table,
    find_triangle,
    sheared,
    sight_of,
    triangle_surface_point,
    triangle_table,
)
from tests.lanes import lanes
from tests.meshes import aim_at_edges, aim_at_vertices, icosphere, star_mesh
from tests.oracle import directions, dot, triangle_distances, unit_vectors
from tests.stability import naive

U = 2.0**-24


def one_ray(corners, o, d):
    """Return (distance, row, surface point); corners: (m, 3, 3)."""
    table, ray = corner_table(corners, jnp.zeros(corners.shape[0], jnp.int32)), Ray(o, d)
    t, i = find_triangle(table, ray, jnp.full((), FAR))
    return t, i, triangle_surface_point(table, ray, jnp.maximum(i, 0))


trace = lanes(one_ray)  # one triangle per lane, or a few
moller_trumbore = lanes(naive.moller_trumbore)
with_epsilon = lanes(lambda o, d, corners: naive.moller_trumbore(o, d, corners, 1e-4))


def rows_of(mesh):
    """Return the function (o, d) -> row of the triangle hit in a mesh (m, 3, 3) that all lanes share."""
    table = corner_table(jnp.asarray(mesh), jnp.zeros(len(mesh), jnp.int32))
    return lanes(lambda o, d: find_triangle(table, Ray(o, d), jnp.full((), FAR))[1])


def test_t1_closed_mesh_has_no_leak(figures):
    rng = np.random.default_rng(1)
    mesh = star_mesh(rng, 15)
    aims = [aim_at_edges(rng, mesh, 50_000), aim_at_vertices(rng, mesh, 40_000), unit_vectors(rng, 10_000)]
    aim = np.concatenate(aims)
    o = (0.1 * unit_vectors(rng, len(aim))).astype(np.float32)
    d = directions(o, aim)
    leaks = np.mean(rows_of(mesh)(o, d) < 0)
    assert len(mesh) >= 400
    nearest = np.full(3000, FAR)
    for corners in mesh:
        nearest = np.minimum(nearest, moller_trumbore(o[:3000], d[:3000], np.tile(corners, (3000, 1, 1))))
    bad = np.mean(nearest == FAR)
    assert bad > 0.02
    figures(
        "T1",
        "share of 1e5 rays that leak through a closed mesh; naive: Möller-Trumbore",
        naive=bad,
        ours=leaks,
        at_most=0,
    )


def test_t1_naive_epsilon_loses_a_small_mesh(figures):
    rng = np.random.default_rng(1)
    corners = 1e-3 * star_mesh(rng, 15)
    o, d = np.zeros((len(corners), 3), np.float32), directions(0, corners.mean(1))
    bad, lost = np.mean(with_epsilon(o, d, corners) == FAR), np.mean(trace(corners[:, None], o, d)[1] != 0)
    assert bad == 1
    figures(
        "T1", "share of hits lost on a mesh of size 1e-3; naive: determinants > 1e-4", naive=bad, ours=lost, at_most=0
    )


def test_t1_scaling_by_powers_of_two_changes_no_hit(figures):
    rng = np.random.default_rng(1)
    n = 2000
    corners = rng.uniform(-1, 1, (n, 4, 3, 3)).astype(np.float32)
    o = rng.uniform(-1, 1, (n, 3)).astype(np.float32)
    d = directions(o, corners[:, 0].mean(1))
    t, row, _ = trace(corners, o, d)
    naive_hit, changed, bad = with_epsilon(o, d, corners[:, 0]) < FAR, [], []
    for k in range(-20, 21):
        scale = np.float32(2.0**k)
        scaled_t, scaled_row, _ = trace(corners * scale, o * scale, d)
        changed.append(np.mean((scaled_row != row) | ((scaled_t != t * scale) & (row >= 0))))
        bad.append(np.mean((with_epsilon(o * scale, d, corners[:, 0] * scale) < FAR) != naive_hit))
    figures("T1", "share of hits that scaling by 2^-20 to 2^20 changes", naive=bad, ours=changed, at_most=0)


def bad_triangles():
    """Return a needle, a point, a needle far off, all without area, and one seen edge-on along z."""
    return np.float32(
        [
            [[0, 0, 1], [0, 1, 1], [0, 0.25, 1]],
            [[0.1, 0.2, 0.3]] * 3,
            [[-1017.3, -81.2, -53.7], [-1017.3, -90.4, -53.7], [-1017.3, -83.9, -53.7]],
            [[0, 0, 1], [0, 0, 2], [0, 1, 2]],
        ]
    )


def test_t2_degenerate_triangles_change_nothing(figures):
    rng, n = np.random.default_rng(2), 40_000
    good = rng.uniform(-1, 1, (2, 3, 3)).astype(np.float32)
    bad = np.concatenate([bad_triangles()[:3], good])
    o = rng.uniform(-2, 2, (n, 3)).astype(np.float32)
    d = directions(o, rng.uniform(-1, 1, (n, 3)))
    # Rays at the needles, and in the plane of the one that has area
    weights = rng.dirichlet([1, 1, 1], n // 4)[:, :, None]
    for k, target in enumerate(bad[:3]):
        rows = slice(k * n // 4, (k + 1) * n // 4)
        d[rows] = directions(o[rows], (weights * target).sum(1))
    vertices = bad.reshape(-1, 3)
    faces = jnp.arange(len(vertices), dtype=jnp.int32).reshape(-1, 3)
    bad = np.asarray(triangle_table(Triangles(vertices, faces, faces[:, 0])).corners)
    assert np.array_equal(bad[3:], good)
    t, row, point = trace(np.tile(good, (n, 1, 1, 1)), o, d)
    bad_t, bad_row, bad_point = trace(np.tile(bad, (n, 1, 1, 1)), o, d)
    assert np.array_equal(bad_point.position[row >= 0], point.position[row >= 0])
    changed = np.mean((bad_t != t) | (bad_row != np.where(row >= 0, row + 3, row)))
    figures("T2", "share of hits that triangles without area change", ours=changed, at_most=0)


def test_t2_derivatives_of_triangles_without_area(figures):
    """Of the distance in the corners, the ray in the plane or through the point; naive: a determinant of 0 divides."""
    corners = bad_triangles()
    o, d = np.zeros((4, 3), np.float32), directions(np.zeros(3), corners.mean(1))

    def ours(o, d, corners):
        return one_ray(corners[None], o, d)[2].position

    def missed(o, d, corners):
        return jnp.where(naive.moller_trumbore(o, d, corners) < FAR, naive.moller_trumbore(o, d, corners), 0)

    slopes = (lanes(jax.jacrev(f, argnums=2), packet=4)(o, d, corners) for f in (ours, missed))
    wrong, bad = (np.count_nonzero(~np.isfinite(x)) for x in slopes)
    figures("T2", "derivatives not finite of what meets triangles without area", naive=bad, ours=wrong, at_most=0)


def test_t2_triangle_seen_edge_on_is_missed(figures):
    rng, n = np.random.default_rng(2), 1000
    edge_on = np.tile(bad_triangles()[3:], (n, 1, 1, 1))
    o = np.stack([np.zeros(n), rng.uniform(-0.5, 1.5, n), np.zeros(n)], 1).astype(np.float32)
    t, row, point = trace(edge_on, o, np.tile(np.float32([0, 0, 1]), (n, 1)))
    assert np.all(t == np.float32(FAR)) and np.isfinite(point.position).all()
    figures("T2", "hits of a triangle seen edge-on, of 1000 rays", ours=np.sum(row >= 0), at_most=0)


def slivers(rng, n, aspect):
    """Return triangles (n, 3, 3) of length 1 and width `aspect`, and their unit normals."""
    a, along = rng.uniform(-1, 1, (n, 3)), unit_vectors(rng, n)
    across = np.cross(along, unit_vectors(rng, n))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    apex = a + along * rng.uniform(0.2, 0.8, (n, 1)) + aspect * across
    return np.stack([a, a + along, apex], 1).astype(np.float32), np.cross(along, across)


@pytest.mark.parametrize("aspect", [1e-2, 1e-4, 1e-6])
def test_t3_slivers_are_hit(figures, aspect):
    """Rays at least 5 % of the width inside, 30° off grazing: rounding of the ray itself stays below that."""
    rng, n = np.random.default_rng(3), 40_000
    corners, normal = slivers(rng, n, aspect)
    aim = (corners * (0.05 + 0.85 * rng.dirichlet([1, 1, 1], n))[:, :, None]).sum(1)
    d = unit_vectors(rng, n)
    d = d + normal * np.sign(dot(d, normal))[:, None]
    o = (aim - d / np.linalg.norm(d, axis=1, keepdims=True)).astype(np.float32)
    d = directions(o, aim)
    truth, _ = triangle_distances(o, d, corners)
    t, row, point = trace(corners[:, None], o, d)
    hit = np.isfinite(truth)
    assert hit.mean() > 0.999
    bad = (moller_trumbore(o, d, corners)[hit] < FAR).mean() if aspect == 1e-6 else None
    figures(
        "T3",
        "share of rays inside slivers of width 1e-2 to 1e-6 that hit",
        naive=bad,
        ours=(row[hit] >= 0).mean(),
        at_least=0.999,
    )
    # Beside the ray by the bound of an edge function, 4u · 2 · 2, over the area seen, aspect / 2
    p = point.position - o.astype(float)
    beside = np.linalg.norm(p - d * dot(p, d.astype(float))[:, None], axis=1)
    assert beside[row >= 0].max() <= 32 * U / aspect


@pytest.mark.parametrize("aspect", [None, 1e-2, 1e-4, 1e-6])
def test_t4_hits_stay_in_the_triangles_box(figures, aspect):
    rng, n = np.random.default_rng(4), 250_000
    corners = rng.uniform(-1, 1, (n, 3, 3)) if aspect is None else slivers(rng, n, aspect)[0]
    corners = corners.astype(np.float32)
    aim = (corners * rng.dirichlet([1, 1, 1], n)[:, :, None]).sum(1)
    in_plane = np.cross(unit_vectors(rng, n), np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    in_plane /= np.linalg.norm(in_plane, axis=1, keepdims=True)
    o = (aim - 2 * (in_plane + 10 ** rng.uniform(-7, 0, (n, 1)) * unit_vectors(rng, n))).astype(np.float32)
    d = directions(o, aim)
    t, row, point = trace(corners[:, None], o, d)
    low, high = corners.min(1), corners.max(1)
    margin = 1e-5 * np.max(high - low, axis=1)

    def beyond(p):
        return np.maximum(low - p, p - high).max(1)

    distance = moller_trumbore(o, d, corners)[:, None].astype(float)
    naive_hit = distance[:, 0] < FAR
    bad = np.mean((beyond(o + distance * d) > margin)[naive_hit])
    assert bad > 1e-3 and (row >= 0).sum() > 1000
    wrong = np.mean((beyond(point.position) > margin)[row >= 0])
    figures("T4", "share of grazing hits outside the triangle's own box", naive=bad, ours=wrong, at_most=0)


def first_and_count(corners):
    """Return the function (o, d) -> (row of the nearest face or −1, how many faces are hit) of a mesh (m, 3, 3)."""
    table = corner_table(jnp.asarray(corners), jnp.zeros(len(corners), jnp.int32))

    def one(o, d):
        def hit(i, count):
            return count + (hit_distance(sheared(table.corners[i], sight_of(Ray(o, d)))) < FAR).astype(jnp.int32)

        count = lax.fori_loop(0, len(corners), hit, jnp.int32(0))
        return find_triangle(table, Ray(o, d), jnp.full((), FAR))[1], count

    return lanes(one)


def test_t8_the_side_is_told_by_the_normal(figures):
    """2e5 rays from inside and outside a closed mesh: a third at edges, a third at vertices, a third anywhere.

    From outside at what faces the ray: at the outline it enters and leaves at once. Naive: an odd number of faces hit.
    """
    rng, n = np.random.default_rng(8), 33_334
    vertices, faces = icosphere(2)
    corners = vertices.astype(np.float32)[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).astype(float)
    aim = np.concatenate([f(rng, corners, 2 * n) for f in (aim_at_edges, aim_at_vertices)] + [unit_vectors(rng, 2 * n)])
    inside = rng.permutation(np.arange(len(aim)) % 2 == 0)
    away = aim / np.linalg.norm(aim, axis=1, keepdims=True)
    outer = 3 * away + 0.5 * unit_vectors(rng, len(aim))
    inner = 0.85 * rng.uniform(size=(len(aim), 1)) ** (1 / 3) * unit_vectors(rng, len(aim))
    o = np.where(inside[:, None], inner, outer).astype(np.float32)
    d = directions(o, aim)
    row, count = first_and_count(corners)(o, d)
    wrong = (row < 0) | ((dot(normal[row], d.astype(float)) > 0) != inside)
    bad = (count % 2 == 1) != inside
    what = "of 2e5 rays from in and outside a mesh, told wrong by the normal; naive: by parity of faces hit"
    figures("T8", what, naive=bad.sum(), ours=wrong.sum(), at_most=0)


def picture(offset):
    """Return a small picture of a scene whose middle is `offset` on every axis."""

    def at(*p):
        return [x + offset for x in p]

    corners = [[at(-2, -1, -2), at(2, -1, -2), at(2, -1, 2)], [at(-2, -1, -2), at(2, -1, 2), at(-2, -1, 2)]]
    scene = jaxrt.build(
        {
            "camera": {"position": at(0, 1, 2), "target": at(0, -0.5, 0), "width": 16, "height": 16},
            "materials": {"gray": {"type": "diffuse", "albedo": [0.5, 0.5, 0.5]}},
            "spheres": [{"center": at(0.3, -0.6, 0.1), "radius": 0.4, "material": "gray"}],
            "triangles": [{"vertices": v, "material": "gray"} for v in corners],
            "lights": [{"position": at(0.5, 1, 0), "intensity": 5.0}],
        }
    )
    return np.asarray(jaxrt.render(replace(scene, origin=(0.0, 0.0, 0.0)), 1, spp=4, max_depth=1))


def test_t5_far_off_scene_gives_the_same_picture(figures):
    places = 1e6 + np.linspace(0, 1, 1000)
    rounded = np.abs(places.astype(np.float32) - places)
    here, there = picture(0.0), picture(1e6)
    assert here.max() > 0.1
    error = np.abs(there - here)
    figures(
        "T5",
        "what moving a scene by 1e6 changes; naive: its places in float32",
        naive=rounded,
        ours=error,
        at_most=1e-4,
    )
