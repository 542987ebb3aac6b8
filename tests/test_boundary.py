"""The edge term against closed forms and finite differences.

Finite differences are of 384 samples a pixel: their noise in 4 × 4 cells is below 2 %, in smooth functionals below
0.8 % (measured from two seeds). Tolerances are the noise, the truncation of kinks in box pixels, and the edge term's own
noise together, about twice what was measured.
"""

from dataclasses import replace
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from edge_scenes import AXES, bumps, cells, corner_room, finite_difference, moved, plan, relative

import jaxrt
from jaxrt.boundary import clearance_of, edge_tangent, sample_edges, splat
from jaxrt.boundary.silhouettes import mesh_edges

X, Y, Z = AXES
ALL = {"lights.position", "lights.radius", "spheres.center", "spheres.radius", "meshes.vertices"} | {
    "camera.position",
    "camera.target",
    "camera.fov",
}


@cache
def scene_of(radius):
    return corner_room(radius)


def tangent_of(scene, changes):
    """Return the scene's tangent for changes of parameters by name."""
    parameters = {name: jaxrt.parameters(scene)[name] for name in changes}
    wide = {k: jnp.broadcast_to(jnp.asarray(v, jnp.float32), parameters[k].shape) for k, v in changes.items()}
    return jax.jvp(partial(jaxrt.with_parameters, scene), (parameters,), (wide,))[1]


@partial(jax.jit, static_argnames="depth")
def interior_part(scene, values, changes, depth):
    """Return the derivative inside of edges along changes of many parameters, so that one program serves them all."""

    def picture(values):
        return jaxrt.render(jaxrt.with_parameters(scene, values), 99, spp=128, max_depth=depth)

    return jax.jvp(picture, (values,), (changes,))[1]


def interior(scene, changes, depth, names):
    values = {name: jaxrt.parameters(scene)[name] for name in names if name in jaxrt.parameters(scene)}
    zeros = {name: jnp.zeros_like(value) for name, value in values.items()}
    wide = {k: jnp.broadcast_to(jnp.asarray(v, jnp.float32), values[k].shape) for k, v in changes.items()}
    return np.asarray(interior_part(scene, values, zeros | wide, depth), float)


def edges(scene, changes, edge_plan, seed=7):
    return np.asarray(edge_tangent(scene, tangent_of(scene, changes), jnp.uint32(seed), edge_plan), float)


# Silhouettes


def test_edges_of_a_box_are_found_once_though_its_triangles_share_no_vertex():
    triangles = scene_of(0.0).triangles
    box = replace(triangles, vertices=triangles.vertices[:36], faces=triangles.faces[:12])
    found = jax.jit(mesh_edges)(box)
    ends = np.asarray(box.vertices)[np.asarray(found.vertices)[np.asarray(found.used)]]
    lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=-1)
    assert len(lengths) == 18
    np.testing.assert_allclose(np.sort(lengths), [0.8] * 12 + [0.8 * np.sqrt(2)] * 6, rtol=1e-5)
    faces = np.asarray(found.faces)[np.asarray(found.used)]
    assert np.all(faces[:, 0] != faces[:, 1])


def test_faces_without_area_have_no_edges():
    triangles = scene_of(0.0).triangles
    flat = triangles.vertices.at[2].set((triangles.vertices[0] + triangles.vertices[1]) / 2)
    found = jax.jit(mesh_edges)(replace(triangles, vertices=flat))
    assert not np.any((np.asarray(found.faces) == 0).any(-1) & np.asarray(found.used))


# A closed form


def straight_edge_scene(light):
    """Return a floor and, above the camera, a half-plane whose edge runs through A, B: one straight shadow edge."""
    triangles = [{"vertices": [[-0.2, 1.5, -1], [0.1, 1.5, 2], [-60, 1.5, 0.5]], "material": "white"}]
    triangles += [{"vertices": [[-90, 0, 90], [90, 0, 90], [0, 0, -90]], "material": "white"}]
    return jaxrt.build(
        {
            "camera": dict(position=[0, 0.8, 2], target=[0, 0, 0.8], fov=30, width=64, height=64),
            "materials": {"white": {"type": "diffuse", "albedo": [0.8, 0.8, 0.8]}},
            "triangles": triangles,
            "lights": [{"position": list(light), "intensity": [30, 30, 30]}],
        }
    )


