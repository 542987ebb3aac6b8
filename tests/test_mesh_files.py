"""Meshes in scenes: kinds of files, placing, materials, the one table of triangles, warnings, far-off scenes."""

import warnings

import jax
import numpy as np
import pytest
import trimesh

import jaxrt
from jaxrt.description import parse_description
from jaxrt.description.mesh_facts import (
    count_edges,
    nearest_distances,
    signed_volume,
    triangle_distances,
    weld,
    winding_number,
)
from jaxrt.scene.checks import warnings_of

CAMERA = {"position": [0, 0, 5], "width": 16, "height": 16, "fov": 40}
LIGHT = {"position": [2, 4, 5], "intensity": 90, "radius": 0.2}
MATERIALS = {
    "white": {"type": "diffuse", "albedo": [0.8, 0.8, 0.8]},
    "glass": {"type": "glass", "ior": 1.5},
}


def ball(level=2):
    mesh = trimesh.creation.icosphere(level)
    return np.array(mesh.vertices), np.array(mesh.faces)


def arrays(vertices, faces, **rest):
    return {"vertices": vertices, "faces": faces, "material": "white"} | rest


def description(*meshes, **rest):
    return {"camera": CAMERA, "materials": MATERIALS, "meshes": list(meshes), "lights": [LIGHT]} | rest


def warned(*meshes, **rest):
    told = warnings_of(parse_description(description(*meshes, **rest)))
    return [message for message in told if "is used by nothing" not in message]


# Files


@pytest.mark.parametrize("kind", ["obj", "ply", "stl", "glb", "off"])
def test_every_kind_of_file_gives_the_same_mesh(tmp_path, kind):
    """Faces in the order of the file; vertices too, but for STL, which repeats them. STL and GLB store float32."""
    vertices, faces = ball()
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    mesh.export(tmp_path / f"ball.{kind}")
    loaded = jaxrt.load_mesh(tmp_path / f"ball.{kind}")
    assert loaded["vertices"].dtype == np.float64 and loaded["vertices"].shape == vertices.shape
    np.testing.assert_allclose(loaded["vertices"][loaded["faces"]], vertices[faces], atol=1e-7)
    if kind != "stl":
        np.testing.assert_array_equal(loaded["faces"], faces)


def test_a_glb_of_placed_parts_is_one_mesh(tmp_path):
    vertices, faces = ball(1)
    scene = trimesh.Scene()
    part = trimesh.Trimesh(vertices, faces, process=False)
    scene.add_geometry(part)
    scene.add_geometry(part, transform=trimesh.transformations.translation_matrix([5, 0, 0]))
    scene.export(tmp_path / "two.glb")
    loaded = jaxrt.load_mesh(tmp_path / "two.glb")
    assert loaded["faces"].shape == (2 * len(faces), 3)
    middle = loaded["vertices"].min(axis=0) / 2 + loaded["vertices"].max(axis=0) / 2
    np.testing.assert_allclose(middle, [2.5, 0, 0], atol=1e-6)


