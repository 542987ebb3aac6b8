"""Wide, tilted and far-off triangles: what float32 gets wrong across a plane is bounded, and small where it can be."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrt
from jaxrt.core.maths import FAR
from jaxrt.core.records import Ray
from jaxrt.shapes import Triangles, leave
from jaxrt.shapes.triangle import corner_table, find_triangle, triangle_surface_point, triangle_table
from tests.lanes import lanes
from tests.oracle import directions, unit_vectors

N = 40_000
U = 2.0**-24


def rotation(axis, degrees):
    """Return the matrix (3, 3) of a turn about an axis."""
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
    k, a = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]), np.radians(degrees)
    return np.eye(3) + np.sin(a) * k + (1 - np.cos(a)) * k @ k


def floor(half, tilt=0.0, y=-1.0, away=(0, 0, 0)):
    """Return the corners (2, 3, 3) of a square floor, float32: tilted about an askew axis, then moved."""
    corners = np.array([[-half, 0, -half], [half, 0, -half], [half, 0, half], [-half, 0, half]])
    corners = corners @ rotation([1, 0, 0.3], tilt).T + [0, y, 0] + np.asarray(away)
    return corners[[[0, 2, 1], [0, 3, 2]]].astype(np.float32)


def go_on(wide, corners, o, d, w):
    """Return (row hit, place, offset, what a ray in direction w then hits)."""
    table, far = corner_table(corners, jnp.zeros(2, jnp.int32), wide=wide), jnp.full((), FAR)
    t, row = find_triangle(table, Ray(o, d), far)
    point = triangle_surface_point(table, Ray(o, d), jnp.maximum(row, 0))
    return row, t, point, find_triangle(table, leave(point, w), far)[1]


go_on_of = {wide: lanes(partial(go_on, wide)) for wide in (False, True)}


def off_plane(corners, p):
    """Return the signed distance of points (n, 3) to the planes through corners (n, 3, 3), in float64."""
    corners, p = corners.astype(float), p.astype(float)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.sum((p - corners[:, 0]) * normal, 1) / np.linalg.norm(normal, axis=1)


CASES = [
    pytest.param(half, tilt, away, id=f"{half:g} {tilt} {'far' if any(away) else 'near'}")
    for half in (1, 1e2, 1e4, 1e6)
    for tilt in (0, 1e-4, 0.1, 7, 45, 83)
    for away in ((0, 0, 0), (3e3, -2e2, 7e3))
    if not any(away) or half <= 1e4
]


@pytest.mark.parametrize("wide", [False, True])
@pytest.mark.parametrize(("half", "tilt", "away"), CASES)
def test_f9_no_ray_hits_the_plane_that_it_leaves(half, tilt, away, wide):
    """And each place is as near to the plane as the bound says, the second triangle of the floor included."""
    rng, corners = np.random.default_rng(1), floor(half, tilt, away=away)
    near = min(half, 3)
    aim = rng.uniform(-near, near, (N, 3)) * [1, 0, 1] @ rotation([1, 0, 0.3], tilt).T + [0, -1, 0] + np.asarray(away)
    o = (aim + unit_vectors(rng, N) * 10 ** rng.uniform(-2, 1, (N, 1))).astype(np.float32)
    w = unit_vectors(rng, N)
    # A third of the rays grazes
    w[::3] -= corners_normal(corners) * (w[::3] @ corners_normal(corners))[:, None] * 0.999
    w = (w / np.linalg.norm(w, axis=1, keepdims=True)).astype(np.float32)
    row, _, point, again = go_on_of[wide](np.tile(corners, (N, 1, 1, 1)), o, directions(o, aim), w)
    hit = row >= 0
    assert hit.mean() > 0.4
    assert np.all(again[hit] < 0)
    off = np.abs(off_plane(corners[np.maximum(row, 0)], point.position))
    assert np.all((off <= point.error)[hit])
    # As small as the bound allows: the normal's share of each axis, and something for the normal's own rounding
    share = np.abs(corners_normal(corners)) @ np.abs(corners).max(axis=(0, 1))
    assert point.error.max() <= 12 * U * share * 1.001 + 150 * U * U * np.abs(corners).max()


def corners_normal(corners):
    normal = np.cross(*(corners[0, k].astype(float) - corners[0, 0] for k in (1, 2)))
    return normal / np.linalg.norm(normal)


@pytest.mark.parametrize("half", [1e4, 1e5, 1e6])
@pytest.mark.parametrize("height", [1e-4, 1e-2, 1])
def test_f9_a_wide_floor_stops_rays_that_start_near_it(half, height):
    """And says where, as well as the ray's own numbers do; the plain test loses most of them."""
    rng, corners = np.random.default_rng(2), floor(half)
    o = (rng.uniform(-2, 2, (N, 3)) * [1, 0, 1] + [0, height - 1, 0]).astype(np.float32)
    d = unit_vectors(rng, N)
    d[:, 1] = -np.maximum(np.abs(d[:, 1]), 1e-3)
    d = directions(o, o + d)
    row, t, point, _ = go_on_of[True](np.tile(corners, (N, 1, 1, 1)), o, d, d)
    truth = (o[:, 1].astype(float) + 1) / -d[:, 1].astype(float)
    assert np.all(row >= 0)
    np.testing.assert_allclose(t, truth, rtol=1e-6)
    places = o + truth[:, None] * d.astype(float)
    bound = 16 * U * (np.abs(o).max() + truth) / np.minimum(-d[:, 1], 1)
    assert np.all(np.abs(point.position - places).max(1) <= bound)
    if half == 1e6 and height <= 1e-2:
        assert np.mean(go_on_of[False](np.tile(corners, (N, 1, 1, 1)), o, d, d)[0] < 0) > 0.5


