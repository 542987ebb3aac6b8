"""Poses as parameters: rotations in closed form, what they move, what is compiled, what files hold of them."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from edge_scenes import bumps, quick_jit, relative
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

import jaxrt
from jaxrt.description.pose import rotation_matrix, rotation_vector
from jaxrt.fit import sought
from jaxrt.fit.document import write_scene
from jaxrt.gradcheck.coverage import coverage
from jaxrt.gradcheck.steps import default_step
from jaxrt.io.scene_file import read_description
from jaxrt.render import draw_sum, prepare
from jaxrt.scene import placed
from jaxrt.scene.selectors import parse_selector
from tests.test_compilations import compilations

CUBE = {
    "vertices": [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)],
    "faces": [[a, b, c] for p, q, r, s in ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4),
              (1, 5, 7, 3)) for a, b, c in ((p, q, r), (p, r, s))],
    "material": "red",
}  # fmt: skip
BOX = CUBE | {"name": "box", "scale": 0.4, "rotate": [0, 25, 0], "translate": [0.9, 0.5, 0.3]}
FLOOR = [[[-4, 0, -4], [4, 0, 4], [4, 0, -4]], [[-4, 0, -4], [-4, 0, 4], [4, 0, 4]]]
SCENE = {
    "camera": {"position": [0, 2.2, 5], "target": [0, 0.4, 0.2], "fov": 38, "width": 32, "height": 32},
    "materials": {
        "red": {"type": "diffuse", "albedo": [0.8, 0.3, 0.2]},
        "white": {"type": "diffuse", "albedo": [0.8, 0.8, 0.8]},
        "black": {"type": "diffuse", "albedo": [0, 0, 0]},  # shading at the rim of a ball changes without bound: noise
    },
    "groups": {"pair": {"translate": [-0.7, 0.2, 0], "rotate": [0, 40, 0], "scale": 0.9}},
    "spheres": [
        {"center": [0, 0.5, 0.4], "radius": 0.3, "material": "black", "group": "pair"},
        {"center": [0.1, 0.25, 1.6], "radius": 0.2, "material": "red"},
    ],
    "meshes": [BOX, CUBE | {"scale": 0.3, "translate": [0.2, 0.6, -0.5], "group": "pair", "rotate_vector": [9, 8, 7]}],
    "triangles": [{"vertices": face, "material": "white"} for face in FLOOR],
    "lights": [{"position": [0.5, 4, 1.5], "intensity": 30}],
}  # fmt: skip
FIELDS = ("translate", "rotate", "scale")
POSES = [f"{owner}.{field}" for owner in ("meshes", "groups") for field in FIELDS]


@pytest.fixture(scope="module")
def scene():
    return jaxrt.build(SCENE)


@pytest.fixture(scope="module")
def posed(scene):
    return jaxrt.with_parameters(scene, {"meshes.rotate[box]": jaxrt.parameters(scene, "meshes.rotate[box]")})


def shapes(scene):
    at = placed(scene)
    return np.concatenate([at.triangles.vertices, at.spheres.center, at.spheres.radius[:, None] * np.ones((1, 3))])


VECTORS = {
    "none": [0, 0, 0], "tiny": [1e-30, 0, -1e-30], "small": [3e-4, -2e-4, 1e-4], "below 1": [0.57, -0.57, 0.58],
    "above 1": [0.58, -0.58, 0.58], "half a turn": [0, np.pi, 0], "askew": np.pi * np.array([2, -1, 2]) / 3,
    "almost a turn": [0, 0, 6.28], "beyond": [4, 5, -6],
}  # fmt: skip


def cross_matrix(vector):
    x, y, z = vector
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


@pytest.mark.usefixtures("quick_compilation")
@pytest.mark.parametrize("vector", VECTORS.values(), ids=VECTORS)
def test_rigid_and_its_derivative_in_closed_form(vector):
    """The derivative of R(ω)p is −[Rp]ₓ J(ω) with J the left Jacobian of SO(3), here by a matrix exponential."""
    vector = np.asarray(vector, float)
    points, shift = np.random.default_rng(0).normal(size=(5, 3)), np.array([1.0, -2, 3])
    turned = points @ Rotation.from_rotvec(vector).as_matrix().T
    found = jaxrt.rigid(points, vector, shift)
    assert found.dtype == jnp.float32
    np.testing.assert_allclose(found, turned + shift, atol=5e-6)
    whole = np.block([[cross_matrix(vector), np.eye(3)], [np.zeros((3, 6))]])
    left = expm(whole)[:3, 3:]  # ∫ exp(s[ω]ₓ) ds
    wanted = np.stack([-cross_matrix(p) @ left for p in turned])
    derivative = jax.jacfwd(jaxrt.rigid, 1)(jnp.asarray(points), jnp.asarray(vector, jnp.float32), shift)
    np.testing.assert_allclose(derivative, wanted, atol=2e-5)
    backwards = jax.jacrev(jaxrt.rigid, 1)(jnp.asarray(points), jnp.asarray(vector, jnp.float32), shift)
    np.testing.assert_allclose(backwards, wanted, atol=2e-5)
    np.testing.assert_allclose(
        rotation_matrix(np.degrees(vector)), Rotation.from_rotvec(vector).as_matrix(), atol=1e-14
    )
    if np.linalg.norm(vector) < 3.1:
        again = np.radians(rotation_vector(Rotation.from_rotvec(vector).as_matrix()))
        np.testing.assert_allclose(again, vector, atol=1e-14)


@pytest.mark.usefixtures("quick_compilation")
def test_rigid_is_exact_and_smooth_at_none():
    points, nothing = jnp.asarray(np.random.default_rng(1).normal(size=(4, 2, 3)), jnp.float32), jnp.zeros(3)
    np.testing.assert_array_equal(jaxrt.rigid(points, nothing, nothing), points)
    second = jax.hessian(lambda w: jaxrt.rigid(points[0, 0], w, nothing))(nothing)
    x = np.asarray(points[0, 0], float)
    for i, j in np.ndindex(3, 3):  # ½ (eᵢ × (eⱼ × x) + eⱼ × (eᵢ × x))
        e = np.eye(3)
        wanted = (np.cross(e[i], np.cross(e[j], x)) + np.cross(e[j], np.cross(e[i], x))) / 2
        np.testing.assert_allclose(second[:, i, j], wanted, atol=1e-6)


@pytest.mark.parametrize("angle", [0, 1e-9, 0.1, 3, 179.999999, 180])
def test_vectors_of_rotation_matrices(angle):
    axis = np.array([0.6, -0.48, 0.64])
    matrix = Rotation.from_rotvec(np.radians(angle) * axis).as_matrix()
    np.testing.assert_allclose(rotation_matrix(rotation_vector(matrix)), matrix, atol=1e-14)


def test_poses_are_parameters_of_scenes_that_ask_for_them(scene, posed):
    assert not set(POSES) & jaxrt.parameters(scene).keys()
    assert set(POSES) <= jaxrt.parameters(posed).keys()
    in_file = SCENE | {"meshes": [BOX | {"pose": True}, SCENE["meshes"][1]]}
    assert jaxrt.parameters(jaxrt.build(in_file)).keys() == jaxrt.parameters(posed).keys()
    by_group = SCENE | {"groups": {"pair": SCENE["groups"]["pair"] | {"pose": True}}}
    assert jaxrt.parameters(jaxrt.build(by_group)).keys() == jaxrt.parameters(posed).keys()
    assert jaxrt.names(posed)["meshes.rotate"] == ("box", "mesh1") and jaxrt.names(posed)["groups.scale"] == ("pair",)
    for name in POSES:
        np.testing.assert_array_equal(jaxrt.parameters(scene, name), jaxrt.parameters(posed)[name])
    np.testing.assert_allclose(jaxrt.parameters(scene, "meshes.translate[box]"), BOX["translate"])
    np.testing.assert_allclose(jaxrt.parameters(scene, "meshes.rotate"), [[0, 0, 0], [9, 8, 7]])
    np.testing.assert_allclose(jaxrt.parameters(scene, "groups.scale[pair]"), 0.9)
    np.testing.assert_allclose(shapes(posed), shapes(scene), atol=1e-6)


def test_a_pose_places_what_a_file_with_it_would(scene):
    changes = {
        "meshes.translate[mesh1]": [0.3, 0.4, 0.5],
        "meshes.rotate[0]": [30, -40, 50.0],
        "meshes.scale": [0.7, 0.2],
    }
    changes |= {"groups.translate": [[0, 0.1, 0.2]], "groups.rotate[pair]": [0, 0, 200.0], "groups.scale[pair]": 1.3}
    new = jaxrt.with_parameters(scene, changes)
    meshes = [BOX | {"rotate_vector": [30, -40, 50], "scale": 0.7}, SCENE["meshes"][1] | {"scale": 0.2}]
    meshes[1] |= {"translate": [0.3, 0.4, 0.5]}
    pair = SCENE["groups"]["pair"] | {"translate": [0, 0.1, 0.2], "rotate_vector": [0, 0, 200], "scale": 1.3}
    wanted = jaxrt.build(SCENE | {"meshes": meshes, "groups": {"pair": pair}})
    np.testing.assert_allclose(shapes(new), shapes(wanted), atol=2e-6)
    # By hand: scale, rotate, rotate_vector, translate
    vertices = 0.7 * np.array(CUBE["vertices"]) @ Rotation.from_euler("y", 25, degrees=True).as_matrix().T
    vertices = Rotation.from_rotvec([30, -40, 50], degrees=True).apply(vertices) + BOX["translate"]
    np.testing.assert_allclose(jaxrt.parameters(new, "meshes.vertices[box]"), vertices, atol=1e-6)
    for name, value in changes.items():
        np.testing.assert_allclose(jaxrt.parameters(new, name), value, rtol=1e-6)


def test_places_are_those_of_the_pose_before(scene, posed):
    """Vertices, centres and radii are told where they stand, and what is changed beside a pose moves with it."""
    corner, center = jnp.asarray([0.5, 0.6, 0.7]), jnp.asarray([-1, 0.5, 0.1])
    places = {"meshes.vertices[3]": corner, "spheres.center[0]": center, "spheres.radius[0]": jnp.asarray(0.25)}
    moved = jaxrt.with_parameters(posed, places)
    for name, value in places.items():
        np.testing.assert_allclose(jaxrt.parameters(moved, name), value, atol=1e-6)
    pose = {"meshes.rotate[box]": jnp.asarray([0, 90.0, 0]), "groups.scale[pair]": jnp.asarray(1.8)}
    both = jaxrt.with_parameters(posed, places | pose)
    np.testing.assert_allclose(shapes(both), shapes(jaxrt.with_parameters(moved, pose)), atol=1e-6)
    np.testing.assert_allclose(jaxrt.parameters(both, "spheres.radius[0]"), 0.5, rtol=1e-6)


@pytest.mark.usefixtures("quick_compilation")
def test_far_off_scenes_are_posed_near_their_origin():
    far, turn = np.array([1e6, -2e5, 3e5]), Rotation.from_euler("y", 40, degrees=True)
    stays = far - turn.apply(far)  # what keeps in place what turns about the user's origin
    there = jaxrt.build(
        SCENE
        | {
            "camera": SCENE["camera"] | {"position": [0, 2.2, 5] + far, "target": [0, 0.4, 0.2] + far},
            "lights": [{"position": [0.5, 4, 1.5] + far, "intensity": 30}],
            "triangles": [{"vertices": np.array(face) + far, "material": "white"} for face in FLOOR],
            "meshes": [mesh | {"translate": mesh["translate"] + far} for mesh in SCENE["meshes"]],
            "spheres": [ball | {"center": ball["center"] + far} for ball in SCENE["spheres"]],
            "groups": {"pair": {"rotate": [0, 40, 0], "translate": stays}},
        }
    )
    here = jaxrt.build(SCENE | {"groups": {"pair": {"rotate": [0, 40, 0]}}})
    assert there.origin is not None and here.origin is None

    def seen(scene, changes):
        changed = jaxrt.with_parameters(scene, changes)
        return shapes(changed)[:-2] - np.asarray(changed.camera.position)

    turned = {"meshes.rotate[mesh1]": [0, 30, 0]}
    np.testing.assert_allclose(seen(there, turned), seen(here, turned), atol=1e-5)
    for name, value, wanted in (
        ("meshes.translate[mesh1]", [1, 2, 3] + far, [1, 2, 3]),
        ("groups.translate[pair]", stays + [1, 2, 3], [1, 2, 3]),
    ):
        # Numbers near 1e6 are 1/16 apart
        np.testing.assert_allclose(seen(there, {name: value}), seen(here, {name: wanted}), atol=0.13)


def test_what_is_compiled_knows_nothing_of_poses(scene, posed):
    devices = jax.devices()[:1]
    plain = prepare(scene, 0, 0, 1, 1, max_depth=1, devices=devices)[0]
    with_poses = prepare(posed, 0, 0, 1, 1, max_depth=1, devices=devices)[0]
    assert jax.tree.structure(plain) == jax.tree.structure(with_poses)
    assert jax.tree.map(jnp.shape, plain) == jax.tree.map(jnp.shape, with_poses)


@pytest.mark.usefixtures("quick_compilation")
def test_a_turntable_of_a_posed_mesh_is_compiled_once(posed):
    def frame(k):
        turned = jaxrt.with_parameters(posed, {"meshes.rotate[box]": jnp.asarray([0, 30.0 * k, 0])})
        return np.asarray(jaxrt.render(turned, 0, spp=1, max_depth=1))

    draw_sum.clear_cache()
    frames = [frame(0)]
    with compilations(0):
        frames += [frame(k) for k in range(1, 12)]
    assert draw_sum._cache_size() == 1
    # The cube looks alike after a quarter of a turn, to what the sampling of its edges shows
    assert relative(frames[3], frames[0]) < 0.02 < relative(frames[1], frames[0])


N, SPP, SEEDS = 16384, 128, 4
MOTIONS = {
    "turned": ({"meshes.rotate": [[30, -50, 20], [0, 0, 0]]}, 0.03),
    "moved and swollen": ({"meshes.translate": [[0.5, 0.3, -0.4], [0, 0, 0]], "meshes.scale": [0.3, 0.0]}, 0.03),
    "group": ({"groups.rotate": [[20, 60, -30]], "groups.translate": [[0.2, 0.3, 0.5]], "groups.scale": [-0.4]}, 0.015),
}


@quick_jit
def derivative(scene, changes, key):
    values = {name: jaxrt.parameters(scene)[name] for name in POSES}

    def picture(values):
        return jaxrt.render(jaxrt.with_parameters(scene, values), key, spp=SPP, max_depth=1, boundary_samples=N)

    return jax.jvp(picture, (values,), (changes,))[1]


@pytest.mark.parametrize("motion", MOTIONS)
def test_derivatives_in_poses_are_those_of_finite_differences(posed, motion):
    """Shadow edges and outlines flow through poses: relative L2 of 16 smooth functionals, means of four seeds.

    The standard error of their difference is below .01; the step's truncation is below .005.
    """
    changes, h = MOTIONS[motion]
    values = {name: jaxrt.parameters(posed)[name] for name in POSES}
    changes = {
        name: jnp.asarray(changes.get(name, np.zeros(value.shape)), jnp.float32) for name, value in values.items()
    }

    def shifted(step):
        return jaxrt.with_parameters(posed, {name: values[name] + step * changes[name] for name in POSES})

    def difference(key):
        ahead, behind = (jaxrt.render(shifted(s), key, spp=16 * SPP, max_depth=1) for s in (h, -h))
        return bumps((np.asarray(ahead, float) - np.asarray(behind, float)) / (2 * h))

    wanted = np.stack([difference(10 + k) for k in range(SEEDS)])
    found = np.stack([bumps(derivative(posed, changes, 20 + k)) for k in range(SEEDS)])
    noise = np.hypot(found.std(0, ddof=1), wanted.std(0, ddof=1)) / SEEDS**0.5
    size = np.linalg.norm(wanted.mean(0))
    assert np.linalg.norm(noise) < 0.01 * size
    assert relative(found.mean(0), wanted.mean(0)) < 0.03


def test_gradcheck_knows_what_a_pose_moves(scene, posed):
    terms = coverage(posed, "meshes.rotate", 1, 100, 0)
    assert terms.edges and {"shadow edges", "outlines seen by the camera"} <= set(terms.included) and not terms.missing
    steps = {text: default_step(posed, parse_selector(text, posed), 1.0) for text in
             ("meshes.translate[box]", "meshes.rotate[box]", "meshes.scale[box]", "groups.rotate[pair]")}  # fmt: skip
    diagonal = 0.8 * 3**0.5
    assert 0.01 < steps["meshes.translate[box]"] < 0.05 * diagonal
    assert np.radians(steps["meshes.rotate[box]"]) * diagonal / 2 == pytest.approx(
        steps["meshes.translate[box]"], rel=1e-4
    )
    assert steps["meshes.scale[box]"] == pytest.approx(np.radians(steps["meshes.rotate[box]"]), rel=1e-4)
    assert 0.5 < steps["groups.rotate[pair]"] < 10


FILE = """\
camera = {position = [0, 1, 6], fov = 40, width = 8, height = 8}
lights = [{position = [2, 4, 3], intensity = 40}]
materials.a.albedo = [0.5, 0.4, 0.3]
materials.a.type = "diffuse"

