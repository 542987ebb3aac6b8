"""Leaving a surface: cases E1-E5. Where a naive method exists, its failure is asserted."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrt.core.maths import FAR, dot
from jaxrt.core.records import Ray, SurfacePoint
from jaxrt.lights import Lights, light_table, sample_light
from jaxrt.materials.glass import sample_glass
from jaxrt.shapes import Geometry, leave, occluded
from jaxrt.shapes.sphere import Spheres, find_sphere, sphere_surface_point, sphere_table
from jaxrt.shapes.triangle import (
    Triangles,
    corner_table,
    find_triangle,
    triangle_surface_point,
    triangle_table,
)
from tests.lanes import lanes
from tests.oracle import directions, sphere_distances, unit_vectors
from tests.stability.naive import moller_trumbore

U = 2.0**-24
SCALES, DISTANCES = (1e-3, 1, 1e3, 1e6), (1, 10, 1e2, 1e3)


@jax.jit
@jax.vmap
def tables(center, radius):
    """Return tables (n, m) of m spheres per lane; center: (n, m, 3)."""
    return sphere_table(Spheres(center, radius, jnp.zeros_like(radius), jnp.zeros(len(radius), jnp.int32)))


def one_triangle(corners, o, d, w):
    """Return (hit?, gap, hit again by ours?, by a textbook test without offset?, with 1e-4?)."""
    table, far = corner_table(corners[None], jnp.zeros(1, jnp.int32)), jnp.full((), FAR)

    def row(ray):
        return find_triangle(table, ray, far)[1]

    point = triangle_surface_point(table, Ray(o, d), jnp.int32(0))
    up = point.normal * jnp.where(dot(point.normal, w) < 0, -1, 1).astype(w.dtype)
    starts = [leave(point, w).origin, point.position, point.position + 1e-4 * up]
    naive_hits = [moller_trumbore(start, w, corners) < FAR for start in starts[1:]]
    return row(Ray(o, d)) >= 0, point.error, [row(Ray(starts[0], w)) >= 0, *naive_hits]


def one_sphere(table, o, d, w):
    """Return the same for a sphere and a direction outwards, with the normal."""
    far = jnp.full((), FAR)

    def row(ray):
        return find_sphere(table, ray, far)[1]

    point = sphere_surface_point(table, Ray(o, d), jnp.int32(0))
    w = jnp.where(dot(point.normal, w) < 0, -w, w)
    starts = [leave(point, w).origin, point.position, point.position + 1e-4 * point.normal]
    return row(Ray(o, d)) >= 0, point.error, [row(Ray(start, w)) >= 0 for start in starts]


leave_triangle, leave_sphere = lanes(one_triangle), lanes(one_sphere)


def scenes(n):
    """Return (generator, scale, distance) with every scale at every distance."""
    each = n // 16
    return np.random.default_rng(5), np.repeat(SCALES, 4 * each), np.tile(np.repeat(DISTANCES, each), 4)


def check(figures, scale, result):
    """Assert 0 re-hits and a gap of at most 1e-5 of the scene; naive methods fail."""
    hit, gap, (ours, bare, fixed) = result
    assert hit.mean() > 0.99
    again = (ours & hit).mean()
    fixed = fixed[hit & (scale == 1e6)].mean()
    assert bare[hit].mean() > 0.3 and fixed > 0.1
    figures(
        "E1",
        "share of 1e6 leaving rays that hit again; naive: no offset",
        naive=bare[hit].mean(),
        ours=again,
        at_most=0,
    )
    figures(
        "E1", "share that hit again in scenes of size 1e6; naive: an offset of 1e-4", naive=fixed, ours=again, at_most=0
    )
    gap = (gap / scale)[hit]
    figures(
        "E1",
        "gap left, over the size of the scene; naive: 1e-4, in one of size 1e-3",
        naive=1e-4 / min(SCALES),
        ours=gap,
        at_most=1e-5,
    )


def test_e1_triangles_are_not_hit_by_rays_that_leave_them(figures):
    n = 1_000_000
    rng, scale, distance = scenes(n)
    corners = (rng.uniform(-1, 1, (n, 3, 3)) * scale[:, None, None]).astype(np.float32)
    aim = (corners * rng.dirichlet([1, 1, 1], n)[:, :, None]).sum(1)
    o = (aim - unit_vectors(rng, n) * (distance * scale)[:, None]).astype(np.float32)
    result = leave_triangle(corners, o, directions(o, aim), unit_vectors(rng, n).astype(np.float32))
    check(figures, scale, result)


@pytest.mark.parametrize("aspect", [1e-2, 1e-3, 1e-4])
def test_e1_slivers_are_not_hit_by_rays_that_leave_them(figures, aspect):
    n = 160_000
    rng, scale, distance = scenes(n)
    a, along = rng.uniform(-1, 1, (n, 3)), unit_vectors(rng, n)
    across = np.cross(along, unit_vectors(rng, n))
    across *= aspect / np.linalg.norm(across, axis=1, keepdims=True)
    apex = a + along * rng.uniform(0, 1, (n, 1)) + across
    corners = (np.stack([a, a + along, apex], 1) * scale[:, None, None]).astype(np.float32)
    aim = (corners * rng.dirichlet([1, 1, 1], n)[:, :, None]).sum(1)
    o = (aim - unit_vectors(rng, n) * (distance * scale)[:, None]).astype(np.float32)
    hit, _, (ours, bare, _) = leave_triangle(corners, o, directions(o, aim), unit_vectors(rng, n).astype(np.float32))
    assert hit.mean() > 0.8
    bad, again = bare[hit].mean(), (ours & hit).mean()
    figures(
        "E1", "share of rays that hit the sliver they leave again; naive: no offset", naive=bad, ours=again, at_most=0
    )


def test_e1_spheres_are_not_hit_by_rays_that_leave_them(figures):
    n = 1_000_000
    rng, scale, distance = scenes(n)
    radius = (scale * rng.uniform(0.1, 1, n)).astype(np.float32)
    center = (rng.uniform(-1, 1, (n, 3)) * scale[:, None]).astype(np.float32)
    aim = center + 0.95 * radius[:, None] * unit_vectors(rng, n)
    o = (aim - unit_vectors(rng, n) * (distance * scale)[:, None]).astype(np.float32)
    table = tables(center[:, None], radius[:, None])
    result = leave_sphere(table, o, directions(o, aim), unit_vectors(rng, n).astype(np.float32))
    check(figures, scale, result)


def test_e1_far_from_the_origin(figures):
    n = 40_000
    rng = np.random.default_rng(6)
    center = (rng.uniform(-1, 1, (n, 3)) + 1e5).astype(np.float32)
    o = (center + 3 * unit_vectors(rng, n)).astype(np.float32)
    d, w = directions(o, center), unit_vectors(rng, n).astype(np.float32)
    table = tables(center[:, None], np.ones((n, 1), np.float32))
    hit, gap, (ours, bare, fixed) = leave_sphere(table, o, d, w)
    assert hit.all() and gap.max() < 0.4
    bad, again = fixed.mean(), ours.mean()
    assert bad > 0.1
    figures(
        "E1", "share that hit again 1e5 from the origin; naive: an offset of 1e-4", naive=bad, ours=again, at_most=0
    )


def lit(geometry, o, u, position, intensity, radius):
    """Return (irradiance on the floor, blocked?, blocked without skip and bound?) of one light sample."""
    lights = light_table(Lights(position[None], intensity[None], radius[None]))
    down = jnp.asarray([0.0, -1.0, 0.0])
    point = triangle_surface_point(geometry.triangles, Ray(o, down), jnp.int32(0))
    sample = sample_light(lights, point.position, (u[0], u[1]))
    shadow = leave(point, sample.direction)
    blocked = occluded(geometry, shadow, sample.distance, jnp.int32(0))
    rounding = 8 * U * (jnp.sum(jnp.abs(position)) + radius + sample.distance)
    naive = occluded(geometry, shadow, sample.distance + rounding)
    return sample.irradiance[0] * jnp.maximum(sample.direction[1], 0), blocked, naive


irradiance = lanes(lit)


@pytest.mark.parametrize("ratio", [1.001, 1.1, 3, 1e2, 1e4, 1e5])
def test_e2_light_does_not_shadow_itself(figures, ratio):
    """Below a sphere light that is wholly above the horizon, E = πLr² cosθ/d², where I = πLr²."""
    n, side, rng = 40_000, 200, np.random.default_rng(7)
    corners = np.float32([[-9, 0, -9], [0, 0, 9], [9, 0, -9]])
    table = triangle_table(Triangles(corners, jnp.asarray([[0, 1, 2]]), jnp.zeros(1, jnp.int32)))
    radius, height = np.float32(1 / ratio), np.float32(1)
    light = np.float32([0, height, 0])
    geometry = Geometry(tables(light[None, None], radius[None, None]), jax.tree.map(lambda x: x[None], table))
    lanes_of = jax.tree.map(lambda x: np.repeat(np.asarray(x), n, 0), geometry)
    x = np.zeros(n) if ratio < 3 else rng.uniform(-0.3, 0.3, n)
    o = np.stack([x, np.full(n, 0.5), np.zeros(n)], 1).astype(np.float32)
    cell = np.stack(np.divmod(np.arange(n), side), 1)
    u = np.minimum((cell + rng.uniform(0, 1, (n, 2))) / side, 1 - U).astype(np.float32)
    operands = (np.tile(light, (n, 1)), np.ones((n, 3), np.float32), np.full(n, radius))
    received, blocked, naive = irradiance(lanes_of, o, u, *operands)
    bad, dark = naive.mean(), blocked.mean()
    assert bad > 0.1
    figures(
        "E2",
        "share of shadow rays that a light's own sphere blocks; naive: to its centre",
        naive=bad,
        ours=dark,
        at_most=0,
    )
    squared = x**2 + float(height) ** 2
    error = received.astype(float) / (height / squared**1.5) - 1
    # Four standard errors of a plain mean bound those of a stratified one
    limit = 1e-5 + 4 * error.std() / np.sqrt(n)
    assert abs(error.mean()) <= limit


def go_in(table, o, d, w):
    """Return the row found by a ray that goes on inwards from the outer sphere 0: ours, and skipping 1e-4."""
    point = sphere_surface_point(table, Ray(o, d), jnp.int32(0))
    ray, far = leave(point, w), jnp.full((), FAR)
    t, row = find_sphere(table, ray, far)
    skipped, _ = find_sphere(table, Ray(point.position + 1e-4 * w, w), far)
    return t, row, skipped, point.position


@pytest.mark.parametrize("gap", [4e-5, 1e-5])
def test_e3_inner_sphere_is_found_in_a_narrow_gap(figures, gap):
    n, rng = 40_000, np.random.default_rng(8)
    center = np.zeros((n, 2, 3), np.float32)
    radius = np.tile(np.float32([1 + gap, 1]), (n, 1))
    o = (3 * unit_vectors(rng, n)).astype(np.float32)
    d = directions(o, 0.9 * unit_vectors(rng, n))
    t, row, skipped, p = lanes(go_in)(tables(center, radius), o, d, d)
    truth, _ = sphere_distances(p, d, center[:, 0], radius[:, 1])
    sure = np.isfinite(truth)
    assert np.all(t[sure] < 0.01)
    bad, lost = (skipped[sure] > 0.1).mean(), (row[sure] != 1).mean()
    assert bad > 0.5
    figures(
        "E3",
        "share of rays that miss a ball 4e-5 or 1e-5 below a surface; naive: 1e-4",
        naive=bad,
        ours=lost,
        at_most=0,
    )


def through_clear_glass(table, o, d, u):
    """Return how many surfaces a ray meets in a ball of index 1: ours, and with offsets always outwards."""

    def surfaces(push):
        ray, count, far = Ray(o, d), jnp.int32(0), jnp.full((), FAR)
        for _ in range(4):
            hit = find_sphere(table, ray, far)[1] >= 0
            point = sphere_surface_point(table, ray, jnp.int32(0))
            direction, _ = sample_glass(jnp.ones(()), -ray.direction, point.normal, u)
            ray = Ray(jnp.where(hit, push(point, direction), ray.origin), jnp.where(hit, direction, ray.direction))
            count = count + hit.astype(jnp.int32)
        return count, ray.direction

    ours, end = surfaces(lambda point, direction: leave(point, direction).origin)
    return ours, surfaces(lambda point, _: point.position + point.error * point.normal)[0], end


def test_e4_refracted_ray_starts_on_its_side(figures):
    n, rng = 40_000, np.random.default_rng(9)
    center = rng.uniform(-1, 1, (n, 3)).astype(np.float32)
    o = (center + 3 * unit_vectors(rng, n)).astype(np.float32)
    d = directions(o, center + 0.999 * unit_vectors(rng, n))
    table = tables(center[:, None], np.ones((n, 1), np.float32))
    ours, outwards, end = lanes(through_clear_glass)(table, o, d, rng.uniform(0, 1, n).astype(np.float32))
    assert np.abs(end - d).max() <= 1e-4
    bad, wrong = (outwards > 2).mean(), (ours != 2).mean()
    assert bad > 0.9
    figures(
        "E4",
        "share of rays through clear glass that meet not two faces; naive: always outwards",
        naive=bad,
        ours=wrong,
        at_most=0,
    )


def test_e5_offset_has_no_derivative(figures):
    point = SurfacePoint(jnp.zeros(3), jnp.asarray([0.0, 1, 0]), jnp.float32(1e-3), jnp.int32(0))
    w = jnp.asarray([0.6, 0.8, 0.0])

    def start(error, position, normal):
        moved = SurfacePoint(position, normal, error, point.material)
        return leave(moved, w).origin

    slopes = jax.jit(jax.jacfwd(start, argnums=(0, 1, 2)))(point.error, point.position, point.normal)
    assert np.array_equal(slopes[1], np.eye(3))
    bad = np.abs(jax.jacfwd(lambda error: point.position + error * point.normal)(point.error))
    wrong = max(np.abs(slopes[0]).max(), np.abs(slopes[2]).max())
    figures("E5", "derivative of the offset; naive: that of ε n in ε", naive=bad, ours=wrong, at_most=0)
    assert start(point.error, point.position, point.normal)[1] == np.float32(1e-3)


def test_e5_derivative_of_a_lit_plane(figures):
    """Point light at height h over a point x aside: E = h/(x² + h²)^1.5."""
    corners = np.float32([[-9, 0, -9], [0, 0, 9], [9, 0, -9]])
    table = triangle_table(Triangles(corners, jnp.asarray([[0, 1, 2]]), jnp.zeros(1, jnp.int32)))

    def received(height, x):
        lights = light_table(Lights(jnp.stack([x * 0, height, x * 0])[None], jnp.ones((1, 3)), None))
        o = jnp.stack([x, x * 0 + 2, x * 0])
        point = triangle_surface_point(table, Ray(o, jnp.asarray([0.0, -1, 0])), jnp.int32(0))
        sample = sample_light(lights, leave(point, jnp.asarray([0.0, 1, 0])).origin, (x * 0, x * 0))
        return sample.irradiance[0] * sample.direction[1]

    h, x = np.meshgrid(np.float32([0.3, 1, 2]), np.float32([0, 0.5, 1.5]))
    by_h, by_x = lanes(jax.jacfwd(received, argnums=(0, 1)), packet=3)(h.ravel(), x.ravel())
    squared = h.ravel().astype(float) ** 2 + x.ravel() ** 2
    truth_h = squared**-1.5 - 3 * h.ravel() ** 2 * squared**-2.5
    truth_x = -3 * h.ravel() * x.ravel() * squared**-2.5
    size = squared**-1.5
    error = np.abs([(by_h - truth_h) / size, (by_x - truth_x) / size])
    figures("E5", "error of a lit plane's derivatives, relative", ours=error, at_most=1e-3)
