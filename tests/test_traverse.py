"""The search of a mesh under JAX's transformations, and in `render`."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrt
from jaxrt.core.maths import FAR
from jaxrt.core.records import Hit, Ray, SurfacePoint
from jaxrt.shapes import Spheres, Triangles, find, geometry_of, occluded, topology_of
from jaxrt.shapes.triangle import find_triangle, occluded_by_triangle, triangle_table
from jaxrt.transport.path import event_at, tables_of, walk_along
from tests import meshes
from tests.oracle import unit_vectors
from tests.searches import rays_at

GRID, HEIGHT = 8, 2.0


def triangles_of(vertices, faces, least=1, dtype=jnp.float32):
    rows = jnp.asarray(faces, jnp.int32)
    return Triangles(jnp.asarray(vertices, dtype), rows, rows[:, 0] * 0, topology_of(vertices, faces, least))


def nearest(table, o, d):
    return find_triangle(table, Ray(o, d), jnp.full((), FAR, o.dtype))


@pytest.fixture(scope="module")
def ball():
    """Return (triangles, origins, directions, distance and face found ray by ray in one vmap)."""
    vertices, faces = meshes.icosphere(2)
    o, d = rays_at(np.random.default_rng(1), vertices, faces, 256)
    triangles = triangles_of(vertices, faces)
    found = jax.jit(jax.vmap(nearest, (None, 0, 0)))(triangle_table(triangles), o, d)
    return triangles, o, d, found


@pytest.mark.quick
def test_vmap_over_moved_meshes_and_rays(ball):
    triangles, o, d, (t, face) = ball
    scales = jnp.asarray([1.0, 0.5, 2.0])

    @jax.jit
    @jax.vmap
    def search(scale):
        table = triangle_table(replace(triangles, vertices=scale * triangles.vertices))
        return jax.vmap(nearest, (None, 0, 0))(table, scale * o, d)

    # Scaling by powers of two changes no bit
    many_t, many_face = search(scales)
    assert np.array_equal(many_face, np.tile(face, (3, 1)))
    hit = np.asarray(face) >= 0
    assert np.array_equal(many_t[:, hit], np.multiply.outer(scales, t)[:, hit])


def test_vmap_of_vmap_over_rays(ball):
    triangles, o, d, (t, face) = ball
    table = triangle_table(triangles)
    both = jax.jit(jax.vmap(jax.vmap(nearest, (None, 0, 0)), (None, 0, 0)))(
        table, o.reshape(4, 64, 3), d.reshape(4, 64, 3)
    )
    assert np.array_equal(both[0].ravel(), t) and np.array_equal(both[1].ravel(), face)


@pytest.mark.quick
def test_one_ray_finds_what_many_find(ball):
    triangles, o, d, (_, face) = ball
    one = jax.jit(nearest)
    table = triangle_table(triangles)
    assert [int(one(table, o[i], d[i])[1]) for i in range(0, 256, 8)] == np.asarray(face)[::8].tolist()


@pytest.mark.usefixtures("quick_compilation")
def test_packets_narrower_and_wider_than_a_leaf():
    vertices, faces = meshes.icosphere(3)
    triangles, rng, n = triangles_of(vertices, faces), np.random.default_rng(3), 128
    # The tree's 179 leaves are 1/13 of its width across; rays of a packet differ by up to 0.5
    widths = np.repeat([0.01, 0.1, 0.2, 0.4], n)[:, None]
    d = [0.1, -0.3, 1.0] + 0.5 * widths * rng.uniform(-1, 1, (4 * n, 3))
    d = jnp.asarray(d / np.linalg.norm(d, axis=1, keepdims=True), jnp.float32)
    o = jnp.asarray([-0.3, 0.9, -3.0] + 0.5 * widths * rng.uniform(-1, 1, (4 * n, 3)), jnp.float32)
    reach = jnp.asarray(rng.uniform(1.5, 4.5, 4 * n), jnp.float32)

    @jax.jit
    def search(mesh):
        table = triangle_table(mesh)
        blocked = jax.vmap(lambda o, d, reach: occluded_by_triangle(table, Ray(o, d), reach))(o, d, reach)
        return *jax.vmap(nearest, (None, 0, 0))(table, o, d), blocked

    (t, face, blocked), (true_t, true_face, true_blocked) = search(triangles), search(replace(triangles, bvh=None))
    assert 0.5 < np.mean(face >= 0) and 0.1 < np.mean(blocked) < 0.9
    assert np.array_equal(face, true_face) and np.allclose(t, true_t, rtol=1e-6)
    assert np.array_equal(blocked, true_blocked)


@pytest.mark.usefixtures("quick_compilation")
def test_float64():
    vertices, faces = meshes.icosphere(3)
    rng, n = np.random.default_rng(2), 1024  # in packets
    with jax.enable_x64(True):
        # Far off, where float32 would see steps of 0.06; half of the rays from one place
        o, d = 1e6 + 3 * unit_vectors(rng, n), unit_vectors(rng, n)
        o[: n // 2] = o[0]
        d = np.where((rng.uniform(size=n) < 0.9)[:, None], 1e6 - o + 0.5 * d, d)
        d /= np.linalg.norm(d, axis=1, keepdims=True)
        triangles = triangles_of(vertices + 1e6, faces, dtype=jnp.float64)
        results = [
            jax.jit(jax.vmap(nearest, (None, 0, 0)))(triangle_table(mesh), jnp.asarray(o), jnp.asarray(d))
            for mesh in (triangles, replace(triangles, bvh=None))
        ]
    (t, face), (true_t, true_face) = results
    assert t.dtype == np.float64 and 0.5 < np.mean(face >= 0) < 1
    # None of these rays is as near to an edge as float64 can tell: 1e-9 of its length
    assert np.array_equal(face, true_face) and np.allclose(t, true_t, rtol=1e-8)


def test_no_tree_is_compiled_without_one():
    one = Ray(jnp.zeros(3), jnp.asarray([0.0, 0.0, 1.0]))
    spheres = Spheres(jnp.zeros((1, 3)), jnp.ones(1), jnp.zeros(1), jnp.zeros(1, jnp.int32))
    few, many = (triangles_of(*meshes.icosphere(k), least=48) for k in (0, 1))
    for triangles, walks in ((None, False), (few, False), (many, True)):
        geometry = geometry_of(spheres, triangles)
        for f in (find, lambda *x: occluded(*x, jnp.float32(1))):
            assert ("custom_vmap_call" in str(jax.make_jaxpr(f)(geometry, one))) == walks


def floor_scene():
    """Return a white floor of 128 faces that fills the view, under a point light."""
    vertices, faces = meshes.coplanar_quads(GRID)
    return jaxrt.build(
        {
            "camera": {"position": [0, 6, 0], "target": [0, 0, 0], "up": [0, 0, -1], "width": 16, "height": 16},
            "materials": {"white": {"type": "diffuse", "albedo": [0.8, 0.8, 0.8]}},
            "meshes": [{"vertices": 20 * (vertices - [0.5, 0, 0.5]), "faces": faces, "material": "white"}],
            "lights": [{"position": [0.5, HEIGHT, 0.3], "intensity": [10, 10, 10]}],
        }
    )


def picture(scene, **options):
    return jaxrt.render(scene, 3, spp=1, max_depth=1, **options)


@pytest.mark.usefixtures("quick_compilation")
def test_wide_packets_draw_the_same_picture():
    """One packet of 2048 lanes, where rays walk in lockstep, each alone. The face found is the same, so is the rest."""
    scene = floor_scene()
    scene = replace(scene, camera=replace(scene.camera, width=64, height=32))
    assert np.allclose(picture(scene, tile=(64, 32)), picture(scene), rtol=1e-5, atol=0)


@pytest.mark.usefixtures("quick_compilation")
def test_rays_that_cannot_hit_find_nothing_and_keep_their_reach(ball):
    triangles, o, d, _ = ball
    lanes = np.arange(len(o))
    # Past the box or away from it, no way to go, or all of it; a few of each in every packet
    away = jnp.asarray(np.where(lanes % 3 == 0, 50, 0)[:, None] * np.ones(3), jnp.float32)
    farthest = jnp.where(lanes % 5 == 0, 0, jnp.float32(7))

    @jax.jit
    def search(mesh):
        table = triangle_table(mesh)

        def one(o, d, farthest):
            ray = Ray(o, d)
            return *find_triangle(table, ray, farthest), occluded_by_triangle(table, ray, farthest)

        return jax.vmap(one)(o + away, d, farthest)

    (t, face, blocked), (true_t, true_face, true_blocked) = search(triangles), search(replace(triangles, bvh=None))
    assert np.array_equal(face, true_face) and np.array_equal(blocked, true_blocked) and 0.1 < np.mean(face >= 0) < 0.6
    assert np.array_equal(t[face < 0], farthest[face < 0]) and np.allclose(t, true_t, rtol=1e-5)


@pytest.mark.usefixtures("quick_compilation")
def test_paths_end_on_nothing_and_on_lamps_but_go_on_from_black():
    """Where an albedo is 0 there is a derivative in it: of what would come that way."""
    scene = floor_scene()
    tables = replace(tables_of(jaxrt.with_parameters(scene, {"materials.albedo": jnp.zeros((1, 3))})), lights=None)
    ray = Ray(jnp.asarray([0.0, 2, 0]), jnp.asarray([0.0, -1, 0]))
    u, end = [jnp.float32(0.3)] * 4, tables.materials.ends[2]

    def goes_on(walk, valid, material):
        point = SurfacePoint(jnp.zeros(3), jnp.asarray([0.0, 1, 0]), jnp.float32(1e-6), jnp.int32(material))
        return event_at(tables, walk, Hit(jnp.int32(0), jnp.asarray(valid)), point, u)

    walk = walk_along(tables, ray, True)
    black = goes_on(walk, True, 0)
    assert bool(walk.alive) and bool(black.alive) and not black.throughput.any()
    assert not goes_on(walk, True, end).alive and not goes_on(walk, False, 0).alive
    assert (
        find(tables.geometry, ray, jnp.asarray(True)).valid and not find(tables.geometry, ray, jnp.asarray(False)).valid
    )


@pytest.mark.usefixtures("quick_compilation")
def test_derivatives_in_the_vertices_pass_the_tree():
    """Lowering the whole floor: the slope of the mean picture by jvp, by grad, and by differences.

    With the same random numbers the picture is smooth in the height h = 2 of the light above the floor, which fills
    the view: a sum of h/(h² + r²)^(3/2). A step of 0.02 is h/100, so the difference is wrong by about (1/100)² times a
    small number, and by rounding of 2⁻²⁴·100: below the tolerance of 1e-3.
    """
    scene = floor_scene()
    assert scene.triangles is not None and scene.triangles.bvh is not None

    def mean(vertices):
        return jnp.mean(picture(replace(scene, triangles=replace(scene.triangles, vertices=vertices))))

    at, down = scene.triangles.vertices, jnp.zeros_like(scene.triangles.vertices).at[:, 1].set(-1)
    _, slope = jax.jit(lambda v: jax.jvp(mean, (v,), (down,)))(at)
    gradient = jax.jit(jax.grad(mean))(at)
    step, value = 0.02, jax.jit(mean)
    difference = (value(at + step * down) - value(at - step * down)) / (2 * step)
    assert np.isclose(slope, difference, rtol=1e-3) and np.isclose(jnp.vdot(gradient, down), slope, rtol=1e-5)
    assert np.isfinite(gradient).all() and slope < 0


def test_walks_one_by_one_find_what_packets_find(ball):
    triangles, o, d, found = ball
    alone = replace(triangles, bvh=replace(triangles.bvh, packets=False))
    again = jax.jit(jax.vmap(nearest, (None, 0, 0)))(triangle_table(alone), o, d)
    for a, b in zip(found, again, strict=True):
        np.testing.assert_array_equal(a, b)
