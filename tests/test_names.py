"""Names of rows: in selectors from Python, and never in what is compiled."""

import jax
import numpy as np
import pytest

import jaxrt
from jaxrt.fit import sought
from jaxrt.programs.key import key_of
from jaxrt.render import prepare
from jaxrt.scene.selectors import parse_selector

CORNERS = {
    "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "faces": [[0, 1, 2], [0, 1, 3]],
    "material": "white",
}


def table(lamp="lamp", ball="ball", mug="mug", white="white"):
    """Return a scene with names of all kinds."""
    return {
        "camera": {"position": [0, 0, 9], "width": 4, "height": 4},
        "materials": {
            "flint": {"type": "glass", "ior": 1.6},
            white: {"type": "diffuse", "albedo": [0.8, 0.7, 0.6]},
            "silver": {"type": "mirror", "albedo": [0.9, 0.9, 0.9]},
            "spare": {"type": "diffuse", "albedo": [0.1, 0.1, 0.1]},
        },
        "spheres": [
            {"center": [3, 0, 0], "radius": 1, "material": "flint"},
            {"center": [6, 0, 0], "radius": 1, "material": "silver", "name": ball},
        ],
        "meshes": [
            CORNERS | {"material": white},
            CORNERS | {"material": white, "name": mug, "translate": [1, 2, 3]},
            CORNERS | {"material": white, "file": "models/jug.obj", "translate": [2, 4, 6]},
            CORNERS | {"material": white, "file": "twice.obj", "translate": [3, 6, 9]},
            CORNERS | {"material": white, "file": "a/twice.ply", "translate": [4, 8, 12]},
        ],
        "lights": [
            {"position": [0, 9, 0], "intensity": 5, "radius": 1},
            {"position": [1, 9, 0], "intensity": 5, "radius": 1, "name": lamp},
        ],
    }


@pytest.fixture(scope="module")
def scene():
    return jaxrt.build(table())


def test_s5_what_rows_can_be_called(scene):
    assert jaxrt.names(scene) == {
        "lights.position": ("lamp",),
        "lights.intensity": ("lamp",),
        "lights.radius": ("lamp",),
        "materials.albedo": ("white", "silver", "spare"),
        "materials.ior": ("flint",),
        "spheres.center": ("ball",),
        "spheres.radius": ("ball",),
        "meshes.vertices": ("mesh0", "mug", "jug", "mesh3", "mesh4"),
    }


@pytest.mark.parametrize(
    ("text", "name", "rows"),
    [
        ("materials.albedo[silver]", "materials.albedo", 1),
        ("materials.ior[flint]", "materials.ior", 0),
        ("lights.position[lamp]", "lights.position", 1),
        ("lights.radius[0]", "lights.radius", 0),
        ("spheres.center[ball]", "spheres.center", 1),
        ("meshes.vertices[mug]", "meshes.vertices", slice(4, 8)),
        ("meshes.vertices[jug]", "meshes.vertices", slice(8, 12)),
        ("camera.fov", "camera.fov", ()),
        ("materials.albedo", "materials.albedo", ()),
    ],
)
def test_s5_rows_are_read_and_changed_by_name(scene, text, name, rows):
    before = {key: np.asarray(value) for key, value in jaxrt.parameters(scene).items()}
    np.testing.assert_array_equal(jaxrt.parameters(scene, text), before[name][rows])
    after = jaxrt.parameters(jaxrt.with_parameters(scene, {text: before[name][rows] / 2}))
    before[name] = before[name].copy()
    before[name][rows] /= 2
    for key, value in after.items():
        np.testing.assert_allclose(value, before[key], rtol=1e-6, err_msg=key)