def test_the_file_is_sought_beside_the_scene(tmp_path, monkeypatch):
    (tmp_path / "deep").mkdir()
    trimesh.creation.icosphere(1).export(tmp_path / "deep" / "ball.obj")
    scene = "[camera]\nposition = [0, 0, 5]\n[materials.white]\ntype = 'diffuse'\nalbedo = [1, 1, 1]\n"
    scene += "[[lights]]\nposition = [0, 9, 9]\nintensity = 9\n[[meshes]]\nfile = 'ball.obj'\n"
    (tmp_path / "deep" / "scene.toml").write_text(scene + "material = 'white'\ntranslate = [0, 1, 0]\n")
    monkeypatch.chdir(tmp_path)
    triangles = jaxrt.load_scene("deep/scene.toml").triangles
    assert triangles.faces.shape == (80, 3)
    np.testing.assert_allclose(np.asarray(triangles.vertices).mean(axis=0), [0, 1, 0], atol=1e-6)
    for extra, message in (
        ("material = 'white'\nfaces = [[0, 1, 2]]", r'meshes\[0\]: "faces" and "file" exclude each other'),
        ("", r'meshes\[0\]: "material" is missing: add material = "white"'),
        ("material = 'whit'", r'meshes\[0\].material: unknown material "whit" \(did you mean "white"\?\)'),
        ("material = 'white'\nscale = 0", r"meshes\[0\].scale: 0.0 is not > 0: use a positive scale"),
        ("material = 'white'\nsmooth = 1", r"meshes\[0\].smooth: 1 is not a truth value: write true or false"),
        ("material = 'white'\nrotate = [1, 2]", r"meshes\[0\].rotate: \[1, 2\] has 2 values: write 3"),
        ("material = 'white'\nturn = 1", r'meshes\[0\]: unknown key "turn"'),
    ):
        (tmp_path / "deep" / "scene.toml").write_text(scene + extra + "\n")
        with pytest.raises(jaxrt.SceneError, match=rf"^deep/scene\.toml: {message}"):
            jaxrt.load_scene("deep/scene.toml")
    (tmp_path / "deep" / "scene.toml").write_text(scene.replace("ball.obj", "bal.obj"))
    with pytest.raises(jaxrt.SceneError, match=r"^deep/scene.toml: meshes\[0\].file: deep/bal.obj: no such file \(did"):
        jaxrt.load_scene("deep/scene.toml")


COLOURED = "mtllib paint.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
COLOURED += "usemtl red\nf 1 2 3\nusemtl blue\nf 1 3 4\nusemtl red\nf 1 2 4\n"
PAINT = "newmtl blue\nKd 0.1 0.2 0.7\nnewmtl unused\nKd 1 1 1\nnewmtl red\nKd 0.9 0.05 0.05\n"


@pytest.fixture
def coloured(tmp_path):
    (tmp_path / "quad.obj").write_text(COLOURED)
    (tmp_path / "paint.mtl").write_text(PAINT)
    return tmp_path / "quad.obj"


@pytest.mark.filterwarnings("ignore:.*lie in one plane and overlap")  # so few corners make three faces
@pytest.mark.parametrize("old", ["f 1 2 4", "  f -4 -3 -1"])
def test_mtl_colours_become_diffuse_materials(coloured, old):
    """One row per Kd that is used, exact, not rounded to bytes; one material a face, white not among them."""
    coloured.write_text(COLOURED.replace("f 1 2 4", old))
    mesh = jaxrt.load_mesh(coloured)
    scene = jaxrt.build(description(mesh))
    np.testing.assert_array_equal(scene.triangles.faces, [[0, 1, 2], [0, 2, 3], [0, 1, 3]])
    np.testing.assert_array_equal(scene.triangles.material, [0, 1, 0])
    rows = np.float32([[0.8, 0.8, 0.8], [0.9, 0.05, 0.05], [0.1, 0.2, 0.7]])
    np.testing.assert_array_equal(jaxrt.parameters(scene)["materials.albedo"], rows)


