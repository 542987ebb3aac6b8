"""The edges that diffuse surfaces see by their scattered rays: closed form, finite differences, what JAX asks of them.

Derivatives and finite differences are means over independent seeds. Their difference may be 5 standard errors, which 31
degrees of freedom exceed by chance once in 46,000 times (Student), and 1 % for steps of finite length.
"""

from dataclasses import replace
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from edge_scenes import box, plan, quad, quick_jit

import jaxrt
from jaxrt.boundary import clearance_of, sample_edges, splat
from jaxrt.boundary.clearance import EdgeSamples, Path, Turn
from jaxrt.boundary.outlines import bounced_edges
from jaxrt.boundary.trail import central_ray, path_through, trail_of
from jaxrt.core.records import Hit, Ray
from jaxrt.materials import scatter
from jaxrt.shapes import find, leave, surface_point
from jaxrt.transport.path import tables_of

SEEDS = 32
ERRORS = 5  # standard errors
WHITE = {"w": {"type": "diffuse", "albedo": [1, 1, 1]}, "b": {"type": "diffuse", "albedo": [0, 0, 0]}}


CRATE = [0.9, 1.1, -0.2], 0.4, 0.4, "b"
BALL = [-0.9, 1.2, 0.1], 0.5


@cache
def floor_below():
    """Return a white floor under a ball and a box, side by side, that hide parts of a white sky from it."""
    return jaxrt.build(
        {
            "camera": dict(position=[0, 0.3, 0], target=[0, 0, 0], up=[0, 0, -1], fov=30, width=4, height=4),
            "materials": WHITE,
            "triangles": box(*CRATE) + [{"vertices": [[-50, 0, 50], [50, 0, 50], [0, 0, -90]], "material": "w"}],
            "spheres": [{"center": BALL[0], "radius": BALL[1], "material": "b"}],
            "environment": {"radiance": [1, 1, 1]},
        }
    )


def hidden(vertices, center, radius):
    """Return the share of the floor's light that ball and box hide, mean over the picture (Lambert 1760, §§ 141 ff)."""
    half = 0.3 * np.tan(np.radians(15))
    x, z = np.meshgrid(*[(np.arange(16) + 0.5) / 8 * half - half] * 2)
    points = np.stack([x, 0 * x, z], -1).reshape(-1, 1, 1, 3)
    away = np.asarray(center)[0] - points[:, 0, 0]
    ball = radius[0] ** 2 * away[:, 1] / np.linalg.norm(away, axis=-1) ** 3
    corners = np.asarray(vertices)[:36].reshape(1, 12, 3, 3) - points
    ends = corners / np.linalg.norm(corners, axis=-1, keepdims=True)
    sides = np.cross(ends, np.roll(ends, -1, 2))
    sines = np.linalg.norm(sides, axis=-1)
    angles = np.arctan2(sines, np.sum(ends * np.roll(ends, -1, 2), -1))
    # A convex body is seen once by its front and once by its back
    return ball.mean() + np.abs(np.sum(angles / sines * sides[..., 1], -1)).sum(1).mean() / (4 * np.pi)


RISE, PUSH = np.float32([0, 1, 0]), np.float32([1, 0, 0.5])
MOVED = np.arange(39)[:, None] < 36
CORNERS = np.asarray([face["vertices"] for face in box(*CRATE)], np.float32).reshape(36, 3)
SWELL = np.concatenate([CORNERS - np.float32(CRATE[0]), np.zeros((3, 3), np.float32)])
SWING = np.concatenate([CORNERS[:, [1, 0, 2]] * np.float32([-1, 1, 0]), np.zeros((3, 3), np.float32)])
CLOSED = {
    "ball up": ("spheres.center", RISE[None]),
    "ball sideways": ("spheres.center", PUSH[None]),
    "ball's radius": ("spheres.radius", np.float32([1])),
    "box up": ("meshes.vertices", np.where(MOVED, RISE, 0)),
    "box sideways": ("meshes.vertices", np.where(MOVED, PUSH, 0)),
    "box larger": ("meshes.vertices", SWELL),
    "box swung": ("meshes.vertices", SWING),
}


@cache
def below():
    """Return edge samples of that scene, which serve whatever moves, for each of several seeds."""
    sample = quick_jit(partial(bounced_edges, plan=plan(8192, 1, geometry=True)))
    return [sample(floor_below(), jnp.uint32(seed))[0] for seed in range(32)]


