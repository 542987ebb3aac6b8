"""From descriptions to scenes: groups, rows, recentring, dtype."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrt

MATERIALS = {
    "silver": {"type": "mirror", "albedo": [0.9, 0.9, 0.8]},
    "red": {"type": "diffuse", "albedo": [0.8, 0.1, 0.1]},
    "crown": {"type": "glass", "ior": 1.5},
    "gold": {"type": "mirror", "albedo": [0.9, 0.7, 0.2]},
    "blue": {"type": "diffuse", "albedo": [0.1, 0.1, 0.8]},
    "flint": {"type": "glass", "ior": 1.7},
}
MIXED = {
    "camera": {"position": [0, 0, 9], "width": 8, "height": 8},
    "render": {"spp": 3, "max_depth": 2},
    "materials": MATERIALS,
    "spheres": [{"center": [2.5 * i, 0, 0], "radius": 1, "material": name} for i, name in enumerate(MATERIALS)],
    "triangles": [
        {"vertices": [[0, -1, 0], [1, -1, 0], [0, -1, 1]], "material": "blue"},
        {"vertices": [[0, -2, 0], [1, -2, 0], [0, -2, 1]], "material": "crown"},
    ],
    "lights": [{"position": [0, 5, 0], "intensity": 2, "radius": 0.5}],
}


def moved(description, offset):
    """Return the description with every position moved."""
    offset = np.asarray(offset, float)
    camera = description["camera"]
    position = np.asarray(camera["position"]) + offset
    return description | {
        "camera": camera | {"position": position, "target": position + [0, 0, -1]},
        "spheres": [s | {"center": s["center"] + offset} for s in description["spheres"]],
        "triangles": [t | {"vertices": np.add(t["vertices"], offset)} for t in description["triangles"]],
        "lights": [x | {"position": x["position"] + offset} for x in description["lights"]],
    }


def test_materials_are_grouped_by_kind_and_objects_follow():
    scene = jaxrt.build(MIXED)
    assert scene.materials.counts == (2, 2, 2)
    np.testing.assert_allclose(scene.materials.diffuse.albedo, [[0.8, 0.1, 0.1], [0.1, 0.1, 0.8]])
    np.testing.assert_allclose(scene.materials.mirror.albedo, [[0.9, 0.9, 0.8], [0.9, 0.7, 0.2]])
    np.testing.assert_allclose(scene.materials.glass.ior, [1.5, 1.7])
    # silver, red, crown, gold, blue, flint
    np.testing.assert_array_equal(scene.spheres.material, [2, 0, 4, 3, 1, 5])
    np.testing.assert_array_equal(scene.triangles.material, [1, 4])
    np.testing.assert_array_equal(scene.order["albedo"], [2, 0, 3, 1])


def test_fields_of_a_scene():
    scene = jaxrt.build(MIXED)
    np.testing.assert_array_equal(scene.camera.target, [0, 0, 8])
    assert (scene.camera.width, scene.camera.height) == (8, 8)
    assert (scene.defaults.spp, scene.defaults.max_depth) == (3, 2)
    assert scene.triangles.vertices.shape == (6, 3)
    np.testing.assert_array_equal(scene.triangles.faces, [[0, 1, 2], [3, 4, 5]])
    np.testing.assert_array_equal(scene.lights.intensity, [[2, 2, 2]])
    np.testing.assert_allclose(scene.spheres.power, np.square([0, 2.5, 5, 7.5, 10, 12.5]) - 1)
    assert scene.origin is None


def test_what_is_absent_is_none():
    with pytest.warns(jaxrt.SceneWarning, match="no light"):
        scene = jaxrt.build({"camera": {"position": [0, 0, 0]}})
    assert scene.spheres is scene.triangles is scene.lights is scene.environment is None
    assert scene.materials.counts == () and scene.materials.mirror is None
    points = MIXED | {"lights": [{"position": [0, 5, 0], "intensity": 2}], "spheres": [], "triangles": []}
    assert jaxrt.build(points).lights.radius is None
    assert jaxrt.build(points | {"environment": {"radiance": [1, 2, 3]}}).environment.shape == (3,)


def test_errors_and_warnings_come_from_build():
    with pytest.raises(jaxrt.SceneError, match=r'spheres\[0\].material: unknown material "sliver".*"silver"'):
        jaxrt.build(MIXED | {"spheres": [{"center": [0, 0, 0], "radius": 1, "material": "sliver"}]})
    with pytest.warns(jaxrt.SceneWarning, match="point light and the scene has glass"):
        jaxrt.build(MIXED | {"lights": [{"position": [0, 5, 0], "intensity": 2}]})
    with pytest.raises(jaxrt.SceneError, match="GiB"):
        jaxrt.build(MIXED | {"camera": {"position": [0, 0, 9], "width": 100_000, "height": 1_000_000}})


def test_the_power_of_a_huge_sphere_keeps_its_digits():
    """|c|² − r² of the centre as written, in float64. From the rounded centre it is off by thousands at 1e6."""
    wall = {"center": [0, -1e6 - 0.1, 3], "radius": 1e6, "material": "red"}
    spheres = jaxrt.build(MIXED | {"spheres": [wall]}).spheres
    exact = 0.1 * (2e6 + 0.1) + 9
    assert float(spheres.power[0]) == pytest.approx(exact, rel=2**-24)
    c, r = np.asarray(spheres.center[0]), np.float32(spheres.radius[0])
    assert abs(np.sum(c.astype(float) ** 2) - float(r) ** 2 - exact) > 1000
    assert abs(float(np.sum(c * c) - r * r) - exact) > 1000


@pytest.mark.parametrize("offset", [(1e6, 0, 0), (-3e5, 2e6, 1e6)])
def test_a_far_off_scene_is_moved_to_the_origin(offset):
    """Relative positions survive to float32 rounding of the scene's size; naive float32 loses 1/16 at 1e6.

    Parameters are told in the user's coordinates.
    """
    near, far = jaxrt.build(MIXED), jaxrt.build(moved(MIXED, offset))
    shift = np.asarray(far.origin) - offset
    assert np.linalg.norm(shift) < 20
    pairs = [
        (near.camera.position, far.camera.position),
        (near.camera.target, far.camera.target),
        (near.spheres.center, far.spheres.center),
        (near.triangles.vertices, far.triangles.vertices),
        (near.lights.position, far.lights.position),
    ]
    for a, b in pairs:
        np.testing.assert_allclose(np.asarray(b, float) + shift, a, atol=2e-6)
    told = jaxrt.parameters(far)
    np.testing.assert_allclose(told["spheres.center"], near.spheres.center + jnp.float32(offset)[None], atol=0.25)
    np.testing.assert_array_equal(far.spheres.radius, near.spheres.radius)


def test_a_near_scene_stays_where_it_is():
    assert jaxrt.build(moved(MIXED, (30, 0, 0))).origin is None


def furnace(dtype):
    ball = {"center": [0, 0, 0], "radius": 2, "material": "wall"}
    return jaxrt.build(
        {
            "camera": {"position": [0.3, 0.1, 0.2], "target": [1, 0.4, -0.2], "width": 8, "height": 8},
            "materials": {"wall": {"type": "diffuse", "albedo": [0.2, 0.5, 0.8]}},
            "spheres": [ball],
            "lights": [{"position": [0.1, 0.9, 0.5], "intensity": 5}],
        },
        dtype,
    )


def test_float64_twin():
    """All floats are float64, and so is the picture; same numbers, so float32 differs by rounding: 1e-4."""
    single = np.asarray(jaxrt.render(furnace(jnp.float32), 7, spp=16, max_depth=4, devices=jax.devices()[:1]))
    with jax.enable_x64(True):
        scene = furnace(jnp.float64)
        floats = [x for x in jax.tree.leaves(scene) if jnp.issubdtype(x.dtype, jnp.floating)]
        assert {x.dtype for x in floats} == {np.dtype("float64")}
        double = np.asarray(jaxrt.render(scene, 7, spp=16, max_depth=4, devices=jax.devices()[:1]))
    assert single.dtype == np.float32 and double.dtype == np.float64
    np.testing.assert_allclose(single, double, rtol=1e-4)
    assert np.any(single != double)
