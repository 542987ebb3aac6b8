"""Parameters by name: what there is, in which order, and that changes are pure, checked and traceable."""

import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrt

ALBEDO = [[0.9, 0.9, 0.8], [0.8, 0.1, 0.1], [0.9, 0.7, 0.2], [0.1, 0.1, 0.8]]
MIXED = {
    "camera": {"position": [2, 1, 9], "target": [2, 0, 0], "width": 8, "height": 8, "fov": 50},
    "environment": {"radiance": [0.1, 0.2, 0.3]},
    "materials": {
        "silver": {"type": "mirror", "albedo": ALBEDO[0]},
        "red": {"type": "diffuse", "albedo": ALBEDO[1]},
        "crown": {"type": "glass", "ior": 1.5},
        "gold": {"type": "mirror", "albedo": ALBEDO[2]},
        "blue": {"type": "diffuse", "albedo": ALBEDO[3]},
    },
    "spheres": [
        {"center": [2.0 * i, 0.1, 0], "radius": 1, "material": name}
        for i, name in enumerate(["silver", "red", "crown"])
    ],
    "triangles": [{"vertices": [[-9, -1, -9], [9, -1, -9], [0, -1, 9]], "material": "blue"}],
    "lights": [
        {"position": [0, 5, 1], "intensity": [1, 2, 3], "radius": 0.5},
        {"position": [4, 3, 3], "intensity": 7, "radius": 0.25},
    ],
}
SHAPES = {
    "lights.position": (2, 3),
    "lights.intensity": (2, 3),
    "lights.radius": (2,),
    "materials.albedo": (4, 3),
    "materials.ior": (1,),
    "spheres.center": (3, 3),
    "spheres.radius": (3,),
    "meshes.vertices": (3, 3),
    "camera.position": (3,),
    "camera.target": (3,),
    "camera.fov": (),
    "environment.radiance": (3,),
}


@pytest.fixture(scope="module")
def scene():
    return jaxrt.build(MIXED)


def assert_same(a, b):
    """Every leaf and all structure equal, to the bit."""
    assert jax.tree.structure(a) == jax.tree.structure(b)
    for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        assert x.dtype == y.dtype
        np.testing.assert_array_equal(x, y)


def test_names_and_shapes(scene):
    assert {name: value.shape for name, value in jaxrt.parameters(scene).items()} == SHAPES


def test_only_what_the_scene_has():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jaxrt.SceneWarning)
        empty = jaxrt.build({"camera": {"position": [0, 0, 0]}})
        points = jaxrt.build({"camera": {"position": [0, 0, 0]}, "lights": [{"position": [0, 1, 0], "intensity": 1}]})
    cameras = {"camera.position", "camera.target", "camera.fov"}
    assert jaxrt.parameters(empty).keys() == cameras
    assert jaxrt.parameters(points).keys() == cameras | {"lights.position", "lights.intensity"}


def test_rows_are_in_the_order_of_the_scene_file(scene):
    p = jaxrt.parameters(scene)
    np.testing.assert_array_equal(p["materials.albedo"], np.float32(ALBEDO))
    np.testing.assert_array_equal(p["spheres.center"], np.float32([[0, 0.1, 0], [2, 0.1, 0], [4, 0.1, 0]]))
    np.testing.assert_array_equal(p["lights.intensity"], [[1, 2, 3], [7, 7, 7]])
    np.testing.assert_array_equal(p["meshes.vertices"], np.float32(MIXED["triangles"][0]["vertices"]))


def test_round_trip_is_the_same_scene(scene):
    """Hence the same picture; also where the power of huge spheres is computed anew in float32."""
    assert_same(jaxrt.with_parameters(scene, jaxrt.parameters(scene)), scene)
    wall = [{"center": [0.3, -1e6 - 0.1, 3], "radius": 1e6, "material": "red"}]
    huge = jaxrt.build(MIXED | {"spheres": wall})
    assert_same(jaxrt.with_parameters(huge, jaxrt.parameters(huge)), huge)


@pytest.mark.parametrize("name", SHAPES)
def test_a_change_changes_that_and_nothing_else(scene, name):
    """The new value is read back; others stay; the old scene is untouched."""
    before = jaxrt.parameters(scene)
    new = np.asarray(before[name]) * np.float32(1.25) + np.float32(0.25)
    after = jaxrt.parameters(jaxrt.with_parameters(scene, {name: new}))
    for other, value in before.items():
        np.testing.assert_array_equal(after[other], new if other == name else value)
    assert_same(jaxrt.build(MIXED), scene)


