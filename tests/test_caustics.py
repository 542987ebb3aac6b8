"""Edges of light that comes by mirrors and glass: a closed form, finite differences, and what costs nothing.

One structure of a scene serves all: a ball of glass, a mirror and a floor, both parts of huge spheres.
"""

from dataclasses import replace
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from edge_scenes import plan, quick_jit

import jaxrt
from jaxrt.boundary import clearance_of, splat
from jaxrt.boundary.caustics import caustic_edges
from jaxrt.boundary.trail import with_trails
from jaxrt.transport.path import tables_of

SIZE, DEPTH = 8, 4
LIGHT, INTENSITY, RADIUS, ALBEDO = np.asarray([0.3, 2.0, 1.0]), 10.0, 0.4, 0.8
MIRROR = np.asarray([0.9, 0.8, 0.5])
HUGE = 1000
NAMES = ("camera.position", "lights.position", "lights.radius", "materials.ior", "spheres.center")
ERRORS = 5  # standard errors of 16 seeds, which 15 degrees of freedom exceed by chance once in 6,000 times (Student)


def scene_of(glass, mirror, light, camera):
    """Return a floor at height 0. glass: the ball's centre. mirror: the huge ball's."""
    return jaxrt.build(
        {
            "camera": dict(width=SIZE, height=SIZE, **camera),
            "materials": {
                "white": {"type": "diffuse", "albedo": [ALBEDO] * 3},
                "mirror": {"type": "mirror", "albedo": MIRROR.tolist()},
                "glass": {"type": "glass", "ior": 1.5},
            },
            "spheres": [
                {"center": [0, -HUGE, 0], "radius": HUGE, "material": "white"},
                {"center": mirror, "radius": HUGE, "material": "mirror"},
                {"center": glass, "radius": 0.6, "material": "glass"},
            ],
            "lights": [light],
        }
    )


@cache
def mirrored():
    """Return a floor, seen from above, and a mirror beside it in which it sees a light."""
    camera = dict(position=[0, 2, 0], target=[0, 0, 0], up=[0, 0, -1], fov=80)
    light = {"position": LIGHT.tolist(), "intensity": [INTENSITY] * 3, "radius": RADIUS}
    return scene_of([0, 500, 0], [0, 0, -2 - HUGE], light, camera)


@cache
def focused():
    """Return the middle of a glass ball's shadow, where all light comes through the ball."""
    camera = dict(position=[1.4, 1.6, -1.6], target=[0.5, 0, -1.0], fov=14)
    light = {"position": [-2, 5, 4], "intensity": [40, 40, 40], "radius": 0.7}
    return scene_of([0, 1.2, 0], [0, 5000, 0], light, camera)


@quick_jit
def edges(scene, seed):
    """Return samples of the edges of caustics alone."""
    own = plan(16384, DEPTH, geometry=True, lights=True)
    return with_trails(tables_of(scene), caustic_edges(scene, seed, own), True, own.devices)


def values_of(scene):
    return {name: jaxrt.parameters(scene)[name] for name in NAMES}


def change_of(scene, name, direction):
    """Return the change of all parameters where one goes in a direction: one program serves them all."""
    zeros = jax.tree.map(jnp.zeros_like, values_of(scene))
    return zeros | {name: jnp.broadcast_to(jnp.asarray(direction, jnp.float32), zeros[name].shape)}


@quick_jit
def slope(scene, groups, change):
    """Return the change (height, width, 3) of the picture by samples of edges."""
    tangent = jax.jvp(partial(jaxrt.with_parameters, scene), (values_of(scene),), (change,))[1]
    moves = [jax.jvp(partial(clearance_of, samples=s), (scene,), (tangent,))[1] for s in groups]
    return sum(splat(s, move, (SIZE, SIZE)) for s, move in zip(groups, moves, strict=True))


def slopes(scene, name, direction, seeds=16):
    """Return the changes (seeds, SIZE, SIZE, 3)."""
    change = change_of(scene, name, direction)
    return np.stack([np.asarray(slope(scene, _groups(scene, k), change), float) for k in range(seeds)])


_kept = {}


def _groups(scene, seed):
    if (id(scene), seed) not in _kept:
        _kept[id(scene), seed] = edges(scene, jnp.uint32(seed))
    return _kept[id(scene), seed]


def quarters(pictures):
    """Return the means (n, 2, 2, 3) of the four parts of pictures."""
    half = SIZE // 2
    return np.asarray(pictures, float).reshape(-1, 2, half, 2, half, 3).mean((2, 4))


