"""The edge term against closed forms and finite differences.

Finite differences of 1024 samples a pixel are noisy by about 1 % in 4 × 4 cells and by 0.3 % in smooth functionals, as
two seeds show. To that come the truncation of kinks in box pixels and the edge term's own noise. Tolerances are about
twice what all of it was measured to be: an indirect light 0.005 of 0.01.
"""

from dataclasses import replace
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from edge_scenes import AXES, box, bumps, cells, corner_room, finite_difference, moved, plan, quad, quick_jit, relative

import jaxrt
from jaxrt.boundary import clearance_of, edge_tangent, sample_edges, splat
from jaxrt.boundary.outlines import both_sides, camera_edges
from jaxrt.boundary.silhouettes import Silhouettes, rim_at
from jaxrt.shapes import mesh_edges
from jaxrt.transport.path import tables_of

X, Y, _ = AXES
ALL = {"lights.position", "lights.radius", "spheres.center", "spheres.radius", "meshes.vertices"} | {
    "camera.position",
    "camera.target",
    "camera.fov",
}
LIGHT = {"lights.position", "lights.radius"}


ROOM = corner_room(0.5)
DIRECT = plan(16384, 1, geometry=True, lights=True)
INDIRECT = plan(16384, 3, lights=True)


@cache
def scene_of(radius):
    """Return the room under a light of this radius: with 0 too the same programs serve."""
    return jaxrt.with_parameters(ROOM, {"lights.radius": jnp.full(1, radius)})


def values_of(scene):
    """Return the parameters that can move an edge."""
    return {name: value for name, value in sorted(jaxrt.parameters(scene).items()) if name in ALL}


def changes_of(scene, changes):
    """Return changes of some parameters, zeros for the others: one program then serves them all."""
    wide = {k: jnp.broadcast_to(jnp.asarray(v, jnp.float32), values_of(scene)[k].shape) for k, v in changes.items()}
    return jax.tree.map(jnp.zeros_like, values_of(scene)) | wide


def tangent_of(scene, changes):
    return jax.jvp(partial(jaxrt.with_parameters, scene), (values_of(scene),), (changes,))[1]


@partial(jax.jit, static_argnames=("depth", "names"))
def interior_part(scene, values, changes, depth, names):
    """Return the derivative inside of edges along changes of the named parameters."""

    def picture(chosen):
        return jaxrt.render(jaxrt.with_parameters(scene, chosen), 99, spp=256, max_depth=depth)

    chosen, directions = ({name: tree[name] for name in names} for tree in (values, changes))
    return jax.jvp(picture, (chosen,), (directions,))[1]


def interior(scene, changes, depth, names):
    picture = interior_part(scene, values_of(scene), changes_of(scene, changes), depth, tuple(sorted(names)))
    return np.asarray(picture, float)


_sampled = quick_jit(sample_edges, static_argnames="plan")
_outlines = quick_jit(camera_edges, static_argnames="plan")


def samples_of(scene, edge_plan, seed=7):
    """Return samples of all edges, by one program for all that is held against them."""
    return _sampled(scene, jnp.uint32(seed), plan=edge_plan)


@quick_jit
def change_of(scene, changes, groups):
    """Return the change of the picture by samples of edges."""
    tangent = tangent_of(scene, changes)
    moves = [jax.jvp(partial(clearance_of, samples=one), (scene,), (tangent,))[1] for one in groups]
    size = scene.camera.width, scene.camera.height
    return sum(splat(one, move, size) for one, move in zip(groups, moves, strict=True))


def edges(scene, changes, edge_plan):
    return np.asarray(change_of(scene, changes_of(scene, changes), samples_of(scene, edge_plan)), float)


@cache
def by_light(radius, axis):
    """Return the finite difference by a coordinate of the light, and the part of the derivative inside of edges."""
    scene, depth = scene_of(radius), 1 if radius == 0 else 3
    reference = finite_difference(scene, "lights.position", AXES[axis][None], 0.03, 1024, depth)
    names = ALL if depth == 1 else LIGHT
    return reference, interior(scene, {"lights.position": AXES[axis][None]}, depth, names)