@pytest.mark.parametrize("move", CLOSED)
def test_the_light_that_ball_and_box_hide_has_its_closed_form(move):
    """Means over 32 seeds: 31 degrees of freedom exceed 5 standard errors by chance once in 46,000 times."""
    name, direction = CLOSED[move]
    scene, start = floor_below(), jaxrt.parameters(floor_below())
    names = "meshes.vertices", "spheres.center", "spheres.radius"

    def moved(step):
        return {k: np.asarray(start[k], float) + (step * direction if k == name else 0) for k in names}

    expected = -(hidden(*moved(1e-4).values()) - hidden(*moved(-1e-4).values())) / 2e-4

    @jax.jit
    def change(samples):
        def clearance(value):
            return clearance_of(jaxrt.with_parameters(scene, {name: value}), samples)

        return splat(samples, jax.jvp(clearance, (start[name],), (jnp.asarray(direction),))[1], (4, 4))

    slope, noise = mean([np.mean(np.asarray(change(samples), float)) for samples in below()])
    bound = ERRORS * noise + 0.005 * abs(expected)
    assert abs(slope - expected) < bound < 0.1 * abs(expected)


# Finite differences


@cache
def still_life():
    """Return a ball and a box over a floor and before a wall, under a dim sky and a lamp that can be in the way."""
    return jaxrt.build(
        {
            "camera": dict(position=[0, 2.5, 5], target=[0, 0.5, 0], fov=40, width=16, height=16),
            "materials": {
                "white": {"type": "diffuse", "albedo": [0.7, 0.7, 0.7]},
                "red": {"type": "diffuse", "albedo": [0.8, 0.3, 0.2]},
            },
            "spheres": [{"center": [-0.7, 0.9, 0.2], "radius": 0.5, "material": "red"}],
            "triangles": box([0.8, 0.7, 0.1], 0.4, 0.5, "red")
            + quad([-3, 0, -2], [6, 0, 0], [0, 0, 5], "white")
            + quad([-3, 0, -2], [6, 0, 0], [0, 3, 0], "white"),
            "lights": [{"position": [0.1, 1.9, 0.6], "intensity": [3, 3, 3], "radius": 0.35}],
            "environment": {"radiance": [0.6, 0.6, 0.6]},
        }
    )


NAMES = ("camera.position", "lights.position", "meshes.vertices", "spheres.center", "spheres.radius")
BOX = np.repeat([[0, 1, 0], [0, 0, 0]], [36, 12], axis=0)
DEPTH = 2


def values_of(scene):
    return {name: jaxrt.parameters(scene)[name] for name in NAMES}


@jax.jit
def picture(values, key):
    return jaxrt.render(jaxrt.with_parameters(still_life(), values), key, spp=1024, max_depth=DEPTH)


@jax.jit
def inside(change, key):
    def one(values):
        return jaxrt.render(jaxrt.with_parameters(still_life(), values), key, spp=256, max_depth=DEPTH)

    return jax.jvp(one, (values_of(still_life()),), (change,))[1]


all_edges = quick_jit(partial(sample_edges, plan=plan(8192, DEPTH, geometry=True, lights=True)))


@cache
def edge_samples(seed):
    """Return samples of all edges, which serve whatever moves."""
    return all_edges(still_life(), jnp.uint32(seed))


@quick_jit
def at_edges(change, groups):
    scene = still_life()
    tangent = jax.jvp(partial(jaxrt.with_parameters, scene), (values_of(scene),), (change,))[1]
    moves = [jax.jvp(partial(clearance_of, samples=one), (scene,), (tangent,))[1] for one in groups]
    return sum(splat(one, move, (16, 16)) for one, move in zip(groups, moves, strict=True))


def quarters(picture):
    """Return the means (4,) of four parts of a picture."""
    return np.asarray(picture, float).reshape(2, 8, 2, 8, 3).mean((1, 3, 4)).ravel()


def mean(values):
    """Return the mean of rows, and its standard error."""
    values = np.stack(values)
    return values.mean(0), values.std(0, ddof=1) / np.sqrt(len(values))


MOVES = {
    "ball up": ("spheres.center", [[0, 1, 0]]),
    "ball's radius": ("spheres.radius", [1]),
    "box up": ("meshes.vertices", BOX),
    "lamp up": ("lights.position", [[0, 1, 0]]),
    "camera sideways": ("camera.position", [1, 0, 0]),
}


