"""A Scene's leaves stand on their own: whatever changes them, the picture is the one that their values say."""

import functools
import warnings
from dataclasses import replace

import equinox
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrt
from jaxrt.scene import drawn
from tests.test_parameters import assert_same

# Each leaf once. A leaf that depends on others goes stale when they change, and needs a reason to be here
PARAMETERS = {  # path in the Scene -> what `parameters` calls it
    "camera.position": "camera.position",
    "camera.target": "camera.target",
    "camera.fov": "camera.fov",
    "spheres.center": "spheres.center",
    "spheres.radius": "spheres.radius",
    "triangles.vertices": "meshes.vertices",
    "lights.position": "lights.position",
    "lights.intensity": "lights.intensity",
    "lights.radius": "lights.radius",
    "environment": "environment.radiance",
}
OTHERS = {
    "camera.up": "the user's own",
    "spheres.lost": "counts only where it may be that of the present centre and radius",
    "spheres.material": "integers",
    "triangles.faces": "integers",
    "triangles.material": "integers",
    "triangles.bvh.children": "integers; the boxes are those of the present vertices",
    "triangles.bvh.first": "the same",
    "triangles.bvh.last": "the same",
    "triangles.bvh.faces": "the same",
    "triangles.edges.vertices": "integers; which face is beside which",
    "triangles.edges.opposite": "the same",
    "triangles.edges.faces": "the same",
    "triangles.edges.used": "the same",
    "triangles.smooth": "integers; which corners share a normal",
    "materials.diffuse.albedo": "a parameter, by its order",
    "materials.mirror.albedo": "the same",
    "materials.glass.ior": "the same",
    "idle['albedo']": "drawn by nothing",
    "idle['ior']": "the same",
    "order['albedo']": "tells the order of `parameters`, and is drawn by nothing",
    "order['ior']": "the same",
    "poses.meshes.translate": "a parameter, where it was asked for",
    "poses.meshes.rotate": "the same",
    "poses.meshes.scale": "the same",
    "poses.first": "integers; which mesh a vertex is of",
    "origin": "what `parameters` adds to places, and drawn by nothing",
}
WALL, R = (0.3, -1e6 - 0.1, 0.2), 1e6  # float32 has no room for the digits of this centre


def description(wall=WALL, radius=R):
    """Return a wall below a ball, under a point light."""
    spheres = [(wall, radius), ((0, 0.75, 0), 0.5)]
    return {
        "camera": {"position": [0, 1.5, 5], "target": [0, 0.5, 0], "fov": 50, "width": 8, "height": 8},
        "materials": {"white": {"type": "diffuse", "albedo": [0.75, 0.5, 0.25]}},
        "spheres": [{"center": list(c), "radius": r, "material": "white"} for c, r in spheres],
        "lights": [{"position": [2, 4, 3], "intensity": 8}],
    }


def sheet(n=6):
    """Return vertices and faces (2n²) of a bumpy sheet."""
    x, z = (a.ravel() for a in np.meshgrid(np.linspace(-1, 1, n + 1), np.linspace(-1, 1, n + 1), indexing="ij"))
    k = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    faces = [np.stack([k, k + 1, k + n + 2], 1), np.stack([k, k + n + 2, k + n + 1], 1)]
    return np.stack([x, 0.2 * np.sin(3 * x) * np.cos(2 * z), z], -1), np.concatenate(faces)


def everything(vertices=None):
    """Return a scene that has every leaf there is."""
    vertices, faces = sheet() if vertices is None else (vertices, sheet()[1])
    diffuse, mirror = ({"type": kind, "albedo": [0.75, 0.5, 0.25]} for kind in ("diffuse", "mirror"))
    glass = {"type": "glass", "ior": 1.5}
    names = {"white": diffuse, "silver": mirror, "glass": glass, "unused": diffuse, "spare": glass}
    mesh = {"vertices": vertices, "faces": faces, "material": "white", "smooth": True}
    balls = [("silver", [-1.5, 0.5, 0.25]), ("glass", [1.5, 0.75, 0])]
    more = description() | {"materials": names, "meshes": [mesh], "environment": {"radiance": [0.5, 0.5, 0.5]}}
    more["spheres"] += [{"center": c, "radius": 0.5, "material": m} for m, c in balls]
    more["lights"] = [{"position": [x, 4, 3], "intensity": 8, "radius": 0.25} for x in (-2, 2)]
    more["camera"] |= {"position": [0, 1.5, 5]}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jaxrt.SceneWarning)
        return jaxrt.build(more)


@pytest.fixture(scope="module")
def whole():
    return everything()


def leaves_of(scene):
    """Return the leaves by their path in the Scene."""
    named = jax.tree_util.tree_flatten_with_path(scene)[0]
    return {jax.tree_util.keystr(path).removeprefix("."): leaf for path, leaf in named}


def at(scene, path):
    return functools.reduce(getattr, path.split("."), scene)


def replaced(scene, path, value):
    """Return the scene with one leaf replaced, by `dataclasses.replace` alone."""
    first, _, rest = path.partition(".")
    return replace(scene, **{first: replaced(getattr(scene, first), rest, value) if rest else value})


def shot(scene):
    return jaxrt.render(scene, 0, spp=4, max_depth=1, devices=jax.devices()[:1])


def test_every_leaf_is_a_parameter_or_has_its_reason(whole):
    scene = replace(whole, origin=jnp.zeros(3))
    assert leaves_of(scene).keys() == PARAMETERS.keys() | OTHERS.keys()
    for path, reason in OTHERS.items():
        leaf = leaves_of(scene)[path]
        assert not reason.startswith("integers") or not jnp.issubdtype(leaf.dtype, jnp.inexact)
        assert "drawn by nothing" not in reason or path not in leaves_of(drawn(scene))