@pytest.mark.usefixtures("quick_compilation")
def test_f9_derivatives_of_a_wide_floor_are_those_of_a_narrow_one():
    """Of a place on it, in the ray's origin and the floor's height."""

    def place(corners, o, height, wide):
        table = corner_table(corners.at[..., 1].add(height), jnp.zeros(2, jnp.int32), wide=wide)
        ray = Ray(o, jnp.array([0.6, -0.64, 0.48]))
        return triangle_surface_point(table, ray, find_triangle(table, ray, jnp.full((), FAR))[1]).position

    o, zero = jnp.array([0.3, 2.0, -0.2]), jnp.zeros(())
    slopes = [
        jax.jacfwd(place, argnums=(1, 2))(jnp.asarray(floor(half)), o, zero, wide)
        for half, wide in ((10, False), (1e6, True))
    ]
    for narrow, other in zip(*slopes, strict=True):
        np.testing.assert_allclose(other, narrow, atol=1e-4)


# Pictures

BOX = {
    "vertices": [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)],
    "faces": [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ],
    "material": "red",
}  # fmt: skip


def scene(half, tilt=0.0):
    """Return a box of 2 on a square floor under a sky; the camera sees no horizon."""
    corners = [[-half, -1, -half], [half, -1, -half], [half, -1, half], [-half, -1, half]]
    turned = {"rotate": [tilt, 0, 2 * tilt]}
    eye = np.array([3, 2, 6]) @ _turn(turned["rotate"]).T
    return {
        "camera": {"position": eye.tolist(), "target": [0, 0, 0], "fov": 26, "width": 32, "height": 32},
        "render": {"spp": 64, "max_depth": 3},
        "environment": {"radiance": [0.4, 0.5, 0.7]},
        "materials": {
            "white": {"type": "diffuse", "albedo": [0.8, 0.8, 0.8]},
            "red": {"type": "diffuse", "albedo": [0.8, 0.1, 0.1]},
        },
        "meshes": [{"vertices": corners, "faces": [[0, 2, 1], [0, 3, 2]], "material": "white"} | turned, BOX | turned],
    }


def _turn(degrees):
    return rotation([0, 0, 1], degrees[2]) @ rotation([0, 1, 0], degrees[1]) @ rotation([1, 0, 0], degrees[0])


@pytest.mark.usefixtures("quick_compilation")
@pytest.mark.parametrize(
    ("half", "tilt", "narrow", "bound"), [(1e6, 0, 3e3, 1e-4), (1e5, 0, 3e3, 1e-4), (1e4, 11, 3e2, 5e-3)]
)
def test_f9_a_box_on_a_wide_floor_looks_as_on_a_narrow_one(half, tilt, narrow, bound):
    """With the same random numbers. Tilted, a floor of 1e4 is known to 5e-3 across its plane, 1/400 of the box."""
    pictures = [np.asarray(jaxrt.render(jaxrt.build(scene(h, tilt)), jax.random.key(0))) for h in (half, narrow)]
    assert pictures[0].mean() == pytest.approx(pictures[1].mean(), rel=bound)
    if not tilt:
        assert np.abs(pictures[0] - pictures[1]).max() < 0.02


def test_only_scenes_with_wide_triangles_take_the_care():
    assert jaxrt.build(scene(1e6)).triangles.wide
    assert not jaxrt.build(scene(1e2)).triangles.wide
    ball = {"center": [0, 0, 0], "radius": 1, "material": "red"}
    alone = scene(1e6) | {"meshes": scene(1e6)["meshes"][:1]}
    assert not jaxrt.build(alone).triangles.wide
    assert jaxrt.build(alone | {"spheres": [ball]}).triangles.wide


@pytest.mark.usefixtures("quick_compilation")
def test_f9_the_tree_takes_the_same_care():
    """A wide floor among enough faces for a tree."""
    rng, corners = np.random.default_rng(3), floor(1e6)
    small = rng.uniform(-1, 1, (400, 1, 3)) + rng.uniform(-0.05, 0.05, (400, 3, 3)) + [50, 50, 50]
    every = np.concatenate([corners, small]).astype(np.float32)
    vertices, faces = every.reshape(-1, 3), np.arange(3 * len(every)).reshape(-1, 3)
    topology = jaxrt.shapes.topology_of(vertices.astype(float), faces)
    assert topology is not None
    rows = np.zeros(len(faces), np.int32)
    table = triangle_table(Triangles(jnp.asarray(vertices), jnp.asarray(faces), jnp.asarray(rows), topology, wide=True))
    o = (rng.uniform(-2, 2, (N, 3)) * [1, 0, 1] + [0, -0.99, 0]).astype(np.float32)
    d = unit_vectors(rng, N)
    d[:, 1] = -np.maximum(np.abs(d[:, 1]), 1e-3)
    d = directions(o, o + d)

    def look(o, d):
        return find_triangle(table, Ray(o, d), jnp.full((), FAR))

    t, row = lanes(look)(o, d)
    assert np.all((row == 0) | (row == 1))
    np.testing.assert_allclose(t, (o[:, 1].astype(float) + 1) / -d[:, 1].astype(float), rtol=1e-6)