def test_albedos_reach_their_materials(scene):
    new = np.arange(12, dtype=np.float32).reshape(4, 3) / 16
    changed = jaxrt.with_parameters(scene, {"materials.albedo": new})
    np.testing.assert_array_equal(changed.materials.mirror.albedo, new[[0]])
    np.testing.assert_array_equal(changed.materials.diffuse.albedo, new[[1, 3]])
    np.testing.assert_array_equal(changed.idle["albedo"], new[[2]])


def test_plain_numbers_and_lists_are_accepted(scene):
    changed = jaxrt.with_parameters(scene, {"camera.fov": 30, "spheres.radius": [1, 2, 3]})
    assert changed.camera.fov.dtype == changed.spheres.radius.dtype == jnp.float32
    spheres = [s | {"radius": r} for s, r in zip(MIXED["spheres"], (1, 2, 3), strict=True)]
    built = jaxrt.build(MIXED | {"spheres": spheres})
    # The powers are sums of squares up to 16: one rounding apart
    np.testing.assert_allclose(changed.spheres.power, built.spheres.power, atol=16 * 2**-24)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"lights.positions": np.zeros((2, 3))}, r"^lights\.positions: .*lights\.position\b"),
        ({"albedo": 0.5}, r"^albedo: the scene has no such parameter"),
        ({"lights.position": np.zeros(3)}, r"^lights\.position: shape \(3,\), want \(2, 3\)"),
        ({"camera.fov": np.full(1, 50)}, r"^camera\.fov: shape \(1,\), want \(\)"),
        ({"camera.fov": 50, "materials.ior": 1.5}, r"^materials\.ior: shape \(\), want \(1,\)"),
    ],
)
def test_unknown_names_and_wrong_shapes_are_refused(scene, changes, message):
    with pytest.raises(jaxrt.SceneError, match=message):
        jaxrt.with_parameters(scene, changes)


def test_far_off_scenes_speak_the_users_coordinates():
    """A camera at 1e6: told to 1/16 there, and moved by what it is told."""
    far = [1e6, 0, 0]
    scene = jaxrt.build({"camera": {"position": far}, "lights": [{"position": [1e6, 1, 0], "intensity": 1}]})
    assert any(scene.origin)
    p = jaxrt.parameters(scene)
    np.testing.assert_allclose(p["lights.position"], [[1e6, 1, 0]], atol=1 / 16)
    moved = jaxrt.with_parameters(scene, {"lights.position": np.array([[1e6 + 2, 1, 0]])})
    np.testing.assert_allclose(moved.lights.position - scene.lights.position, [[2, 0, 0]], atol=1 / 8)


def small_ball():
    return jaxrt.build(
        {
            "camera": {
                "position": [0.3, 0.1, 0.2],
                "target": [1, 0.4, -0.2],
                "width": 8,
                "height": 8,
                "fov": 100,
            },
            "materials": {"wall": {"type": "diffuse", "albedo": [0.25, 0.5, 1]}},
            "spheres": [{"center": [0, 0, 0], "radius": 1, "material": "wall"}],
            "lights": [{"position": [0, 0, 0], "intensity": np.pi}],
        }
    )


def test_changes_inside_jit():
    """A render of traced parameters is that of the changed scene: intensity and albedo are factors here, to
    1e-6.
    """
    scene = small_ball()

    @jax.jit
    def picture(albedo, intensity):
        changed = jaxrt.with_parameters(scene, {"materials.albedo": albedo, "lights.intensity": intensity})
        return jaxrt.render(changed, 0, spp=1, max_depth=1, devices=jax.devices()[:1])

    image = picture(jnp.asarray([[0.5, 0.25, 0.75]]), jnp.full((1, 3), 2 * jnp.pi))
    np.testing.assert_allclose(image, np.broadcast_to([1, 0.5, 1.5], (8, 8, 3)), rtol=1e-6)
    names = jax.eval_shape(jaxrt.parameters, scene)
    assert {name: value.shape for name, value in names.items()} == {
        name: value.shape for name, value in jaxrt.parameters(scene).items()
    }


def test_changes_carry_derivatives(scene):
    """d/dx of what is read back is 1, in forward and reverse mode."""

    def read_back(x):
        return jaxrt.parameters(jaxrt.with_parameters(scene, {"materials.albedo": x}))["materials.albedo"].sum()

    x = jaxrt.parameters(scene)["materials.albedo"]
    np.testing.assert_array_equal(jax.grad(read_back)(x), np.ones((4, 3)))
    np.testing.assert_array_equal(jax.jvp(read_back, (x,), (x,))[1], x.sum())
