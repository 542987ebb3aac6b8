"""Spheres, function by function; the hard cases are in stability/test_s_sphere.py."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrt.core.maths import FAR
from jaxrt.core.records import Ray
from jaxrt.shapes import sphere
from tests.lanes import lanes
from tests.oracle import directions, sphere_distances

U = 2.0**-24


def make(center, radius, material=None):
    c, r = np.asarray(center, np.float32), np.asarray(radius, np.float32)
    power = np.sum(c.astype(float) ** 2, -1) - r.astype(float) ** 2
    material = np.arange(len(r)) if material is None else material
    power, material = jnp.asarray(power, jnp.float32), jnp.asarray(material, jnp.int32)
    return sphere.Spheres(jnp.asarray(c), jnp.asarray(r), power, material)


@pytest.mark.parametrize("radius", [1e-3, 1.0, 1e3, 1e6])
def test_exact_power_is_float64_rounded_once(radius):
    rng = np.random.default_rng(0)
    r = (radius * rng.uniform(0.5, 1, 1000)).astype(np.float32)
    c = rng.normal(size=(1000, 3))
    c = (c / np.linalg.norm(c, axis=1, keepdims=True) * (r[:, None] + rng.uniform(-1, 1, (1000, 1)))).astype(np.float32)
    truth = np.sum(c.astype(float) ** 2, 1) - r.astype(float) ** 2
    naive = np.sum(c * c, 1) - r * r
    power = np.asarray(jax.jit(sphere.exact_power)(c, r))
    assert np.all(np.abs(power - truth) <= 2 * U * np.abs(truth) + 2.0**-46 * r.astype(float) ** 2)
    if radius >= 1e3:
        assert np.abs(naive - truth).max() > 100 * np.abs(power - truth).max()


def test_exact_power_has_no_derivative():
    slopes = jax.jit(jax.jacfwd(sphere.exact_power, (0, 1)))(jnp.ones((2, 3)), jnp.ones(2))
    assert all(np.all(x == 0) for x in slopes)


def test_table_carries_the_derivative_of_the_power():
    def constant(center, radius):
        spheres = sphere.Spheres(center, radius, jnp.asarray([5.0 - 9.0]), jnp.zeros(1, jnp.int32))
        return sphere.sphere_table(spheres).constant[0]

    c, r = jnp.asarray([[1.0, 0.0, 2.0]]), jnp.asarray([3.0])
    assert constant(c, r) == -4
    by_center, by_radius = jax.jit(jax.grad(constant, (0, 1)))(c, r)
    assert np.allclose(by_center, 2 * c) and np.allclose(by_radius, -6)


def nearest(table, o, d, farthest):
    return sphere.find_sphere(table, Ray(o, d), farthest)


def test_find_takes_the_nearest_ahead_and_closer_than_farthest():
    table = sphere.sphere_table(make([[0, 0, 5], [0, 0, 2], [0, 0, -2]], [1, 0.5, 0.5]))
    one = lanes(lambda o, d, farthest: nearest(table, o, d, farthest), packet=4)
    o = np.float32([[0, 0, 0], [0, 0, 0], [0, 3, 0], [0, 0, 2]])
    d = np.float32([[0, 0, 1], [0, 0, -1], [0, 0, 1], [0, 0, 1]])
    t, row = one(o, d, np.full(4, FAR, np.float32))
    assert np.array_equal(row, [1, 2, -1, 1]) and np.allclose(t, [1.5, 1.5, FAR, 0.5])
    t, row = one(o, d, np.full(4, 1, np.float32))
    assert np.array_equal(row, [-1, -1, -1, 1]) and np.allclose(t, [1, 1, 1, 0.5])


def test_occluded_skips_the_row_it_is_told_to():
    table = sphere.sphere_table(make([[0, 0, 5], [0, 0, 2]], [1, 0.5]))
    o, d = np.zeros((4, 3), np.float32), np.float32([[0, 0, 1]] * 4)

    def blocked(o, d, farthest, skip):
        ray = Ray(o, d)
        plain = sphere.occluded_by_sphere(table, ray, farthest, None)
        return sphere.occluded_by_sphere(table, ray, farthest, skip), plain

    skipping, plain = lanes(blocked, packet=4)(o, d, np.float32([9, 9, 3, 1]), np.int32([0, 1, 1, 1]))
    assert np.array_equal(skipping, [True, True, False, False]) and np.array_equal(plain, [True, True, True, False])


def test_surface_point_has_position_normal_and_material():
    table = sphere.sphere_table(make([[0, 0, 5], [0, 0, 2]], [1, 0.5], [7, 3]))
    rng, n = np.random.default_rng(1), 1000
    o = rng.uniform(-0.3, 0.3, (n, 3)).astype(np.float32)
    d = directions(o, [0, 0, 2] + rng.uniform(-0.2, 0.2, (n, 3)))
    point = lanes(lambda o, d: sphere.sphere_surface_point(table, Ray(o, d), jnp.int32(1)))(o, d)
    t, _ = sphere_distances(o, d, [0, 0, 2], 0.5)
    p = o + t[:, None].astype(float) * d
    assert np.abs(point.position - p).max() <= 32 * U and np.all(point.material == 3)
    assert np.abs(point.normal - (p - [0, 0, 2]) / 0.5).max() <= 64 * U


def test_surface_point_follows_centre_radius_and_ray():
    """p = o + t d; from n·(dp − dc) = dr: t' = (n·(dc − do) + dr) / n·d."""
    d = jnp.asarray([0.6, 0.0, 0.8])
    o, c, r = jnp.asarray([0.1, 0.2, 0.0]), jnp.asarray([2.1, 0.3, 2.4]), jnp.float32(1)

    def position(c, r, o):
        power = jnp.sum(c * c) - r * r
        table = sphere.sphere_table(sphere.Spheres(c[None], r[None], power[None], jnp.zeros(1, jnp.int32)))
        point = sphere.sphere_surface_point(table, Ray(o, d), jnp.int32(0))
        return point.position, point.normal

    both = lanes(lambda c, r, o: (position(c, r, o), jax.jacfwd(position, (0, 1, 2))(c, r, o)), packet=1)
    (p, n), (slopes, _) = both(*(np.asarray(x)[None] for x in (c, r, o)))
    n, along = n[0].astype(float), float(n[0] @ np.asarray(d, float))
    assert np.allclose(slopes[0][0], np.outer(d, n) / along, atol=1e-5)
    assert np.allclose(slopes[1][0], np.asarray(d) / along, atol=1e-5)
    assert np.allclose(slopes[2][0], np.eye(3) - np.outer(d, n) / along, atol=1e-5)


def test_error_grows_with_the_coordinates():
    table = sphere.sphere_table(make([[0, 0, 0], [1000, 0, 0]], [1, 1]))

    def error(i):
        row = (table.center[i], table.radius[i], table.base[i], table.shift[i], table.constant[i])
        return float(sphere.sphere_error(row, table.center[i] + jnp.asarray([1.0, 0, 0])))

    assert 8 * U <= error(0) <= 64 * U and 8000 * U <= error(1) <= 32_000 * U