# Silhouettes


def test_edges_of_a_box_are_found_once_though_its_triangles_share_no_vertex():
    triangles = ROOM.triangles
    box = replace(triangles, vertices=triangles.vertices[:36], faces=triangles.faces[:12])
    found = mesh_edges(np.asarray(box.vertices), np.asarray(box.faces))
    ends = np.asarray(box.vertices)[np.asarray(found.vertices)[np.asarray(found.used)]]
    lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=-1)
    assert len(lengths) == 18
    np.testing.assert_allclose(np.sort(lengths), [0.8] * 12 + [0.8 * np.sqrt(2)] * 6, rtol=1e-5)
    faces = np.asarray(found.faces)[np.asarray(found.used)]
    assert np.all(faces[:, 0] != faces[:, 1])


def test_faces_without_area_have_no_edges():
    triangles = ROOM.triangles
    flat = triangles.vertices.at[2].set((triangles.vertices[0] + triangles.vertices[1]) / 2)
    found = mesh_edges(np.asarray(flat), np.asarray(triangles.faces))
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


@pytest.mark.quick
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_straight_shadow_edge_has_its_closed_form(axis):
    light = (-0.15, 3.0, 0.4)
    scene, reference = straight_edge_scene(light), straight_edge_rows(light, axis)
    error = {}
    for n in (16384, 131072):
        rows = edges(scene, {"lights.position": AXES[axis][None]}, plan(n, 1, lights=True))[..., 0].sum(1)
        error[n] = relative(rows, reference)
    # Evenly spaced: errors like 1/n (measured 3.7e-3, 5.8e-4), until the rounding of float32
    assert np.all(reference != 0)
    assert error[16384] < 1e-2
    assert error[131072] < 2e-3
    assert error[131072] < error[16384] / 3


# Finite differences


@pytest.mark.parametrize(
    ("radius", "axis"), [pytest.param(0.0, 2, marks=pytest.mark.slow, id="point z"), pytest.param(0.5, 0, id="ball x")]
)
def test_light_position(radius, axis):
    reference, inside = by_light(radius, axis)
    change = {"lights.position": AXES[axis][None]}
    total = inside + edges(scene_of(radius), change, DIRECT if radius == 0 else INDIRECT)
    assert relative(cells(total), cells(reference)) < 0.05
    assert relative(bumps(total), bumps(reference)) < 0.02
    assert relative(cells(inside), cells(reference)) > 0.25
    assert relative(bumps(inside), bumps(reference)) > 0.1


def test_large_close_light():
    """A light of radius 0.9 close above: what is held fixed inside and at the edges must be the same."""
    scene = moved(scene_of(0.5), "lights.radius", [1.0], 0.4)
    scene = moved(scene, "lights.position", (0, -1.4, 0), 1.0)
    reference = finite_difference(scene, "lights.position", X[None], 0.03, 1024, 3)
    change = {"lights.position": X[None]}
    inside = interior(scene, change, 3, LIGHT)
    total = inside + edges(scene, change, INDIRECT)
    assert relative(bumps(total), bumps(reference)) < 0.02
    assert relative(bumps(inside), bumps(reference)) > 0.1


def test_indirect_light_has_its_share_of_the_edges():
    scene, change = scene_of(0.5), {"lights.position": X[None]}
    reference, inside = by_light(0.5, 0)
    wide = changes_of(scene, change)

    def parts(seed):
        """Return what all edges bring, and what they do without shadows that are seen in indirect light."""
        shadows, *others = samples_of(scene, INDIRECT, seed)
        direct = replace(shadows, weight=shadows.weight.at[:, 1:].set(0))
        return [np.asarray(change_of(scene, wide, (some, *others)), float) for some in (shadows, direct)]

    # Four times the samples: those of one seed leave the indirect part's noise at 0.5 % of the whole
    complete, without = inside + np.mean([parts(seed) for seed in range(4)], axis=0)
    assert relative(bumps(complete), bumps(reference)) < 0.01
    assert relative(bumps(without), bumps(reference)) > 2 * relative(bumps(complete), bumps(reference))