@pytest.mark.filterwarnings("ignore:.*lie in one plane and overlap")
def test_a_material_of_the_scene_wins_over_the_file(coloured):
    mesh = jaxrt.load_mesh(coloured)
    whole = jaxrt.build(description(mesh | {"material": "white"}))
    np.testing.assert_array_equal(whole.triangles.material, [0, 0, 0])
    assert whole.materials.counts == (1,)
    one = jaxrt.build(description(mesh, materials=MATERIALS | {"quad.obj:red": {"type": "mirror"}}))
    assert one.materials.counts == (1, 1)
    np.testing.assert_array_equal(one.triangles.material, [1, 0, 1])


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        ("paint.mtl", "Kd 0.9 0.05 0.05", "Ka 1 1 1", r'line 6: paint.mtl has no Kd for material "red" \(known'),
        (
            "paint.mtl",
            "0.9",
            "1.9",
            r'paint.mtl: material "red": Kd \[1.9, 0.05, 0.05\] is not three numbers in \[0, 1\]',
        ),
        (
            "quad.obj",
            "usemtl blue",
            "usemtl bleu",
            r'line 8: paint.mtl has no Kd for material "bleu" \(did you mean "blue"',
        ),
        ("quad.obj", "usemtl red\nf 1 2 3", "f 1 2 3", "the first 1 faces come before any usemtl: name a material"),
        ("quad.obj", "paint.mtl", "point.mtl", r"point.mtl: no such file \(did you mean"),
        (
            "quad.obj",
            "paint.mtl",
            "gone/x.mtl",
            "no such file: the folder .* does not exist, correct mtllib, or name a",
        ),
    ],
)
def test_what_is_missing_from_mtl_files_is_told(coloured, file, old, new, message):
    path = coloured.with_name(file)
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(jaxrt.SceneError, match=message):
        jaxrt.load_mesh(coloured)
    assert "materials" not in jaxrt.load_mesh(coloured, materials=False)


# Arrays and placing


def test_scale_then_rotate_about_x_then_y_then_z_then_translate():
    """By hand: (1, 2, 3) · 2 = (2, 4, 6); x by 90°: (2, −6, 4); y by 90°: (4, −6, −2); z by 90°: (6, 4, −2)."""
    corners = [[1, 2, 3], [0, 0, 0], [1, 0, 0]]
    mesh = arrays(corners, [[0, 1, 2]], scale=2, rotate=[90, 90, 90], translate=[10, 20, 30])
    (placed,) = parse_description(description(mesh)).meshes
    np.testing.assert_allclose(placed.world[0], [16, 24, 28], atol=1e-13)
    np.testing.assert_allclose(placed.world[1], [10, 20, 30], atol=1e-13)


def test_meshes_come_before_triangles_in_one_table():
    vertices, faces = ball(1)
    single = {"vertices": [[-9, -1, -9], [9, -1, -9], [0, -1, 9]], "material": "white"}
    both = description(arrays(vertices, faces, material="glass"), arrays(vertices + 3, faces), triangles=[single])
    scene = jaxrt.build(both)
    v, n = len(vertices), len(faces)
    assert scene.triangles.vertices.shape == (2 * v + 3, 3)
    np.testing.assert_array_equal(scene.triangles.faces[n : 2 * n], faces + v)
    np.testing.assert_array_equal(scene.triangles.faces[-1], [2 * v, 2 * v + 1, 2 * v + 2])
    np.testing.assert_array_equal(scene.triangles.material, [1] * n + [0] * (n + 1))
    told = jaxrt.parameters(scene)["meshes.vertices"]
    np.testing.assert_array_equal(told, np.concatenate([vertices, vertices + 3, single["vertices"]]).astype(np.float32))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"faces": [[0, 1, 9]]}, r"meshes\[0\].faces\[0\]\[2\]: vertex 9 does not exist: use 0 to 2"),
        ({"faces": [[0, 1, -1]]}, r"meshes\[0\].faces\[0\]\[2\]: vertex -1 does not exist: use 0 to 2"),
        ({"faces": [[0, 1]]}, r"meshes\[0\].faces: an array \(1, 2\) of int64 does not fit: write \(n, 3\) rows"),
        ({"faces": [[0, 1, 2], [0, 1]]}, r"meshes\[0\].faces: .* has rows of different lengths: write"),
        ({"faces": [[0.0, 1.0, 2.0]]}, r"meshes\[0\].faces: an array \(1, 3\) of float64 does not fit"),
        ({"faces": []}, r"meshes\[0\].faces: an array \(0,\)"),
        ({"vertices": "abc"}, r"meshes\[0\].vertices: an array \(\) of"),
        ({"vertices": None}, r'meshes\[0\]: "vertices" is missing: add vertices = '),
        ({"faces": None}, r'meshes\[0\]: "faces" is missing: add faces = '),
        ({"faces": [[0, 0, 1]]}, r"meshes\[0\].faces: no face has an area that float32 can hold"),
        (
            {"vertices": None, "file": "ball.obj"},
            r"has not been read: take load_scene, or \*\*jaxrt.load_mesh\('ball.obj'",
        ),
    ],
)
def test_unsound_arrays_are_refused(change, message):
    mesh = arrays([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]) | change
    mesh = {key: value for key, value in mesh.items() if value is not None}
    with pytest.raises(jaxrt.SceneError, match=message):
        jaxrt.build(description(mesh))