@pytest.mark.slow
@pytest.mark.parametrize("move", MOVES)
def test_what_moves_under_a_sky_and_in_indirect_light(move):
    name, direction = MOVES[move]
    start = values_of(still_life())
    change = {k: jnp.zeros_like(v) for k, v in start.items()}
    change[name] = jnp.broadcast_to(jnp.asarray(direction, jnp.float32), start[name].shape)
    step = 0.04
    ends = [{k: v + h * change[k] for k, v in start.items()} for h in (step, -step)]
    keys = range(SEEDS)
    reference, noise = mean([quarters((picture(ends[0], k) - picture(ends[1], k)) / (2 * step)) for k in keys])
    interior = [quarters(inside(change, k)) for k in keys]
    total, own = mean(
        [one + quarters(at_edges(change, edge_samples(k))) for k, one in zip(keys, interior, strict=True)]
    )
    bound = ERRORS * np.hypot(noise, own) + 0.01 * np.abs(reference).max()
    assert np.all(np.abs(total - reference) < bound)
    # The test can tell: without edges it fails
    assert np.any(np.abs(np.mean(interior, 0) - reference) > bound)
    assert np.linalg.norm(bound) < 0.5 * np.linalg.norm(reference)


# What is not asked for costs nothing


@pytest.mark.parametrize(
    ("changes", "depth", "geometry", "lights"),
    [
        # Nothing is seen after the only event
        (dict(environment=None), 1, True, True),
        # A point light hides nothing
        (dict(lights=None), 2, False, True),
        (dict(lights=None, environment=None), 2, True, True),
    ],
)
def test_nothing_is_sampled_where_nothing_moves(changes, depth, geometry, lights):
    scene = replace(still_life(), **changes)
    assert bounced_edges(scene, jnp.uint32(0), plan(512, depth, geometry=geometry, lights=lights)) == ()


# The path that a sample hangs on


def turns_of(scene, image, numbers, hits=None):
    """Return the last ray and the events of a path; hits: what it meets, by default what it finds."""
    tables = tables_of(scene)
    ray, turns = central_ray(tables.camera, *image), []
    for k, u in enumerate(numbers):
        hit = find(tables.geometry, ray) if hits is None else Hit(jnp.int32(hits[k]), jnp.ones((), bool))
        turns.append(Turn(ray, hit.index, u))
        point = surface_point(tables.geometry, ray, hit)
        ray = leave(point, scatter(tables.materials, point, -ray.direction, u).direction)
    return ray, turns


def check_trail(scene, image, numbers, names):
    """Compare the factors of a path's last ray, pulled back, with forward derivatives."""
    image, last = jnp.asarray(image, jnp.float32), len(numbers) - 1
    _, turns = turns_of(scene, image, numbers)
    rng = np.random.default_rng(3)
    factors = Ray(*jnp.asarray(rng.normal(size=(2, 3)), jnp.float32))
    path = Path(jax.tree.map(lambda *x: jnp.stack(x), *turns), jnp.int32(last), factors, image)
    view, trail = trail_of(tables_of(scene), path)
    one = partial(jax.tree.map, lambda x: x[None])
    samples = EdgeSamples(jnp.zeros((1, 1), jnp.int32), jnp.zeros((1, 1, 3)), None, one(view), (), one(trail))

    def moved(values):
        ray, _ = turns_of(jaxrt.with_parameters(scene, values), image, numbers, [turn.index for turn in turns])
        return jnp.vdot(factors.origin, ray.origin) + jnp.vdot(factors.direction, ray.direction)

    def linear(values):
        return clearance_of(jaxrt.with_parameters(scene, values), samples)[0]

    start = {name: jaxrt.parameters(scene)[name] for name in names}
    slopes = [jax.jit(lambda change, f=f: jax.jvp(f, (start,), (change,))[1]) for f in (moved, linear)]
    for name in names:
        direction = jnp.asarray(rng.normal(size=start[name].shape), jnp.float32)
        change = {k: direction if k == name else jnp.zeros_like(v) for k, v in start.items()}
        expected, found = (along(change) for along in slopes)
        assert float(found) == pytest.approx(float(expected), rel=1e-3, abs=1e-4), name
    return turns


@pytest.mark.slow
@pytest.mark.usefixtures("quick_compilation")
@pytest.mark.parametrize("image", [(5.5, 9.0), (11.0, 8.0), (8.0, 14.0)], ids=["ball", "box", "floor"])
def test_a_trail_is_what_forward_derivatives_find(image):
    numbers = [(jnp.float32(0.3), jnp.float32(0.4)), (jnp.float32(0.7), jnp.float32(0.6))]
    check_trail(still_life(), image, numbers, NAMES)


