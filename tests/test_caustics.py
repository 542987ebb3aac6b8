"""Edges of light that comes by mirrors and glass: closed forms, finite differences, and what costs nothing."""

from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from edge_scenes import plan, quad

import jaxrt
from jaxrt.boundary import clearance_of, splat
from jaxrt.boundary.caustics import caustic_edges

WHITE = {"type": "diffuse", "albedo": [0.8, 0.8, 0.8]}
LIGHT, INTENSITY = np.asarray([0.3, 2.0, 1.0]), 10.0


@cache
def mirrored():
    """Return a patch of floor, seen from above, and a mirror beside it in which it sees a light."""
    return jaxrt.build(
        {
            "camera": dict(position=[0, 2, 0], target=[0, 0, 0], up=[0, 0, -1], fov=80, width=8, height=8),
            "materials": {"white": WHITE, "mirror": {"type": "mirror", "albedo": [0.9, 0.8, 0.5]}},
            "triangles": quad([-9, 0, -2], [18, 0, 0], [0, 0, 18], "white")
            + quad([-9, -1, -2], [18, 0, 0], [0, 9, 0], "mirror"),
            "lights": [{"position": LIGHT.tolist(), "intensity": [INTENSITY] * 3, "radius": 0.4}],
        }
    )


FLOOR = np.repeat([[1], [0]], [6, 6], axis=0)
MOVES = {
    "light up": ("lights.position", [[0, 1, 0]]),
    "light to the mirror": ("lights.position", [[0, 0, 1]]),
    "light larger": ("lights.radius", [1]),
    "mirror away": ("meshes.vertices", (1 - FLOOR) * [0, 0, 1]),
    "floor up": ("meshes.vertices", FLOOR * [0, 1, 0]),
    "camera sideways": ("camera.position", [1, 0, 0]),
}


def change_of(scene, name, direction):
    """Return the scene's tangent along a change of one parameter."""
    value = jaxrt.parameters(scene)[name]
    change = jnp.broadcast_to(jnp.asarray(direction, jnp.float32), value.shape)
    return jax.jvp(lambda v: jaxrt.with_parameters(scene, {name: v}), (value,), (change,))[1]


def slope(scene, groups, name, direction):
    """Return the change (height, width, 3) of the picture by samples of edges."""
    tangent, size = change_of(scene, name, direction), (scene.camera.width, scene.camera.height)
    moves = [jax.jvp(partial(clearance_of, samples=s), (scene,), (tangent,))[1] for s in groups]
    return np.asarray(sum(splat(s, move, size) for s, move in zip(groups, moves, strict=True)), float)


@cache
def samples(geometry):
    return jax.jit(lambda seed: caustic_edges(mirrored(), seed, plan(16384, 2, geometry=geometry, lights=True)))(
        jnp.uint32(1)
    )


def by_image_light(move, step):
    """Return what the floor shows (8, 8, 3) of the light's image, after a step: a ball lights as a point does."""
    name, direction = MOVES[move]
    light = LIGHT + step * np.asarray(direction[0]) if name == "lights.position" else LIGHT
    image = light * [1, 1, -1] + [0, 0, 2 * (step * (move == "mirror away") - 2)]
    floor, across = step * (move == "floor up"), step * (move == "camera sideways")
    # Eight points each way in each pixel
    edge = (np.arange(64) + 0.5) / 64 * 2 - 1
    reach = (2 - floor) * np.tan(np.radians(40))
    x, z = np.meshgrid(across + reach * edge, reach * edge)
    away = image - np.stack([x, np.full_like(x, floor), z], -1)
    radiance = 0.8 / np.pi * INTENSITY * away[..., 1] / (away**2).sum(-1) ** 1.5
    return radiance.reshape(8, 8, 8, 8).mean((1, 3))[..., None] * [0.9, 0.8, 0.5]


@pytest.mark.parametrize("move", MOVES)
def test_a_light_in_a_flat_mirror_is_an_image_light(move):
    name, direction = MOVES[move]
    closed = (by_image_light(move, 1e-3) - by_image_light(move, -1e-3)) / 2e-3
    if name == "lights.radius":
        closed = 2 / 0.4 * by_image_light(move, 0)
    print()
    for geometry in (False, True):
        found = slope(mirrored(), samples(geometry), name, direction)
        print(
            move,
            geometry,
            found.mean((0, 1)),
            closed.mean((0, 1)),
            found.mean() / closed.mean(),
            np.linalg.norm(found - closed) / np.linalg.norm(closed),
        )
        a, b = (v.reshape(2, 4, 2, 4, 3).mean((1, 3))[..., 0].ravel() for v in (found, closed))
        print(a, b)
