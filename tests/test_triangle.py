"""Triangles, function by function; the hard cases are in stability/test_t_triangle.py."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrt.core.maths import FAR
from jaxrt.core.records import Ray
from jaxrt.shapes import triangle
from jaxrt.shapes.edges import main_axis
from tests.lanes import lanes
from tests.oracle import directions, dot, triangle_distances, unit_vectors

U = 2.0**-24
FLOOR = np.float32([[0, 0, 0], [1, 0, 0], [0, 0, 1], [1, 0, 1]])


def floor_table():
    faces = jnp.asarray([[0, 1, 2], [1, 3, 2]], jnp.int32)
    return triangle.triangle_table(triangle.Triangles(jnp.asarray(FLOOR), faces, jnp.asarray([4, 2], jnp.int32)))


def test_table_gathers_the_corners():
    table = floor_table()
    assert np.array_equal(table.corners, FLOOR[[[0, 1, 2], [1, 3, 2]]]) and np.array_equal(table.material, [4, 2])


def test_table_shrinks_what_has_no_area():
    corners = np.float32([[0, 0, 1], [0, 1, 1], [0, 0.25, 1], [0.1, 0.2, 0.3]])
    faces = jnp.asarray([[0, 1, 2], [0, 1, 3], [3, 3, 0]], jnp.int32)
    table = triangle.triangle_table(triangle.Triangles(corners, faces, faces[:, 0]))
    assert np.array_equal(table.corners, corners[[[0, 0, 0], [0, 1, 3], [3, 3, 3]]])


def test_shear_takes_the_longest_axis_and_turns_the_ray_to_z():
    rng, n = np.random.default_rng(0), 1000
    d = unit_vectors(rng, n).astype(np.float32)
    assert np.array_equal(jax.jit(jax.vmap(main_axis))(d), np.argmax(np.abs(d), 1))

    # A point on the ray is at (0, 0, its distance)
    def seen(d):
        return triangle.sheared((2 * d)[None], triangle.sight_of(Ray(jnp.zeros(3), d)))[0]

    x, y, z = jax.jit(jax.vmap(seen))(d)
    assert np.abs(x).max() <= 4 * U and np.abs(y).max() <= 4 * U and np.allclose(z, 2, rtol=4 * U)


def test_find_matches_the_oracle():
    rng, n = np.random.default_rng(1), 40_000
    corners = rng.uniform(-1, 1, (n, 5, 3, 3)).astype(np.float32)
    o = rng.uniform(-1, 1, (n, 3)).astype(np.float32)
    d = directions(o, corners[:, 0].mean(1) + rng.uniform(-0.2, 0.2, (n, 3)))

    def one(corners, o, d):
        table, ray = triangle.corner_table(corners, jnp.zeros(5, jnp.int32)), Ray(o, d)
        t, row = triangle.find_triangle(table, ray, jnp.full((), FAR))
        point = triangle.triangle_surface_point(table, ray, jnp.maximum(row, 0))
        return t, row, triangle.occluded_by_triangle(table, ray, jnp.full((), FAR)), point

    t, row, blocked, point = lanes(one)(corners, o, d)
    truth, least = triangle_distances(o[:, None], d[:, None], corners)
    edges = corners[:, :, 1:].astype(float) - corners[:, :, :1]
    normal = np.cross(edges[:, :, 0], edges[:, :, 1])
    cosine = np.abs(dot(normal, d[:, None])) / np.linalg.norm(normal, axis=-1)
    area = np.linalg.norm(normal, axis=-1)
    # Judge rays clear of edges, of grazing, of slivers and of the origin
    clear = ((np.abs(least) > 1e-4) & (cosine > 1e-2) & (area > 1e-2)).all(1) & (truth.min(1) > 1e-3)
    assert clear.mean() > 0.8
    best = truth.argmin(1)
    hit = np.isfinite(truth.min(1))
    assert np.array_equal((row >= 0)[clear], hit[clear]) and np.array_equal(blocked[clear], hit[clear])
    both = clear & hit
    assert np.array_equal(row[both], best[both])
    # 4u of an edge function, over the area and the cosine, in a box of diagonal 2√3
    rays, bound = np.arange(n), 100 * U / (area * cosine).min(1)
    assert np.all(np.abs(t - truth[rays, best])[both] <= bound[both])
    n_hit = normal[rays, best] / np.linalg.norm(normal[rays, best], axis=1, keepdims=True)
    assert np.abs(point.normal - n_hit)[both].max() <= 1e-4
    off = np.abs(dot(point.position - corners[rays, best, 0].astype(float), n_hit))
    assert np.all(off[both] <= point.error[both])


def test_find_and_occluded_stop_at_farthest():
    table = floor_table()

    def one(o, d, farthest):
        ray = Ray(o, d)
        return *triangle.find_triangle(table, ray, farthest), triangle.occluded_by_triangle(table, ray, farthest)

    o = np.float32([[0.2, 1, 0.2], [0.8, 1, 0.8], [0.2, 1, 0.2], [0.2, 1, 0.2]])
    d = np.float32([[0, -1, 0], [0, -1, 0], [0, 1, 0], [0, -1, 0]])
    t, row, blocked = lanes(one, packet=4)(o, d, np.float32([9, 9, 9, 0.5]))
    assert np.array_equal(row, [0, 1, -1, -1]) and np.array_equal(blocked, [True, True, False, False])
    assert np.allclose(t, [1, 1, 9, 0.5])


def test_surface_point_follows_the_corners_and_the_ray():
    """Lifting the plane by dy moves p along the ray by dy/d_y; the normal of a lifted plane stays."""
    o, d = jnp.asarray([0.1, 1.0, 0.1]), jnp.asarray([0.36, -0.8, 0.48])

    def position(lift, o):
        corners = jnp.asarray(FLOOR[:3])[None].at[..., 1].add(lift)
        table = triangle.corner_table(corners, jnp.zeros(1, jnp.int32))
        return triangle.triangle_surface_point(table, Ray(o, d), jnp.int32(0)).position

    by_lift, by_o = jax.jit(jax.jacfwd(position, (0, 1)))(jnp.float32(0.4), o)
    assert np.allclose(jax.jit(position)(jnp.float32(0.4), o), np.asarray(o) + 0.75 * np.asarray(d), atol=8 * U)
    assert np.allclose(by_lift, np.asarray(d) / -0.8, atol=1e-5)
    assert np.allclose(by_o, np.eye(3) - np.outer(d, [0, 1, 0]) / -0.8, atol=1e-5)
    reverse = jax.jit(jax.jacrev(position, (0, 1)))(jnp.float32(0.4), o)
    assert np.allclose(reverse[0], by_lift, atol=1e-6) and np.allclose(reverse[1], by_o, atol=1e-6)


def test_surface_point_of_a_miss_is_finite():
    point = triangle.triangle_surface_point(floor_table(), Ray(jnp.ones(3), jnp.asarray([1.0, 0, 0])), jnp.int32(1))
    assert all(np.isfinite(x).all() for x in (point.position, point.normal, point.error)) and point.material == 2


@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
def test_a_ray_along_a_triangle_has_a_finite_derivative(mode):
    """Where it misses, the place is of no matter, but what is masked later must be a number, above 0 or below."""
    rng, n = np.random.default_rng(7), 40_000
    slopes = (rng.choice([-1, 1], n) * 10.0 ** -rng.uniform(0, 42, n)).astype(np.float32)
    turn, lift = rng.uniform(0, 2 * np.pi, n), 10.0 ** -rng.uniform(0, 42, n) * rng.choice([-1, 0, 1], n)
    slopes[: n // 100] = 0
    o = np.stack([rng.uniform(-1, 2, n), lift, rng.uniform(-1, 2, n)], 1).astype(np.float32)
    d = np.stack([np.cos(turn), slopes, np.sin(turn)], 1).astype(np.float32)

    def place(corners, o, d):
        table = triangle.corner_table(corners, jnp.zeros(1, jnp.int32))
        return triangle.triangle_surface_point(table, Ray(o, d), jnp.int32(0)).position

    found = jax.jit(jax.vmap(mode(place, (0, 1, 2)), (None, 0, 0)))(jnp.asarray(FLOOR[:3])[None], o, d)
    assert all(np.isfinite(x).all() for x in found)