# Warnings


def test_faces_without_area_are_dropped_and_counted():
    vertices, faces = ball(1)
    vertices = np.concatenate([vertices, [[0, 0, 0], [1, 1, 1], [3, 3, 3]]])
    flat = [[0, 0, 1], [len(vertices) - 3, len(vertices) - 2, len(vertices) - 1]]
    mesh = arrays(vertices, np.concatenate([faces[:5], flat, faces[5:]]))
    (message,) = warned(mesh)
    assert message == "meshes[0]: 2 of 82 faces have no area and are dropped, first 5"
    with pytest.warns(jaxrt.SceneWarning, match="2 of 82 faces"):
        scene = jaxrt.build(description(mesh))
    np.testing.assert_array_equal(scene.triangles.faces, faces)


def test_glass_meshes_are_checked_and_others_not():
    vertices, faces = ball(1)
    vertices = np.concatenate([vertices, [[2, 2, 2]]])
    fin = np.concatenate([faces, [[faces[0, 0], faces[0, 1], len(vertices) - 1]]])
    turned = faces.copy()
    turned[0] = turned[0, ::-1]
    cases = {
        "3 edges have one face": faces[1:],
        "1 edges have three faces or more": fin,
        "at 3 edges two faces disagree on the outside": turned,
        "its faces wind clockwise seen from outside": faces[:, ::-1],
    }
    for message, changed in cases.items():
        told = warned(arrays(vertices, changed, material="glass"))
        assert any(message in line for line in told), message
        assert warned(arrays(vertices, changed)) == []
    assert warned(arrays(vertices, faces, material="glass")) == []


def test_seams_of_repeated_vertices_are_closed():
    vertices, faces = ball(1)
    soup = vertices[faces].reshape(-1, 3)
    assert warned(arrays(soup, np.arange(len(soup)).reshape(-1, 3), material="glass")) == []


def test_point_lights_with_glass_meshes():
    vertices, faces = ball(1)
    point = LIGHT | {"radius": 0}
    (message,) = warned(arrays(vertices, faces, material="glass"), lights=[point])
    assert message.startswith("lights[0] is a point light and the scene has glass")


def test_lights_and_cameras_inside_closed_meshes():
    vertices, faces = ball(1)
    inside = LIGHT | {"position": [0.1, 0.2, 0.3], "radius": 0.1}
    (message,) = warned(arrays(vertices, faces), lights=[inside])
    assert message.startswith("lights[0] is inside of meshes[0] (white) and the camera outside")
    (message,) = warned(arrays(vertices, faces, translate=[0, 0, 5]))
    assert message.startswith("lights[0] is outside of meshes[0] (white) and the camera inside")
    assert warned(arrays(vertices, faces[1:]), lights=[inside]) == []
    assert warned(arrays(vertices, faces, scale=20), lights=[inside]) == []
    dark = {"lights": [], "environment": {"radiance": [1, 1, 1]}}
    (message,) = warned(arrays(vertices, faces, translate=[0, 0, 5]), **dark)
    assert message.startswith("the camera is inside of meshes[0] without lights")


