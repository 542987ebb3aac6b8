"""Many spheres: what their tree finds is what the loop finds, and the picture is the same to the bit."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrt
from jaxrt.core.records import Ray
from jaxrt.kernels.native import map_packets
from jaxrt.shapes import Spheres, find, geometry_of, occluded, sphere_topology
from jaxrt.shapes.sphere import MIN_SPHERES, WALL, with_more, without_more
from tests.oracle import unit_vectors

BALLS, WALLS, LAMPS = 200, 6, 2
PACKET, RAYS = 64, 4096
QUICK = {"xla_backend_optimization_level": 0}  # programs that are compiled in half the time


def crowd(seed=0):
    """Return spheres: balls of many sizes in a cube, some inside of others or twice there, and six walls around."""
    rng = np.random.default_rng(seed)
    center, radius = rng.uniform(-10, 10, (BALLS, 3)), rng.uniform(0.05, 0.6, BALLS)
    center[1], radius[1] = center[0], radius[0]
    center[3], radius[3] = center[2], radius[2] / 2
    center[4], radius[4] = 0, 0.5  # at the origin, where its power takes the form of huge ones
    around = np.concatenate([1000.0 * np.eye(3), -1000.0 * np.eye(3)])
    center, radius = np.concatenate([around, center]), np.concatenate([np.full(WALLS, 988.0), radius])
    tree, outside = sphere_topology(center, radius)
    c, r = (jnp.asarray(x, jnp.float32) for x in (center, radius))
    return Spheres(c, r, jnp.zeros_like(r), jnp.zeros(len(r), jnp.int32), tree, outside)


def rays(rng, center):
    """Return origins, directions and reaches: half of the rays random, half towards balls in bundles."""
    o = rng.uniform(-11, 11, (RAYS, 3)).astype(np.float32)
    d = unit_vectors(rng, RAYS)
    half = RAYS // 2
    o[half:] = np.repeat(o[half::PACKET], PACKET, 0)
    aim = np.repeat(center[rng.integers(WALLS, len(center), half // PACKET)], PACKET, 0)
    d[half:] = aim + rng.uniform(-0.7, 0.7, (half, 3)) - o[half:]
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    reach = rng.uniform(0.5, 15, RAYS).astype(np.float32)
    return o, d.astype(np.float32), np.where(rng.uniform(size=RAYS) < 0.2, 0, reach).astype(np.float32)


@jax.jit
def search(spheres, o, d, reach):
    """Return what rays meet first, whether that is anything, and whether anything is within reach."""

    def packet(operands, k):
        geometry, *rows = operands
        o, d, reach = (x.reshape(-1, PACKET, *x.shape[1:])[k] for x in rows)

        def one(o, d, reach):
            hit = find(geometry, Ray(o, d), reach > 0)
            return hit.index, hit.valid, occluded(geometry, Ray(o, d), reach)

        return jax.vmap(one)(o, d, reach)

    found = map_packets(packet, (geometry_of(spheres, None), o, d, reach), jnp.arange(RAYS // PACKET, dtype=jnp.int32))
    return [x.reshape(-1) for x in found]


@pytest.fixture(scope="module")
def spheres():
    """Return a crowd with two lamps after it."""
    more = jnp.asarray([[0, 9, 0], [5, 9, 5]], jnp.float32), jnp.asarray([0.5, 0.7], jnp.float32)
    return with_more(crowd(), *more, jnp.ones(LAMPS, jnp.int32))


def assert_same(spheres, seed):
    rows = rays(np.random.default_rng(seed), np.asarray(spheres.center))
    tree = search(spheres, *rows)
    loop = search(replace(spheres, bvh=None, outside=None), *rows)
    for a, b in zip(tree, loop, strict=True):
        assert np.array_equal(a, b), np.flatnonzero(np.asarray(a) != np.asarray(b))
    index, valid, blocked = map(np.asarray, tree)
    assert np.array_equal(valid, rows[2] > 0), "all rays that are wanted end on something: there are walls"
    return index[valid], blocked[valid]


@pytest.mark.quick
def test_tree_finds_what_the_loop_finds(spheres):
    index, blocked = assert_same(spheres, 1)
    assert 0.2 < np.mean(index < WALLS) < 0.8 and 0.1 < np.mean(blocked) < 0.9
    assert (index >= WALLS + BALLS).any(), "a lamp is seen"
    assert not (index == WALLS + 1).any(), "of two equal spheres the first is hit"


def test_moved_and_grown_spheres_have_true_boxes(spheres):
    rng = np.random.default_rng(2)
    n = spheres.radius.shape[0] - LAMPS
    center = spheres.center.at[WALLS:n].add(jnp.asarray(rng.normal(0, 4, (n - WALLS, 3)), jnp.float32))
    radius = spheres.radius.at[WALLS:n].multiply(jnp.asarray(rng.uniform(0.3, 3, n - WALLS), jnp.float32))
    assert_same(replace(spheres, center=center, radius=radius), 3)


def test_walls_stay_outside_and_few_have_no_tree():
    rng = np.random.default_rng(0)
    center, radius = rng.uniform(-1, 1, (MIN_SPHERES, 3)), np.full(MIN_SPHERES, 0.1)
    radius[[5, 2]] = 1.01 * WALL * 0.1
    tree, outside = sphere_topology(center, radius)
    assert outside.tolist() == [2, 5]
    rows = np.asarray(tree.faces).ravel()
    assert sorted(rows[rows >= 0]) == sorted(set(range(MIN_SPHERES)) - {2, 5})
    assert sphere_topology(center[1:], radius[1:]) is None


def test_table_without_lamps_is_that_of_the_spheres(spheres):
    table = geometry_of(spheres, None).spheres
    n = spheres.radius.shape[0] - LAMPS
    bare = without_more(table, n)
    assert bare.radius.shape == (n,) and bare.outside.tolist() == list(range(WALLS))
    assert table.outside.tolist() == [*range(WALLS), n, n + 1]


def test_all_in_the_tree_and_one_outside_are_searched_too():
    rng = np.random.default_rng(0)
    for walls in (0, 1):
        center, radius = rng.uniform(-1, 1, (MIN_SPHERES, 3)), np.full(MIN_SPHERES, 0.1)
        radius[:walls] = 100
        spheres = Spheres(
            *(jnp.asarray(x, jnp.float32) for x in (center, radius, 0 * radius)), jnp.zeros(MIN_SPHERES, int)
        )
        tree, outside = sphere_topology(center, radius)
        geometry = geometry_of(replace(spheres, bvh=tree, outside=outside), None)
        assert len(outside) == walls
        rays = Ray(jnp.zeros((4, 3)), jnp.ones((4, 3)))
        hits = jax.eval_shape(lambda g, r: jax.vmap(find, (None, 0))(g, r), geometry, rays)
        assert hits.index.shape == jax.eval_shape(jax.vmap(occluded, (None, 0, 0)), geometry, rays, jnp.ones(4)).shape


def of_balls():
    """Return a scene of many balls on a floor, and the same without their tree."""
    rng, n = np.random.default_rng(4), MIN_SPHERES + 16
    numbers = zip(rng.uniform(-5, 5, (n, 3)).tolist(), rng.uniform(0.2, 0.7, n).tolist(), strict=True)
    balls = [{"center": place, "radius": radius, "material": "white"} for place, radius in numbers]
    scene = jaxrt.build(
        {
            "camera": {"position": [0, 0, 16], "width": 16, "height": 16},
            "materials": {"white": {"type": "diffuse", "albedo": [0.8, 0.7, 0.6]}},
            "spheres": [{"center": [0, -1006, 0], "radius": 1000, "material": "white"}, *balls],
            "lights": [{"position": [3, 12, 9], "intensity": 900}],
        }
    )
    assert scene.spheres.bvh is not None and scene.spheres.outside.tolist() == [0]
    return scene, replace(scene, spheres=replace(scene.spheres, bvh=None, outside=None))


@pytest.mark.usefixtures("quick_compilation")
def test_picture_is_that_of_the_loop():
    pictures = [np.asarray(jaxrt.render(s, 3, spp=4, max_depth=2)) for s in of_balls()]
    assert np.array_equal(*pictures) and np.ptp(pictures[0]) > 0.1


@pytest.mark.slow
def test_gradient_is_that_of_the_loop():
    """In the centres, where balls hide one another and are in each other's shadows."""

    def slope(scene):
        def loss(center):
            moved = jaxrt.with_parameters(scene, {"spheres.center": center})
            return jnp.sum(jaxrt.render(moved, 3, spp=4, max_depth=1, devices=jax.devices()[:1]) ** 2)

        return np.asarray(jax.jit(jax.grad(loss), compiler_options=QUICK)(scene.spheres.center))

    found, expected = map(slope, of_balls())
    assert np.abs(expected).max() > 0.01
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())