GEOMETRY = {"sphere radius": ("spheres.radius", [1.0], 0.01), "vertex": ("meshes.vertices", None, 0.02)}


def one_vertex(scene):
    """Return the direction in which all triangles at the box's corner nearest to the light move up."""
    vertices = np.asarray(jaxrt.parameters(scene)["meshes.vertices"])
    corner = vertices[np.argmax(vertices[:36] @ [0.3, 3, 1])]
    return np.where((np.abs(vertices - corner) < 1e-5).all(-1)[:, None], Y, 0)


@pytest.mark.slow
@pytest.mark.parametrize("case", GEOMETRY)
def test_moving_shapes(case):
    """Others move whole balls and boxes, and the camera: `test_all_edges`, `test_bounced_edges`, `test_flash`."""
    scene = scene_of(0.0)
    name, direction, step = GEOMETRY[case]
    direction = one_vertex(scene) if direction is None else np.asarray(direction, np.float32)
    reference = finite_difference(scene, name, direction, step, 768, 1)
    inside = interior(scene, {name: direction}, 1, ALL)
    total = inside + edges(scene, {name: direction}, DIRECT)
    assert relative(cells(total), cells(reference)) < 0.06
    assert relative(cells(inside), cells(reference)) > 0.5


TWO_LIGHTS = plan(16384, 1, lights=True)
AWAY = np.asarray([[0, 0, 0], [1, 0.3, 0]], np.float32)  # the lower light alone


