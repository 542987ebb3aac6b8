"""Spheres, function by function; the hard cases are in stability/test_s_sphere.py."""

from dataclasses import replace

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
    c, r = jnp.asarray(center, jnp.float32), jnp.asarray(radius, jnp.float32)
    material = np.arange(len(r)) if material is None else material
    return sphere.Spheres(c, r, jnp.zeros_like(r), jnp.asarray(material, jnp.int32))


def beside_the_origin(radius, n, seed=0):
    """Return random spheres in float64 that pass within 1 of the origin: centres (n, 3), radii (n,)."""
    rng = np.random.default_rng(seed)
    r = radius * rng.uniform(0.5, 1, n)
    c = rng.normal(size=(n, 3))
    return c / np.linalg.norm(c, axis=1, keepdims=True) * (r[:, None] + rng.uniform(-1, 1, (n, 1))), r


def power(center, radius):
    return np.sum(center.astype(float) ** 2, 1) - radius.astype(float) ** 2


@pytest.mark.parametrize("radius", [1e-3, 1.0, 1e3, 1e6])
def test_exact_power_is_float64_rounded_once(radius):
    """Of as many spheres as fill several loops of a compiler's vectors, by themselves and compiled."""
    c, r = (np.float32(x) for x in beside_the_origin(radius, 40_000))
    truth, naive = power(c, r), np.sum(c * c, 1) - r * r
    for run in (sphere.exact_power, jax.jit(sphere.exact_power)):
        found = np.asarray(run(jnp.asarray(c), jnp.asarray(r), jnp.zeros(len(r))))
        assert np.all(np.abs(found - truth) <= 2 * U * np.abs(truth) + 2.0**-46 * r.astype(float) ** 2)
        if radius >= 1e3:
            assert np.abs(naive - truth).max() > 100 * np.abs(found - truth).max()


def test_exact_power_has_no_derivative():
    slopes = jax.jit(jax.jacfwd(sphere.exact_power, (0, 1, 2)))(jnp.ones((2, 3)), jnp.ones(2), jnp.zeros(2))
    assert all(np.all(x == 0) for x in slopes)


@pytest.mark.parametrize("radius", [1.0, 1e3, 1e6])
def test_lost_digits_bring_back_the_power_and_are_all_kept(radius):
    """What rounding takes is within the bound that tells it from the digits of other spheres; the bound is tight."""
    exact_c, exact_r = beside_the_origin(radius, 40_000)
    lost = np.float32(sphere.lost_digits(exact_c, exact_r, jnp.float32))
    c, r = jnp.asarray(exact_c, jnp.float32), jnp.asarray(exact_r, jnp.float32)
    spheres = sphere.Spheres(c, r, jnp.asarray(lost), jnp.zeros(len(r), jnp.int32))
    huge = np.asarray(r * r > jnp.sum(c * c, -1) / 4)
    kept = np.asarray(jax.jit(sphere.kept_digits)(spheres))
    np.testing.assert_array_equal(kept, lost)
    assert np.all(lost[~huge] == 0) and np.abs(lost[huge] / exact_r[huge]).max() > U
    truth = power(exact_c, exact_r)
    found = np.asarray(jax.jit(sphere.sphere_table)(spheres).constant)
    # How far the surface is off beside the origin
    off = np.abs(found - truth)[huge] / (2 * exact_r[huge])
    assert np.all(off <= (2 * U * np.abs(truth[huge]) + 2.0**-45 * exact_r[huge] ** 2) / (2 * exact_r[huge]))


def test_lost_digits_of_another_sphere_do_not_count():
    """A wall of radius 1e6 shrunk to a ball, with the wall's digits left in: that ball to the bit."""
    ball = make([[0, 0, 0], [0, 1, 0], [3, 0, 0]], [1, 2, 0.5])
    stale = replace(ball, lost=jnp.asarray([0.03, -0.03, jnp.nan]))
    for x, y in zip(
        jax.tree.leaves(sphere.sphere_table(stale)), jax.tree.leaves(sphere.sphere_table(ball)), strict=True
    ):
        np.testing.assert_array_equal(x, y)


def test_table_carries_the_derivative_of_the_power_and_none_of_the_lost_digits():
    def constant(center, radius, lost):
        return sphere.sphere_table(sphere.Spheres(center, radius, lost, jnp.zeros(1, jnp.int32))).constant[0]

    c, r = jnp.asarray([[1.0, 0.0, 2.0]]), jnp.asarray([3.0])
    assert constant(c, r, jnp.zeros(1)) == -4
    by_center, by_radius, by_lost = jax.jit(jax.grad(constant, (0, 1, 2)))(c, r, jnp.full(1, U))
    assert np.allclose(by_center, 2 * c) and np.allclose(by_radius, -6) and np.all(by_lost == 0)


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
        table = sphere.sphere_table(sphere.Spheres(c[None], r[None], jnp.zeros(1), jnp.zeros(1, jnp.int32)))
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


@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
def test_a_ray_that_begins_beside_a_sphere_has_a_bounded_derivative(mode):
    """Of a ray that misses the place is of no matter, but what is masked later must be a number."""
    slopes = np.asarray([s * 10.0**-k for k in (0, 4, 8, 12, 16, 20, 25) for s in (1, -1)] + [0.0], np.float32)

    def place(center, slope):
        table = sphere.sphere_table(make(center[None], [1.0]))
        ray = Ray(jnp.asarray([1.5, 0, 0]), jnp.stack([slope, jnp.sqrt(1 - slope * slope), jnp.zeros_like(slope)]))
        return sphere.sphere_surface_point(table, ray, jnp.int32(0)).position

    found = jax.vmap(mode(place), (None, 0))(jnp.zeros(3), jnp.asarray(slopes))
    assert np.abs(found).max() <= 2
