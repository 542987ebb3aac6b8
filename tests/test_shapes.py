"""Mixed scenes behind `find`, `occluded` and `surface_point`, against the oracle; and `leave`."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxrt.core.maths import FAR
from jaxrt.core.records import Ray, SurfacePoint
from jaxrt.shapes import Spheres, Triangles, find, geometry_of, leave, occluded, surface_point
from tests.lanes import lanes
from tests.oracle import directions, dot, sphere_distances, triangle_distances, unit_vectors

U = 2.0**-24
N = 40_000


def mixed(seed=0):
    """Return three spheres, one of them a wall of radius 1e4, and four triangles."""
    rng = np.random.default_rng(seed)
    c = np.float32([[0.5, 0, 0], [-0.6, 0.3, 0.2], [0, -1e4 - 1, 0]])
    r = np.float32([0.4, 0.3, 1e4])
    spheres = Spheres(jnp.asarray(c), jnp.asarray(r), jnp.zeros(3), jnp.asarray([5, 6, 7], jnp.int32))
    vertices = rng.uniform(-1, 1, (12, 3)).astype(np.float32)
    faces = jnp.arange(12, dtype=jnp.int32).reshape(4, 3)
    return spheres, Triangles(jnp.asarray(vertices), faces, jnp.asarray([1, 2, 3, 4], jnp.int32))


def truth_of(spheres, triangles, o, d):
    """Return (distances (n, spheres + triangles), how clear of limbs and edges each is)."""
    parts = []
    if spheres is not None:
        t, depth = sphere_distances(o[:, None], d[:, None], spheres.center, spheres.radius)
        parts.append((t, np.abs(depth) / np.minimum(np.asarray(spheres.radius), 1)))
    if triangles is not None:
        corners = np.asarray(triangles.vertices)[np.asarray(triangles.faces)]
        parts.append(triangle_distances(o[:, None], d[:, None], corners))
    return np.concatenate([t for t, _ in parts], 1), np.concatenate([np.abs(m) for _, m in parts], 1)


@pytest.mark.parametrize("kinds", ["spheres", "triangles", "both"])
def test_mixed_scene_matches_the_oracle(kinds):
    spheres, triangles = mixed()
    spheres = None if kinds == "triangles" else spheres
    triangles = None if kinds == "spheres" else triangles
    geometry = geometry_of(spheres, triangles)

    def one(o, d, distance):
        ray = Ray(o, d)
        hit = find(geometry, ray)
        return hit, surface_point(geometry, ray, hit), occluded(geometry, ray, distance)

    rng = np.random.default_rng(1)
    o = rng.uniform(-0.95, 0.95, (N, 3)).astype(np.float32)
    d = unit_vectors(rng, N).astype(np.float32)
    distance = rng.uniform(0.1, 2, N).astype(np.float32)
    hit, point, blocked = lanes(one)(o, d, distance)
    t, margin = truth_of(spheres, triangles, o, d)
    nearest, best = t.min(1), t.argmin(1)
    # Judge rays that rounding cannot turn: clear of edges and limbs, of near ties, of the origin
    gaps = np.diff(np.sort(np.where(np.isfinite(t), t, FAR), axis=1)[:, :2], axis=1)[:, 0]
    clear = (margin > 1e-4).all(1) & (gaps > 1e-4) & (nearest > 1e-4)
    finite = np.isfinite(nearest)
    clear |= ~finite & (margin > 1e-4).all(1)
    assert clear.mean() > 0.8 and np.array_equal(hit.valid[clear], finite[clear])
    both = clear & finite
    assert np.array_equal(hit.index[both], best[both])
    rows = np.concatenate([np.asarray(k.material) for k in (spheres, triangles) if k is not None])
    assert np.array_equal(point.material[both], rows[best[both]])
    in_room = both & (nearest < 4)
    p = o + np.where(finite, nearest, 0)[:, None].astype(float) * d
    grazing = np.abs(dot(point.normal.astype(float), d))
    assert np.all(np.linalg.norm(point.position - p, axis=1)[in_room] * grazing[in_room] <= 1e-4)
    sure = clear & (np.abs(np.where(finite, nearest, FAR) - distance) > 1e-3)
    assert np.array_equal(blocked[sure], (nearest < distance)[sure])


def test_occluded_can_skip_a_sphere_but_no_triangle():
    geometry = geometry_of(*mixed())
    o = np.float32([[0.5, 3, 0], [0.5, 3, 0]])
    d = np.float32([[0, -1, 0], [0, -1, 0]])

    def one(o, d, distance):
        ray = Ray(o, d)
        return occluded(geometry, ray, distance, jnp.int32(0)), occluded(geometry, ray, distance, jnp.int32(1))

    skipping_it, skipping_another = lanes(one, packet=2)(o, d, np.float32([2.7, 9]))
    assert np.array_equal(skipping_another, [True, True]) and skipping_it[1]


def test_leave_moves_to_the_side_that_the_ray_goes_to():
    point = SurfacePoint(jnp.zeros(3), jnp.asarray([0.0, 0, 1]), jnp.float32(1e-3), jnp.int32(0))
    for w, z in (([0, 0.6, 0.8], 1e-3), ([0, 0.6, -0.8], -1e-3), ([1, 0, 0], 1e-3)):
        ray = leave(point, jnp.asarray(w, jnp.float32))
        assert np.allclose(ray.origin, [0, 0, z]) and np.array_equal(ray.direction, np.float32(w))


def test_missed_ray_has_a_finite_point():
    geometry = geometry_of(mixed()[0], mixed()[1])

    def one(o, d):
        hit = find(geometry, Ray(o, d))
        return hit, surface_point(geometry, Ray(o, d), hit)

    o, d = np.float32([[0, 50, 0]]), directions(np.float32([[0, 50, 0]]), [[0, 99, 1]])
    hit, point = lanes(one, packet=1)(o, d)
    assert not hit.valid[0] and hit.index[0] == 0
    assert all(np.isfinite(x).all() for x in (point.position, point.normal, point.error))