@pytest.mark.parametrize("path", PARAMETERS)
def test_whatever_replaces_a_leaf_gives_the_same_scene(whole, path):
    scene = whole
    new = at(scene, path) * 1.25 + 0.25
    wanted = jaxrt.with_parameters(scene, {PARAMETERS[path]: new})
    mapped = jax.tree.map(lambda x: new if x is at(scene, path) else x, scene)
    for other in (replaced(scene, path, new), equinox.tree_at(lambda s: at(s, path), scene, new), mapped):
        assert_same(other, wanted)


def test_integers_of_a_mesh_are_those_of_moved_vertices(whole):
    """Bent, stretched and turned over, faces hang together as before; boxes and normals are made in each render.

    That rays find faces where they are now, through a tree of where they were: stability/test_b_bvh.py.
    """
    vertices, faces = sheet()
    moved = np.float32(np.stack([3 * vertices[:, 2], vertices[:, 0] ** 3, vertices[:, 1] - 5 * vertices[:, 0]], -1))
    before, after = whole.triangles, everything(moved).triangles
    assert_same(after.edges, before.edges)
    np.testing.assert_array_equal(after.smooth, before.smooth)
    np.testing.assert_array_equal(np.unique(after.bvh.faces), np.unique(before.bvh.faces))


def test_the_origin_moves_what_is_told_not_what_is_drawn():
    far = description()
    for thing, name in [
        (far["camera"], "position"),
        (far["camera"], "target"),
        *((x, "position") for x in far["lights"]),
    ]:
        thing[name] = [thing[name][0] + 1e6, *thing[name][1:]]
    far["spheres"] = [{"center": [1e6, 0.75, 0], "radius": 0.5, "material": "white"}]
    scene = jaxrt.build(far)
    moved = replaced(scene, "lights.position", scene.lights.position + 2)
    told = [jaxrt.parameters(x)["lights.position"] for x in (scene, moved)]
    np.testing.assert_array_equal(told[1] - told[0], np.full((1, 3), 2))
    assert_same(drawn(replace(moved, origin=scene.origin + 7)), drawn(moved))


def test_pictures_of_updates_are_those_of_scenes_built_anew():
    """A wall of radius 1e6 keeps its lost digits as it moves; what is not that wall does not get them."""
    scene = jaxrt.build(description())
    assert abs(float(scene.spheres.lost[0])) > 0.02
    x, y, z = WALL

    def updated(center, radius):
        spheres = scene.spheres
        return equinox.tree_at(
            lambda s: (s.spheres.center, s.spheres.radius),
            scene,
            (spheres.center.at[0].set(jnp.asarray(center)), spheres.radius.at[0].set(radius)),
        )

    rounded = np.float32(WALL)
    # Moved by numbers that float32 has room for: as if the file said so
    moved = shot(updated(rounded + np.float32([0, 0.25, 0]), R)), shot(jaxrt.build(description((x, y + 0.25, z))))
    np.testing.assert_allclose(*moved, rtol=1e-5, atol=1e-6)
    assert np.abs(moved[0] - shot(scene)).max() > 1e-3
    # Another sphere altogether: it, to the bit
    for center, radius in [((0, 0, 0), 0.25), ((-1, 0.5, 1), 0.5), ((0, -64.5, 0), 64)]:
        np.testing.assert_array_equal(
            shot(updated(np.float32(center), radius)), shot(jaxrt.build(description(center, radius)))
        )
    # And from a ball to a wall
    small = jaxrt.build(description((0, 0, 0), 0.25))
    grown = replaced(replaced(small, "spheres.center", scene.spheres.center), "spheres.radius", scene.spheres.radius)
    wall = jaxrt.build(description(tuple(map(float, rounded))))
    np.testing.assert_array_equal(shot(grown), shot(wall))


@pytest.mark.usefixtures("quick_compilation")
def test_descent_on_the_scene_is_descent_on_its_parameters():
    """Gradients of the Scene taken off its leaves give what `with_parameters` makes of the same values, to the bit."""
    start = jaxrt.build(description())
    target = shot(jaxrt.with_parameters(start, {"lights.intensity": jnp.full((1, 3), 12.0)}))
    loss = jax.value_and_grad(lambda scene: jnp.mean((shot(scene) - target) ** 2), allow_int=True)
    scene, losses, rate, moves = start, [], None, []
    for _ in range(2):
        value, slope = loss(scene)
        losses.append(float(value))
        # The first step moves the wall's centre, whose numbers are 1/16 apart
        rate = rate or 0.04 / float(jnp.abs(slope.spheres.center[0, 1]))
        before = scene
        scene = jax.tree.map(lambda p, g, rate=rate: p - rate * g if g.dtype == p.dtype else p, scene, slope)
        moves.append(float(scene.spheres.center[0, 1] - before.spheres.center[0, 1]))
        assert np.all(slope.spheres.lost == 0)
    assert abs(moves[0]) == 1 / 16 and losses[1] != losses[0]
    again = jaxrt.with_parameters(start, jaxrt.parameters(scene))
    # The one leaf of the user's that is no parameter
    assert_same(replaced(again, "camera.up", scene.camera.up), scene)
    picture = np.asarray(shot(scene))
    assert np.isfinite(picture).all() and abs(picture.mean() / np.mean(shot(start)) - 1) < 0.5