@cache
def glass_and_mirrors():
    """Return a ball of heavy glass, behind one that nothing sees, over a floor and between mirrors."""
    return jaxrt.build(
        {
            "camera": dict(position=[0, 1.2, 5], target=[0, 1, 0], fov=40, width=16, height=16),
            "materials": {
                "white": {"type": "diffuse", "albedo": [0.7, 0.7, 0.7]},
                "mirror": {"type": "mirror", "albedo": [0.9, 0.8, 0.7]},
                "water": {"type": "glass", "ior": 1.33},
                "flint": {"type": "glass", "ior": 1.7},
            },
            "spheres": [
                {"center": [0, 1, 0], "radius": 0.9, "material": "flint"},
                {"center": [40, 1, 0], "radius": 0.9, "material": "water"},
                {"center": [0.4, 1.2, -4], "radius": 1.6, "material": "mirror"},
            ],
            "triangles": quad([-9, 0, -9], [18, 0, 0], [0, 0, 18], "white")
            + quad([-9, 0, 8], [18, 0, 0], [0, 9, 0], "mirror"),
            "environment": {"radiance": [1, 1, 1]},
        }
    )


BENDING = ("camera.position", "camera.fov", "materials.ior", "meshes.vertices", "spheres.center", "spheres.radius")
THROUGH = 1 - 2.0**-24  # glass's number that lets light through, 0 the one that reflects it


@pytest.mark.slow
@pytest.mark.usefixtures("quick_compilation")
def test_a_trail_turns_in_glass_and_mirrors():
    """Through the ball, off the mirror behind it, and on from the floor."""
    numbers = [(jnp.float32(u), jnp.float32(0.6)) for u in (THROUGH, THROUGH, 0.5, 0.3)]
    turns = check_trail(glass_and_mirrors(), (9.5, 7.0), numbers, BENDING)
    assert [int(turn.index) for turn in turns] == [0, 0, 2, 3]


@pytest.mark.usefixtures("quick_compilation")
def test_a_path_through_glass_and_mirrors_has_its_numbers():
    """The events of a path are told from its places alone."""
    scene = glass_and_mirrors()
    lobes = [THROUGH, 0, THROUGH, 0.5]
    numbers = [(jnp.float32(u), jnp.float32(0.6)) for u in lobes]
    ray, turns = turns_of(scene, jnp.asarray([9.5, 7.0]), numbers)
    tables, known = tables_of(scene), jnp.ones((), bool)
    points = [surface_point(tables.geometry, turn.ray, Hit(turn.index, known)).position for turn in turns]
    points = jnp.stack([*points, ray.origin + ray.direction])
    index = jnp.stack([*(turn.index for turn in turns), jnp.int32(0)])
    found = path_through(tables, points, index, None)
    np.testing.assert_allclose(found.ray.direction[:4], [turn.ray.direction for turn in turns], atol=1e-5)
    specular = np.asarray(index[:4]) == 0
    assert specular.sum() >= 3
    np.testing.assert_array_equal(np.asarray(found.numbers[0][:4])[specular], np.asarray(lobes)[specular])


@pytest.mark.usefixtures("quick_compilation")
def test_a_path_that_turns_on_rough_metal_has_its_numbers():
    """By whichever lobe: the events told from places alone go from each to the next."""
    scene = jaxrt.build(
        {
            "camera": dict(position=[0, 1.2, 5], target=[0, 1, 0], fov=40, width=16, height=16),
            "materials": {
                "white": {"type": "diffuse", "albedo": [0.7, 0.7, 0.7]},
                "metal": {"type": "conductor", "albedo": [0.9, 0.8, 0.7], "roughness": 0.8},
            },
            "spheres": [
                {"center": [0, 1, 0], "radius": 0.9, "material": "metal"},
                {"center": [0, -50, 0], "radius": 50, "material": "white"},
            ],
            "environment": {"radiance": [1, 1, 1]},
        }
    )
    normal = np.array([0.2, -0.3, 0.9])
    ball = np.array([0, 1, 0]) + 0.9 * normal / np.linalg.norm(normal)
    points = jnp.asarray([ball, [0.8, -0.0064, 2.0], [0.5, 3, 4]], jnp.float32)

    @jax.jit
    def onward(coins):
        tables = tables_of(scene)
        turns = path_through(tables, points, jnp.asarray([0, 1, 1], jnp.int32), coins)

        def leaves(turn):
            point = surface_point(tables.geometry, turn.ray, Hit(turn.index, jnp.ones((), bool)))
            return scatter(tables.materials, point, -turn.ray.direction, turn.numbers).direction

        return jax.vmap(leaves)(turns)[:2], turns.numbers[0][0]

    steps = np.diff(points, axis=0)
    wanted = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    numbers = []
    for coin in (0.0, 0.999):
        found, number = onward(jnp.full(3, coin, jnp.float32))
        np.testing.assert_allclose(found, wanted, atol=2e-3)
        numbers.append(float(number))
    assert abs(numbers[0] - numbers[1]) > 0.1  # of the facets' lobe, and of the even one