@cache
def two_lights():
    """Return a light above a light above a huge sphere."""
    return jaxrt.build(
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


@pytest.mark.slow
def test_a_sphere_light_casts_the_shadow_of_another_and_is_seen_itself():
    scene, change = two_lights(), {"lights.position": AWAY}
    reference = finite_difference(scene, "lights.position", AWAY, 0.02, 4096, 1)
    inside = interior(scene, change, 1, LIGHT)
    total = inside + edges(scene, change, TWO_LIGHTS)
    assert relative(bumps(total), bumps(reference)) < 0.02
    assert relative(bumps(inside), bumps(reference)) > 0.5


@pytest.mark.slow
@pytest.mark.usefixtures("quick_compilation")
def test_edges_are_sampled_by_several_devices():
    scene, two = two_lights(), TWO_LIGHTS._replace(devices=tuple(jax.devices()[:2]))
    change = changes_of(scene, {"lights.position": AWAY})
    alone, together = (
        np.asarray(edge_tangent(scene, tangent_of(scene, change), jnp.uint32(7), edge_plan))
        for edge_plan in (TWO_LIGHTS, two)
    )
    np.testing.assert_allclose(together, alone, atol=1e-5 * np.abs(alone).max())
    np.testing.assert_allclose(
        alone, edges(scene, {"lights.position": AWAY}, TWO_LIGHTS), atol=1e-5 * np.abs(alone).max()
    )


@pytest.mark.quick
@pytest.mark.parametrize("radius", [0.3, 1000.0])
def test_rays_to_a_rim_come_from_outside(radius):
    """By rounding half of those along the surface come from inside, where no light is."""
    ball = {"center": [0.2, -radius, 0.1], "radius": radius, "material": "white"}
    scene = jaxrt.build(
        {
            "camera": dict(position=[0.3, 0.7, 3.1], target=[0, 0, 0], fov=40, width=4, height=4),
            "materials": {"white": {"type": "diffuse", "albedo": [0.8, 0.8, 0.8]}},
            "spheres": [ball],
            "environment": {"radiance": [1, 1, 1]},
        }
    )
    tables = tables_of(scene)
    outlines = Silhouettes(tables.geometry.spheres, None)

    @jax.jit
    @jax.vmap
    def inside(t):
        rim = rim_at(outlines, jnp.int32(0), t, tables.camera.position, True)
        (rays, _, points), clear = both_sides(tables, outlines, jnp.int32(0), rim, tables.camera.position)
        return jnp.vdot(points.normal[1], rays.direction[1]), clear

    arrives, clear = inside((jnp.arange(256, dtype=jnp.float32) + 0.5) / 256)
    assert np.all(clear) and np.all(arrives < 0)


# A face that is seen almost edge-on


def box_seen_from_just_above(rise):
    """Return a box of side 1 under a white sky, from whose top's height the camera is `rise` away."""
    triangles = box([0, 0, 0], 0.5, 0, "grey")
    for face in triangles[-2:]:
        face["material"] = "pale"
    grey, pale = ({"type": "diffuse", "albedo": [a, a, a]} for a in (0.2, 0.7))
    return jaxrt.build(
        {
            "camera": dict(position=[0, 0.5 + rise, 4.5], target=[0, 0.5 + rise, 0], fov=40, width=16, height=16),
            "materials": {"grey": grey, "pale": pale},
            "triangles": triangles,
            "environment": {"radiance": [1, 1, 1]},
        }
    )


@pytest.mark.parametrize("rise", [1e-3, 0.3])
def test_a_face_counts_however_thin_it_looks(rise):
    """The top rises: its edges at the front, at the back and at both sides sweep the picture."""
    scene, edge_plan = box_seen_from_just_above(rise), plan(4096, 1, geometry=True)
    vertices = jaxrt.parameters(scene)["meshes.vertices"]
    (samples,) = _outlines(scene, jnp.uint32(0), plan=edge_plan)
    up = np.where(np.asarray(vertices)[:, 1:2] > 0, AXES[1], 0)

    def clearance(height):
        return clearance_of(jaxrt.with_parameters(scene, {"meshes.vertices": vertices + height * up}), samples)

    slope = float(jnp.sum(splat(samples, jax.jvp(clearance, (0.0,), (1.0,))[1], (16, 16))[..., 0]))
    pixels = 16 / (2 * np.tan(np.radians(20)))
    front, back = (pixels / 4) ** 2, (pixels / 5) ** 2
    expected = (0.7 - 0.2) * front + (0.2 - 1) * (back + (front - back) / 2)
    # Sampled evenly along edges, between whose ends a pixel's weight varies: 0.5 % and less was measured
    assert slope == pytest.approx(expected, rel=0.02)


# What JAX asks of it


@pytest.mark.quick
def test_reverse_mode_is_the_transpose_of_forward_mode():
    scene, rng = scene_of(0.5), np.random.default_rng(1)
    change = {k: jnp.asarray(rng.normal(size=v.shape), jnp.float32) for k, v in values_of(scene).items()}
    weights = jax.random.normal(jax.random.key(0), (64, 64, 3))
    groups = samples_of(scene, DIRECT)

    def linear(change):
        return change_of(scene, change, groups)

    pulled = jax.linear_transpose(linear, change)(weights)[0]
    for name in values_of(scene):
        picture = np.asarray(linear({k: v if k == name else jnp.zeros_like(v) for k, v in change.items()}), float)
        there = np.vdot(np.asarray(weights, float), picture)
        back = np.vdot(np.asarray(pulled[name], float), np.asarray(change[name], float))
        # Both sum the same products in another order
        assert abs(there - back) < 1e-5 * np.abs(np.asarray(weights, float) * picture).sum(), name


@pytest.mark.filterwarnings("ignore::jaxrt.SceneWarning")
def test_what_stands_on_a_floor_is_lit_as_what_nearly_does():
    """A box's faces see half of the sky, also where they end in a black floor: in its very plane they would see all.

    Eight seeds, the same of both; six standard errors of their difference, and a hundredth for the gap.
    """

    floor = quad([-9, 0, -9], [0, 0, 18], [18, 0, 0], "black")

    def foot(gap):
        scene = jaxrt.build(
            {
                "camera": dict(position=[1, 1.2, 4], target=[0, 0.5, 0], fov=28, width=16, height=16),
                "materials": {
                    "black": {"type": "diffuse", "albedo": [0, 0, 0]},
                    "white": {"type": "diffuse", "albedo": [0.8, 0.8, 0.8]},
                },
                "triangles": box([0, 0.5 + gap, 0], 0.5, 0.3, "white") + floor,
                "environment": {"radiance": [1, 1, 1]},
            }
        )
        found = []
        for seed in range(8):
            (samples,) = _outlines(scene, jnp.uint32(seed), plan=plan(4096, 1, geometry=True))
            below = (samples.pixel >= 8 * 16) & (samples.pixel < 16 * 16)
            found.append(np.asarray(jnp.sum(jnp.where(below[..., None], samples.weight, 0)), float))
        return np.array(found)

    standing, raised = foot(0.0), foot(0.002)
    apart = standing - raised
    bound = 6 * apart.std(ddof=1) / 8**0.5 + 0.01 * abs(raised.mean())
    assert bound < 0.1 * abs(raised.mean()), "too noisy to tell"
    assert abs(apart.mean()) < bound, (standing, raised)


@pytest.mark.usefixtures("quick_compilation")
def test_tangents_of_a_batch_share_the_samples():
    scene = two_lights()

    def one(direction):
        change = changes_of(scene, {"lights.position": jnp.stack([direction, -direction])})
        return edge_tangent(scene, tangent_of(scene, change), jnp.uint32(7), TWO_LIGHTS)

    batch = np.asarray(jax.vmap(one)(jnp.asarray(AXES)))
    for picture, axis in zip(batch, AXES, strict=True):
        np.testing.assert_allclose(picture, np.asarray(one(jnp.asarray(axis))), atol=1e-5 * np.abs(batch).max())


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


@quick_jit
def gradient_of(scene, groups):
    """Return the derivatives of a picture's sum by all parameters, from the edges alone."""

    def cost(values):
        moving = jaxrt.with_parameters(scene, values)
        return sum(jnp.sum(splat(samples, clearance_of(moving, samples), (64, 64))) for samples in groups)

    return jax.grad(cost)(values_of(scene))


@pytest.mark.parametrize("case", HORROR)
def test_everything_stays_finite(case):
    scene = scene_of(0.5)
    ((name, value),) = HORROR[case].items()
    if value is None:
        value = jaxrt.parameters(scene)["meshes.vertices"][0] + 2 * Y
    scene = jaxrt.with_parameters(scene, {name: changes_of(scene, {name: value})[name]})
    groups = samples_of(scene, INDIRECT)
    for leaf in jax.tree.leaves((groups, gradient_of(scene, groups))):
        assert np.all(np.isfinite(np.asarray(leaf)))


def test_no_light_and_nothing_that_blocks_make_no_edges():
    scene = scene_of(0.5)
    assert samples_of(replace(scene, lights=None), plan(512, 1, lights=True)) == ()
    alone = replace(scene, spheres=None, triangles=None, lights=replace(scene.lights, radius=None))
    assert samples_of(alone, plan(512, 1, geometry=True, lights=True)) == ()


@cache
def white_ball():
    """Return a white ball before a sky as white."""
    return jaxrt.build(
        {
            "camera": {"position": [0, 0, 6], "target": [0, 0, 0], "width": 12, "height": 8, "fov": 45},
            "materials": {"white": {"type": "diffuse", "albedo": [1, 1, 1]}},
            "environment": {"radiance": [1, 1, 1]},
            "spheres": [{"center": [-0.4, 0, 0], "radius": 1, "material": "white"}],
        }
    )


@pytest.mark.parametrize("eye", [(0, 0, 6), (0.5, 2, 5)])
def test_a_white_ball_before_a_white_sky_has_no_outline(eye):
    """Both sides are as bright: a ball is met on its rim from outside, however its normal is rounded."""
    scene = jaxrt.with_parameters(white_ball(), {"camera.position": jnp.float32(eye)})
    grey = jaxrt.with_parameters(scene, {"materials.albedo": jnp.full((1, 3), 0.5)})
    outline = partial(edges, changes={"spheres.center": jnp.ones((1, 3))}, edge_plan=plan(512, 1, geometry=True))
    assert np.abs(outline(scene)).max() < 1e-5
    assert np.abs(outline(grey)).max() > 0.05