def straight_edge_rows(light, axis):
    """Return the derivative (64,) of the sums of pixel rows by a light coordinate, in float64.

    The floor point of image point (u, v) is o − (o_y/D_y) D, and it lies on the shadow's edge where light, A and B are
    coplanar with it: a linear equation in u. The row sum changes by radiance times the speed of that u.
    """
    a, b = np.asarray([-0.2, 1.5, -1]), np.asarray([0.1, 1.5, 2])
    eye = np.asarray([0, 0.8, 2.0])
    forward = np.asarray([0, -0.8, -1.2]) / np.linalg.norm([0, -0.8, -1.2])
    right = np.cross(forward, [0, 1, 0]) / np.linalg.norm(np.cross(forward, [0, 1, 0]))
    up = np.cross(right, forward)
    size = 2 * np.tan(np.radians(15)) / 64
    nodes, weights = np.polynomial.legendre.leggauss(8)
    v = (np.arange(64)[:, None] + (nodes + 1) / 2).ravel()
    base = forward + size * (32 - v)[:, None] * up

    def crossing(y):
        n = np.cross(b - a, a - y)
        offset = n @ (eye - y)
        # offset · D_y − eye_y · n·D = 0 with D = base + size (u − 32) right
        slope = size * (offset * right[1] - eye[1] * (n @ right))
        return 32 - (offset * base[:, 1] - eye[1] * (base @ n)) / slope

    y = np.asarray(light, float)
    h = 1e-5 * np.eye(3)[axis]
    speed = (crossing(y + h) - crossing(y - h)) / 2e-5
    direction = base + size * (crossing(y) - 32)[:, None] * right
    x = eye - eye[1] / direction[:, 1:2] * direction
    distance = np.linalg.norm(y - x, axis=-1)
    radiance = 0.8 / np.pi * 30 * y[1] / distance**3
    inside = (crossing(y) > 0) & (crossing(y) < 64)
    # The half-plane reaches to the left: light is lost where the edge moves to the right
    return (np.where(inside, -radiance * speed, 0).reshape(64, 8) * weights / 2).sum(-1)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_straight_shadow_edge_has_its_closed_form(axis):
    light = (0.5, 3.0, 0.4)
    scene, reference = straight_edge_scene(light), straight_edge_rows(light, axis)
    error = {}
    for n in (4096, 16384, 131072):
        rows = edges(scene, {"lights.position": AXES[axis][None]}, plan(n, 1, lights=True))[..., 0].sum(1)
        error[n] = relative(rows, reference)
    # One sample in 16384 of such a line has about the weight 1/64 of a row's: errors like 1/n until float32's 5e-4
    assert np.all(reference != 0)
    assert error[16384] < 1e-2
    assert error[131072] < 2e-3
    assert error[131072] < error[4096] / 5


# Finite differences


@pytest.mark.parametrize("radius", [0.0, 0.5])
@pytest.mark.parametrize("direction", [X, Z], ids=["x", "z"])
def test_light_position(radius, direction):
    scene, depth = scene_of(radius), 1 if radius == 0 else 3
    change = {"lights.position": direction[None]}
    reference = finite_difference(scene, "lights.position", direction[None], 0.03, 384, depth)
    inside = interior(scene, change, depth, ["lights.position", "lights.radius"])
    total = inside + edges(scene, change, plan(16384, depth, lights=True))
    assert relative(cells(total), cells(reference)) < 0.05
    assert relative(bumps(total), bumps(reference)) < 0.02
    assert relative(cells(inside), cells(reference)) > 0.25
    assert relative(bumps(inside), bumps(reference)) > 0.1


def test_large_close_light():
    """A light of radius 0.9 close above: what is held fixed inside and at the edges must be the same."""
    scene = moved(scene_of(0.5), "lights.radius", [1.0], 0.4)
    scene = moved(scene, "lights.position", (0, -1.4, 0), 1.0)
    reference = finite_difference(scene, "lights.position", X[None], 0.03, 384, 3)
    change = {"lights.position": X[None]}
    inside = interior(scene, change, 3, ["lights.position", "lights.radius"])
    total = inside + edges(scene, change, plan(16384, 3, lights=True))
    assert relative(bumps(total), bumps(reference)) < 0.02
    assert relative(bumps(inside), bumps(reference)) > 0.1