MOVES = {
    "light up": ("lights.position", [[0, 1, 0]]),
    "light to the mirror": ("lights.position", [[0, 0, 1]]),
    "light larger": ("lights.radius", [1]),
    "mirror away": ("spheres.center", [[0, 0, 0], [0, 0, 1], [0, 0, 0]]),
    "floor up": ("spheres.center", [[0, 1, 0], [0, 0, 0], [0, 0, 0]]),
    "camera up": ("camera.position", [0, 1, 0]),
}


def by_image_light(move, step):
    """Return what the floor shows (SIZE, SIZE, 3) of the light's image, after a step: a ball lights as a point does."""
    name, direction = MOVES[move]
    light = LIGHT + step * np.asarray(direction[0]) if name == "lights.position" else LIGHT
    image = light * [1, 1, -1] + [0, 0, 2 * (step * (move == "mirror away") - 2)]
    floor = step * (move == "floor up")
    # Eight points each way in each pixel
    edge = (np.arange(8 * SIZE) + 0.5) / (4 * SIZE) - 1
    reach = (2 + step * (move == "camera up") - floor) * np.tan(np.radians(40))
    x, z = np.meshgrid(reach * edge, reach * edge)
    away = image - np.stack([x, np.full_like(x, floor), z], -1)
    radiance = ALBEDO / np.pi * INTENSITY * away[..., 1] / (away**2).sum(-1) ** 1.5
    return radiance.reshape(SIZE, 8, SIZE, 8).mean((1, 3))[..., None] * MIRROR


@pytest.mark.parametrize("move", MOVES)
def test_a_light_in_a_flat_mirror_is_an_image_light(move):
    name, direction = MOVES[move]
    if name == "lights.radius":
        # The intensity is held fixed, by a radiance that falls as the inverse square
        closed = 2 / RADIUS * by_image_light(move, 0)
    else:
        closed = (by_image_light(move, 1e-3) - by_image_light(move, -1e-3)) / 2e-3
    found, closed = quarters(slopes(mirrored(), name, direction)), quarters(closed)[0]
    error = found.std(0, ddof=1) / 4
    # The mirror is bent by 1/1000
    bound = ERRORS * error + 0.02 * np.abs(closed).max()
    assert np.all(np.abs(found.mean(0) - closed) < bound)
    assert np.any(np.abs(closed) > bound)


@jax.jit
def picture(scene, key):
    return jaxrt.render(scene, key, spp=2048, max_depth=DEPTH)


@jax.jit
def inside(scene, change, key):
    def one(values):
        return jaxrt.render(jaxrt.with_parameters(scene, values), key, spp=256, max_depth=DEPTH)

    return jax.jvp(one, (values_of(scene),), (change,))[1]


FOCUS = {
    "light": ("lights.position", [[1, 0, 0]], 0.05),
    "glass ball": ("spheres.center", [[0, 0, 0], [0, 0, 0], [1, 0, 0]], 0.02),
    "ior": ("materials.ior", [1], 0.01),
}


@pytest.mark.parametrize("move", FOCUS)
def test_light_through_a_ball_of_glass(move):
    name, direction, step = FOCUS[move]
    start, change = values_of(focused()), change_of(focused(), name, direction)
    ends = [jaxrt.with_parameters(focused(), {k: v + h * change[k] for k, v in start.items()}) for h in (step, -step)]
    reference = quarters([(picture(ends[0], k) - picture(ends[1], k)) / (2 * step) for k in range(16)])
    interior = quarters([inside(focused(), change, k) for k in range(16)])
    found = interior + quarters(slopes(focused(), name, direction))
    error = np.hypot(found.std(0, ddof=1), reference.std(0, ddof=1)) / 4
    expected = reference.mean(0)
    bound = ERRORS * error + 0.01 * np.abs(expected).max()
    assert np.all(np.abs(found.mean(0) - expected) < bound)
    # The test can tell: without edges it fails
    assert np.any(np.abs(interior.mean(0) - expected) > bound)


@pytest.mark.parametrize("lacks", ["light of some size", "mirror or glass", "event", "diffuse surface"])
def test_nothing_is_sampled_where_no_such_light_is(lacks):
    scene, depth = mirrored(), 1 if lacks == "event" else DEPTH
    if lacks == "light of some size":
        scene = replace(scene, lights=replace(scene.lights, radius=None))
    if lacks == "mirror or glass":
        scene = replace(scene, materials=type(scene.materials).of(diffuse=scene.materials.diffuse))
    if lacks == "diffuse surface":
        scene = replace(scene, materials=type(scene.materials).of(mirror=scene.materials.mirror))
    assert caustic_edges(scene, jnp.uint32(0), plan(512, depth, geometry=True, lights=True)) == ()