@pytest.mark.parametrize(("height", "count"), [(1e-3, 1), (1.0, 0)])
def test_point_lights_near_meshes(height, count):
    vertices, faces = ball(3)
    above = {"position": [0, float(vertices[:, 1].max()) + height, 0], "intensity": 1}
    assert len(warned(arrays(vertices, faces), lights=[above])) == count


# Facts


def test_facts_of_a_mesh_against_closed_forms():
    vertices, faces = ball(3)
    assert count_edges(vertices, faces) == (0, 0, 0)
    exact = trimesh.Trimesh(vertices, faces, process=False).volume
    assert signed_volume(vertices + 7, faces) == pytest.approx(exact, rel=1e-12)
    assert signed_volume(vertices, faces[:, ::-1]) == pytest.approx(-exact, rel=1e-12)
    np.testing.assert_array_equal(weld(np.array([[1, 0.0, 2], [3, 3, 3], [1, -0.0, 2], [3, 3, 3]])), [0, 1, 0, 1])


def test_winding_number_tells_inside_from_outside():
    """Of a cube and a sphere, and from places from which axis-parallel rays would run along edges."""
    box = trimesh.creation.box()
    corners, sides = np.array(box.vertices), np.array(box.faces)
    for place, inside in (([0, 0, 0], 1), ([0.4, 0, 0], 1), ([0.4, 0.4, 0.4], 1), ([0.6, 0, 0], 0), ([-0.6, 0, 0], 0)):
        assert winding_number(np.array(place), corners, sides) == inside
    vertices, faces = ball(3)
    rng = np.random.default_rng(0)
    for place in rng.normal(size=(500, 3)) * 0.6:
        radius = np.linalg.norm(place)
        if not 0.98 < radius < 1.001:
            assert winding_number(place, vertices, faces) == (radius < 1)
            assert winding_number(place, vertices, faces[:, ::-1]) == -int(radius < 1)


def test_distances_to_a_mesh_against_all_its_faces():
    vertices, faces = ball(3)
    places = np.random.default_rng(1).normal(size=(50, 3)) * 2
    truth = [triangle_distances(place, vertices[faces]).min() for place in places]
    found = nearest_distances(places, vertices[faces], np.full(50, np.inf))
    np.testing.assert_allclose(found, truth, rtol=1e-12)
    limits = np.median(truth) * np.ones(50)
    np.testing.assert_allclose(
        nearest_distances(places, vertices[faces], limits), np.where(truth <= limits, truth, np.inf), rtol=1e-12
    )


# Far-off scenes


@pytest.mark.usefixtures("quick_compilation")
def test_t5_a_far_off_mesh_gives_the_picture_of_the_near_one():
    """Coordinates near 1e6 are 1/16 apart in float32; the vertices are moved in float64 first.

    Places are rounded to 3 · 2⁻²⁴ = 2e-7, a millionth of a pixel. Of the 4096 samples some 500 fall into pixels with an
    edge of light or shadow, where each changes sides with a chance of 2e-6: one in a thousand runs fails for that.
    """
    vertices, faces = ball(3)
    offset = np.array([1e6, -2e6, 3e6])
    near = description(arrays(vertices, faces, rotate=[10, 20, 30]))
    far = description(
        arrays(vertices, faces, rotate=[10, 20, 30], translate=offset),
        camera=CAMERA | {"position": CAMERA["position"] + offset},
        lights=[LIGHT | {"position": LIGHT["position"] + offset}],
    )
    scenes = jaxrt.build(near), jaxrt.build(far)
    assert np.linalg.norm(np.asarray(scenes[1].origin) - offset) < 10
    one = jax.devices()[:1]
    a, b = (np.asarray(jaxrt.render(scene, 3, spp=16, max_depth=1, devices=one)) for scene in scenes)
    assert a.max() > 0.5
    np.testing.assert_allclose(a, b, atol=1e-4)


def test_a_scene_of_meshes_warns_of_nothing():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        jaxrt.build(description(arrays(*ball(2)), arrays(*ball(2), material="glass", translate=[3, 0, 0])))