[[meshes]]  # the mug
file = "mug.obj"
material = "a"
rotate = [0, 20, 0]
translate = [0, 1, 0]  # on the table

[[meshes]]
name = "jug"
file = "mug.obj"
material = "a"
group = "set"

[[spheres]]
center = [1, 0, 0]
radius = 0.3
material = "a"
group = "set"

[groups.set]
rotate = [0, 90, 0]
scale = 2
"""


@pytest.mark.usefixtures("quick_compilation")
def test_poses_are_written_where_they_are_read(tmp_path: Path):
    (tmp_path / "mug.obj").write_text("v -1 0 0\nv 1 0 0\nv 0 2 0\nv 0 0 1\nf 1 2 3\nf 1 4 2\n")
    source = tmp_path / "scene.toml"
    source.write_text(FILE)
    scene = jaxrt.load_scene(source)
    texts = [*(f"{owner}.{field}" for owner in ("meshes", "groups") for field in FIELDS), "spheres.center[0]",
             "spheres.radius[0]", "lights.position[0]"]  # fmt: skip
    unknowns = sought(scene, texts)
    posed = jaxrt.with_parameters(scene, {"meshes.scale": [1, 1.0]})
    assert [row.text for row in unknowns.rows][:2] == ["meshes.translate[0]", "meshes.translate[1]"]
    vector = unknowns.vector(posed) + np.random.default_rng(0).uniform(-0.2, 0.2, len(unknowns.labels()))
    values = unknowns.values(vector)
    selectors = {row.text: row.selector for row in unknowns.rows}
    (tmp_path / "out").mkdir()
    write_scene(source, tmp_path / "out/fitted.toml", values, selectors, read_description(source))
    text = (tmp_path / "out/fitted.toml").read_text()
    assert (
        "# the mug" in text and "# on the table" in text and "rotate = [0, 20, 0]" in text and "rotate_vector" in text
    )
    wanted = jaxrt.with_parameters(scene, {str(selectors[name]): value for name, value in values.items()})
    found = jaxrt.load_scene(tmp_path / "out/fitted.toml", allow_folders=[tmp_path])
    np.testing.assert_allclose(shapes(found), shapes(wanted), atol=2e-5)
    for name, value in jaxrt.parameters(wanted).items():
        np.testing.assert_allclose(jaxrt.parameters(found, name), value, atol=2e-5, err_msg=name)


def test_unknowns_of_a_pose_have_the_weight_of_places(scene):
    unknowns = sought(scene, ["meshes.rotate[box]", "meshes.translate[box]", "meshes.scale[box]"])
    assert unknowns.labels() == [f"meshes.{f}[box].{a}" for f in ("rotate", "translate") for a in "xyz"] + [
        "meshes.scale[box]"
    ]
    vector = np.array([0.1, -0.2, 0.3, 0.01, 0.02, 0.03, np.log(2)])
    values = unknowns.values(vector)
    np.testing.assert_allclose(values["meshes.rotate[box]"], np.degrees(vector[:3]))
    np.testing.assert_allclose(values["meshes.scale[box]"], 2)
    scene = unknowns.apply(scene, jnp.asarray(vector, jnp.float32))
    for name, value in values.items():
        np.testing.assert_allclose(jaxrt.parameters(scene, name), value, rtol=1e-5)
    step = 1e-6
    slopes = [(np.concatenate([np.ravel(v) for v in unknowns.values(vector + step * e).values()])
               - np.concatenate([np.ravel(v) for v in values.values()])) / step for e in np.eye(7)]  # fmt: skip
    np.testing.assert_allclose(unknowns.slopes(vector), np.sum(slopes, 0), rtol=1e-4)


REFUSED = [
    ({"groups": [{"scale": 2}]}, "is not a table: write [groups.NAME]"),
    ({"groups": {"pair": {"scale": 0}}}, "is not > 0: use a positive scale"),
    ({"groups": {"pair": {"turn": 3}}}, 'groups.pair: unknown key "turn"'),
    ({"groups": {"pear": {}}}, 'spheres[0].group: unknown group "pair" (did you mean "pear"?)'),
    ({"groups": {}}, 'spheres[0].group: unknown group "pair": add [groups.pair]'),
    ({"groups": {"pair": {"translate": [1e15, 0, 0], "scale": 1e9}}}, 'group: "pair" makes it too large'),
    ({"meshes": [BOX | {"pose": 1}]}, "meshes[0].pose: 1 is not a truth value: write true or false"),
    ({"meshes": [BOX | {"rotate_vector": [0, 1]}]}, "meshes[0].rotate_vector: [0, 1] has 2 values: write 3"),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "message"), REFUSED)
def test_what_is_wrong_with_a_pose_is_said_in_one_line(changes, message):
    with pytest.raises(jaxrt.SceneError) as error:
        jaxrt.build(SCENE | changes)
    assert message in str(error.value) and "\n" not in str(error.value)


def test_what_has_no_pose_is_said(scene):
    balls = jaxrt.build({key: value for key, value in SCENE.items() if key not in ("meshes", "groups", "spheres")})
    for name in ("meshes.rotate", "groups.scale[pair]"):
        with pytest.raises(jaxrt.SceneError, match="the scene has no such parameter"):
            jaxrt.with_parameters(balls, {name: 1.0})
    with pytest.raises(jaxrt.SceneError, match=r"meshes.rotate\[bax\]: no mesh of that name .did you mean"):
        jaxrt.parameters(scene, "meshes.rotate[bax]")
    with pytest.raises(jaxrt.SceneError, match=r"shape \(2,\), want \(3,\)"):
        jaxrt.with_parameters(scene, {"meshes.rotate[box]": [1.0, 2.0]})