def test_indirect_light_has_its_share_of_the_edges():
    scene, change = scene_of(0.5), {"lights.position": X[None]}
    reference = finite_difference(scene, "lights.position", X[None], 0.03, 768, 3)
    inside = interior(scene, change, 3, ["lights.position", "lights.radius"])
    (shadows, *outlines) = sample_edges(scene, jnp.uint32(7), plan(16384, 3, lights=True))
    direct = replace(shadows, pixel=shadows.pixel[:, :1], weight=shadows.weight[:, :1])
    tangent = tangent_of(scene, change)

    def part(samples):
        moves = jax.jvp(partial(clearance_of, samples=samples), (scene,), (tangent,))[1]
        return np.asarray(splat(samples, moves, (64, 64)), float)

    seen = inside + sum(part(samples) for samples in outlines)
    without, complete = (relative(bumps(seen + part(s)), bumps(reference)) for s in (direct, shadows))
    assert complete < 0.015
    assert without > 2 * complete


GEOMETRY = {
    "sphere x": ("spheres.center", X[None], 0.01),
    "sphere z": ("spheres.center", Z[None], 0.02),
    "sphere radius": ("spheres.radius", [1.0], 0.01),
    "box": ("meshes.vertices", np.repeat([[0, 1, 0], [0, 0, 0]], [36, 18], axis=0), 0.02),
    "vertex": ("meshes.vertices", None, 0.02),
    "camera": ("camera.position", X, 0.01),
}


def one_vertex(scene):
    """Return the direction in which all triangles at the box's corner nearest to the light move up."""
    vertices = np.asarray(jaxrt.parameters(scene)["meshes.vertices"])
    corner = vertices[np.argmax(vertices[:36] @ [0.3, 3, 1])]
    return np.where((np.abs(vertices - corner) < 1e-5).all(-1)[:, None], Y, 0)


@pytest.mark.parametrize("case", GEOMETRY)
def test_moving_shapes_and_camera(case):
    scene = scene_of(0.0)
    name, direction, step = GEOMETRY[case]
    direction = one_vertex(scene) if direction is None else np.asarray(direction, np.float32)
    reference = finite_difference(scene, name, direction, step, 384, 1)
    inside = interior(scene, {name: direction}, 1, sorted(ALL - {"lights.position"}))
    total = inside + edges(scene, {name: direction}, plan(16384, 1, geometry=True, lights=True))
    assert relative(cells(total), cells(reference)) < 0.06
    assert relative(cells(inside), cells(reference)) > 0.5


def test_a_sphere_light_casts_the_shadow_of_another_and_is_seen_itself():
    scene = jaxrt.build(
        {
            "camera": dict(position=[0, 2.5, 6], target=[0, 0.6, 0], fov=45, width=32, height=32),
            "materials": {"white": {"type": "diffuse", "albedo": [0.8, 0.6, 0.4]}},
            "spheres": [{"center": [0, -1000, 0], "radius": 1000, "material": "white"}],
            "lights": [
                {"position": [0.3, 4, 0.5], "intensity": [60, 50, 40], "radius": 0.2},
                {"position": [-0.2, 1.2, 0.1], "intensity": [1, 2, 3], "radius": 0.5},
            ],
        }
    )
    direction = np.asarray([[0, 0, 0], [1, 0.3, 0]], np.float32)
    change = {"lights.position": direction}
    reference = finite_difference(scene, "lights.position", direction, 0.02, 4096, 1)
    inside = interior(scene, change, 1, ["lights.position", "lights.radius"])
    total = inside + edges(scene, change, plan(16384, 1, lights=True))
    assert relative(bumps(total), bumps(reference)) < 0.02
    assert relative(bumps(inside), bumps(reference)) > 0.5


# What JAX asks of it

EVERYTHING = plan(4096, 2, geometry=True, lights=True)


def random_change(scene, names, seed):
    rng = np.random.default_rng(seed)
    return {n: rng.normal(size=v.shape) for n, v in jaxrt.parameters(scene).items() if n in names}


