"""Scenes with moving shadows, and what derivatives of their pictures are compared by."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

import jaxrt
from jaxrt.boundary import Plan

AXES = np.eye(3, dtype=np.float32)
# Programs that run a few times only: compiled three times as fast, they run eight times as long
quick_jit = partial(jax.jit, compiler_options={"xla_backend_optimization_level": 0})


def quad(corner, first, second, material):
    """Return a parallelogram as two triangles of a scene description."""
    a, b, c = (np.asarray(v, float) for v in (corner, first, second))
    faces = [[a, a + b, a + b + c], [a, a + b + c, a + c]]
    return [{"vertices": np.asarray(face).tolist(), "material": material} for face in faces]


def box(center, half, turn, material):
    """Return a cube, turned about the vertical, as twelve triangles."""
    signs = np.asarray([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    c, s = np.cos(turn), np.sin(turn)
    corners = half * signs @ np.asarray([[c, 0, -s], [0, 1, 0], [s, 0, c]]) + center
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [face for a, b, c, d in sides for face in ((a, b, c), (a, c, d))]
    return [{"vertices": corners[list(face)].tolist(), "material": material} for face in faces]


def corner_room(radius, width=64, height=64):
    """Return a ball and a box (its vertices come first) on a floor, in the corner of two walls, under one light."""
    triangles = box([0.8, 0.46, 0.3], 0.4, 0.4, "red")
    triangles += quad([-3, 0, -3], [8, 0, 0], [0, 0, 8], "white")
    triangles += quad([-3, 0, -3], [8, 0, 0], [0, 5, 0], "red") + quad([-3, 0, -3], [0, 0, 8], [0, 5, 0], "green")
    return jaxrt.build(
        {
            "camera": dict(position=[0, 2.2, 5], target=[0, 0.2, 0.2], fov=38, width=width, height=height),
            "materials": {
                "white": {"type": "diffuse", "albedo": [0.8, 0.8, 0.8]},
                "red": {"type": "diffuse", "albedo": [0.8, 0.3, 0.2]},
                "green": {"type": "diffuse", "albedo": [0.2, 0.7, 0.3]},
            },
            "spheres": [{"center": [-0.6, 0.8, 0], "radius": 0.6, "material": "white"}],
            "triangles": triangles,
            "lights": [{"position": [0.5, 4, 1], "intensity": [30, 30, 30], "radius": radius}],
        }
    )


def plan(n, depth, *, geometry=False, lights=False):
    """Return a plan on one device."""
    return Plan(n, depth, geometry, lights, (jax.devices()[0],))


def moved(scene, name, direction, step):
    """Return the scene with a parameter moved by a step along a direction."""
    value = jaxrt.parameters(scene)[name] + step * jnp.broadcast_to(
        jnp.asarray(direction, jnp.float32), jaxrt.parameters(scene)[name].shape
    )
    return jaxrt.with_parameters(scene, {name: value})


def finite_difference(scene, name, direction, step, spp, depth, key=10):
    """Return the central difference of pictures drawn with common random numbers, in float64."""
    pictures = [
        np.asarray(jaxrt.render(moved(scene, name, direction, h), key, spp=spp, max_depth=depth), float)
        for h in (step, -step)
    ]
    return (pictures[0] - pictures[1]) / (2 * step)


def cells(picture, k=4):
    """Return means over k × k pixels."""
    h, w = picture.shape[:2]
    return np.asarray(picture, float).reshape(h // k, k, w // k, k, 3).mean((1, 3))


def bumps(picture):
    """Return 16 functionals: means weighted by Gaussians, smooth where box pixels have kinks."""
    h, w = picture.shape[:2]
    y, x = np.mgrid[:h, :w] + 0.5
    places = [((i + 0.5) * h / 4, (j + 0.5) * w / 4) for i in range(4) for j in range(4)]
    weights = [np.exp(-((y - a) ** 2 + (x - b) ** 2) / (2 * (6 * h / 64) ** 2)) for a, b in places]
    return np.asarray([(np.asarray(picture, float) * g[..., None]).mean((0, 1)) for g in weights])


def relative(value, reference):
    """Return the relative L2 distance."""
    return float(np.linalg.norm(value - reference) / np.linalg.norm(reference))