def test_s5_several_rows_and_their_derivatives(scene):
    def red(albedo, other):
        changes = {"materials.albedo[white]": albedo, "materials.albedo[2]": other}
        return jaxrt.parameters(jaxrt.with_parameters(scene, changes))["materials.albedo"][:, 0].sum()

    value, slopes = jax.value_and_grad(red, (0, 1))(np.float32([1, 2, 3]), np.float32([4, 5, 6]))
    assert value == pytest.approx(1 + 0.9 + 4)
    np.testing.assert_array_equal(slopes, [[1, 0, 0], [1, 0, 0]])


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        (
            {"materials.albedo[whit]": [1, 1, 1]},
            r'materials\.albedo\[whit\]: no material of that name \(did you mean "white"\?\)',
        ),
        (
            {"materials.albedo[3]": [1, 1, 1]},
            r"materials\.albedo\[3\]: no such row: use materials\.albedo\[0\] to .*\[2\]",
        ),
        ({"materials.albedo[-1]": [1, 1, 1]}, r"materials\.albedo\[-1\]: no such row: use .*"),
        ({"materials.albedo[white]": [1, 1]}, r"materials\.albedo\[white\]: shape \(2,\), want \(3,\) as in .*"),
        ({"camera.fov[x]": 1}, r"camera\.fov\[x\]: camera\.fov has no rows: write camera\.fov"),
        ({"albedo": 1}, r"albedo: the scene has no such parameter .*"),
        ({"materials.albedo[": 1}, r'"materials\.albedo\[": is no parameter: write NAME or NAME\[ROW\], .*'),
        ({3: 1}, r"3: is no parameter: write NAME or NAME\[ROW\], .*"),
        ({"spheres.radius[" + "9" * 5000 + "]": 1}, r"spheres\.radius\[9+.*"),
        (
            {"spheres.radius[ball]": 1, "spheres.radius[1]": 2},
            r"spheres\.radius\[1\]: is changed twice: name each row .*",
        ),
        ({"spheres.radius[ball]": 1, "spheres.radius": [1, 2]}, r"spheres\.radius: is changed twice: name each row .*"),
    ],
)
def test_s5_wrong_rows_are_refused_in_one_line(scene, changes, line):
    with pytest.raises(jaxrt.SceneError, match=f"^{line}$") as refused:
        jaxrt.with_parameters(scene, changes)
    assert str(refused.value).isprintable() and len(str(refused.value)) < 1100
    if len(changes) == 1 and "shape" not in line:
        with pytest.raises(jaxrt.SceneError, match=f"^{line}$"):
            jaxrt.parameters(scene, *changes)


def test_s5_selectors_of_one_row(scene):
    assert parse_selector("lights.position[lamp]", scene) == ("lights.position", 1)
    with pytest.raises(jaxrt.SceneError, match=r"meshes\.vertices\[mug\]: has 4 rows: choose one, from .*\[4\] on"):
        parse_selector("meshes.vertices[mug]", scene)


def test_s5_names_are_not_given_twice():
    for group in ("spheres", "meshes", "lights"):
        twice = table()
        for member in twice[group][:2]:
            member["name"] = "x"
        with pytest.raises(
            jaxrt.SceneError, match=rf'{group}\[1\]\.name: "x" is the name of {group}\[0\] already: choose'
        ):
            jaxrt.build(twice)


def test_s5_a_rename_compiles_nothing(scene):
    renamed = jaxrt.build(table("l", "b", "m", "w"))
    assert (
        jaxrt.names(renamed)["materials.albedo"] == ("w", "silver", "spare") != jaxrt.names(scene)["materials.albedo"]
    )
    assert jax.tree.structure(scene) == jax.tree.structure(renamed)
    assert hash(jax.tree.structure(scene)) == hash(jax.tree.structure(renamed))
    program = jax.jit(lambda scene: jaxrt.parameters(scene)["camera.fov"])
    program(scene), program(renamed)
    assert program._cache_size() == 1
    keys = [key_of(*prepare(each, 0, 0, 1, 1, max_depth=1)) for each in (scene, renamed)]
    assert keys[0] == keys[1] and b"lamp" not in keys[0]


def test_s5_a_fit_takes_all_vertices_of_a_mesh_by_its_name(scene):
    unknowns = sought(scene, ["meshes.vertices[mug]", "materials.albedo[silver]"])
    assert unknowns.labels()[::3] == [f"meshes.vertices[{i}].x" for i in range(4, 8)] + ["materials.albedo[silver].r"]
    moved = jaxrt.parameters(scene, "meshes.vertices[mug]") + 1
    values = [*moved, jaxrt.parameters(scene, "materials.albedo[silver]")]
    changed = unknowns.put(scene, values)
    np.testing.assert_allclose(jaxrt.parameters(changed, "meshes.vertices[mug]"), moved)


def test_a_number_is_a_row_also_where_a_thing_goes_by_it():
    mapping = table(lamp="0", white="1")
    scene = jaxrt.build(mapping)
    for name, row in (("lights.position[0]", 0), ("lights.position[1]", 1), ("materials.albedo[1]", 1)):
        assert parse_selector(name, scene).row == row
        owner = name.partition("[")[0]
        np.testing.assert_array_equal(jaxrt.parameters(scene, name), jaxrt.parameters(scene)[owner][row])
    assert [row.selector.row for row in sought(scene, ["lights.position"]).rows] == [0, 1]