def test_reverse_mode_is_the_transpose_of_forward_mode():
    scene = scene_of(0.5)
    values = {name: jaxrt.parameters(scene)[name] for name in sorted(ALL)}
    change = {k: jnp.asarray(v, jnp.float32) for k, v in random_change(scene, ALL, 1).items()}
    weights = jax.random.normal(jax.random.key(0), (64, 64, 3))

    def linear(change):
        tangent = jax.jvp(partial(jaxrt.with_parameters, scene), (values,), (change,))[1]
        return edge_tangent(scene, tangent, jnp.uint32(7), EVERYTHING)

    forward = linear(change)
    pulled = jax.linear_transpose(linear, change)(weights)[0]
    for name in sorted(ALL):
        one = {k: v if k == name else jnp.zeros_like(v) for k, v in change.items()}
        picture = np.asarray(linear(one), float)
        there = np.vdot(np.asarray(weights, float), picture)
        back = np.vdot(np.asarray(pulled[name], float), np.asarray(change[name], float))
        # Both sum the same products in another order
        scale = np.linalg.norm(picture) * np.linalg.norm(weights) / 64
        assert abs(there - back) < 1e-5 * max(abs(there), scale), name
    assert np.all(np.isfinite(np.asarray(forward)))


def test_tangents_of_a_batch_share_the_samples():
    scene = scene_of(0.5)

    def one(direction):
        return edge_tangent(scene, tangent_of(scene, {"lights.position": direction[None]}), jnp.uint32(7), EVERYTHING)

    batch = np.asarray(jax.vmap(one)(jnp.asarray(AXES)))
    for picture, axis in zip(batch, AXES, strict=True):
        np.testing.assert_allclose(picture, np.asarray(one(jnp.asarray(axis))), atol=1e-5 * np.abs(batch).max())


def test_samples_do_not_depend_on_devices():
    scene = scene_of(0.5)
    both = EVERYTHING._replace(devices=tuple(jax.devices()[:2]))
    change = {"lights.position": X[None]}
    one, two = (edges(scene, change, p) for p in (EVERYTHING, both))
    np.testing.assert_allclose(one, two, atol=1e-5 * np.abs(one).max())


HORROR = {
    "light inside the ball": {"lights.position": [-0.6, 0.8, 0.1]},
    "light in the ball's centre": {"lights.position": [-0.6, 0.8, 0]},
    "light over a vertex": {"lights.position": None},
    "light of no size": {"lights.radius": 0.0},
    "ball far off": {"spheres.center": [500, 0, 0]},
    "ball of no size": {"spheres.radius": 0.0},
    "all triangles without area": {"meshes.vertices": [0.1, 0.2, 0.3]},
    "camera in the ball's centre": {"camera.position": [-0.6, 0.8, 0]},
    "camera on the light": {"camera.position": [0.5, 4, 1]},
}


@pytest.mark.parametrize("case", HORROR)
def test_everything_stays_finite(case):
    scene = scene_of(0.5)
    ((name, value),) = HORROR[case].items()
    if value is None:
        value = jaxrt.parameters(scene)["meshes.vertices"][0] + 2 * Y
    old = jaxrt.parameters(scene)[name]
    scene = jaxrt.with_parameters(scene, {name: jnp.broadcast_to(jnp.asarray(value, jnp.float32), old.shape)})
    groups = sample_edges(scene, jnp.uint32(7), EVERYTHING)
    for samples in groups:
        assert all(np.all(np.isfinite(np.asarray(leaf))) for leaf in jax.tree.leaves(samples))

        def cost(parameters, samples=samples):
            clearance = clearance_of(jaxrt.with_parameters(scene, parameters), samples)
            return jnp.sum(splat(samples, clearance, (64, 64)))

        gradient = jax.grad(cost)({n: jaxrt.parameters(scene)[n] for n in ALL})
        assert all(np.all(np.isfinite(np.asarray(leaf))) for leaf in gradient.values())


def test_no_light_and_nothing_that_blocks_make_no_edges():
    scene = scene_of(0.5)
    assert sample_edges(replace(scene, lights=None), jnp.uint32(7), plan(512, 1, lights=True)) == ()
    alone = replace(scene, spheres=None, triangles=None, lights=replace(scene.lights, radius=None))
    assert sample_edges(alone, jnp.uint32(7), plan(512, 1, geometry=True, lights=True)) == ()
