"""Mesh files of every dialect: what `tests/files/expected.toml`, written first, says becomes of each."""

import io
import itertools
import json
import os
import re
import struct
import time
import tomllib
import warnings
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

import jaxrt
from jaxrt.io import read_description
from jaxrt.io.color import srgb_decode
from jaxrt.io.files import MESH_BYTES
from jaxrt.io.meshes.polygons import Polygons, triangulate
from jaxrt.scene.checks import warnings_of

FOLDER = Path(__file__).parent / "files"
EXPECTED = tomllib.loads((FOLDER / "expected.toml").read_text())


def load(path, **options):
    """Return the mesh in a file, and what is warned of."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        mesh = jaxrt.load_mesh(path, **options)
    assert all(issubclass(warning.category, jaxrt.SceneWarning) for warning in caught)
    return mesh, [str(warning.message) for warning in caught]


def glb_parts(path):
    """Return the JSON and the bytes of a GLB file of ours."""
    data = path.read_bytes()
    size = int.from_bytes(data[12:16], "little")
    return json.loads(data[20 : 20 + size]), data[28 + size :]


def glb_of(document, binary):
    """Return a GLB file."""
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    parts = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(binary), 0x004E4942) + binary
    return b"glTF" + struct.pack("<II", 2, 12 + len(parts)) + parts


def area(mesh):
    a, b, c = (mesh["vertices"][mesh["faces"][:, i]] for i in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=-1).sum() / 2


@pytest.mark.parametrize("name", EXPECTED["files"])
def test_every_dialect_is_loaded_told_of_or_refused(name):
    expected = EXPECTED["files"][name]
    path = FOLDER / name
    if expected["outcome"] == "refuse":
        with pytest.raises(jaxrt.SceneError) as caught:
            load(path)
        text = str(caught.value)
        assert text.startswith(f"{FOLDER}/") and expected["says"] in text
        assert "\n" not in text and len(text) < 600
        return
    mesh, told = load(path)
    assert len(told) == (expected["outcome"] == "warn"), told
    assert all(text.startswith(f"{path}: ") and expected["says"] in text and "\n" not in text for text in told)
    check_shape(mesh, expected)


def check_shape(mesh, expected):
    shape = EXPECTED["shapes"][expected["shape"]] if "shape" in expected else expected
    assert len(mesh["faces"]) == shape["faces"]
    if "area" in shape:
        assert area(mesh) == pytest.approx(shape["area"], rel=1e-6)
        corners = mesh["vertices"][mesh["faces"]].reshape(-1, 3)
        np.testing.assert_allclose(corners.min(axis=0), shape["low"], atol=1e-6)
        np.testing.assert_allclose(corners.max(axis=0), shape["high"], atol=1e-6)
    albedos = [material["albedo"] for material in mesh.get("materials", {}).values()]
    assert albedos == expected.get("albedos", [])


def test_every_file_of_the_folder_is_expected():
    kinds = {".obj", ".off", ".ply", ".stl", ".glb"}
    assert {path.name for path in FOLDER.iterdir() if path.suffix in kinds} == set(EXPECTED["files"])


@pytest.mark.parametrize("name", [n for n, e in EXPECTED["files"].items() if e.get("shape") in ("box", "tetra")])
def test_faces_wind_as_in_the_file(name):
    """Closed shapes hold their volume, 6 or 1, so no face is turned or lost."""
    mesh, _ = load(FOLDER / name)
    a, b, c = (mesh["vertices"][mesh["faces"][:, i]] for i in range(3))
    volume = np.sum(a * np.cross(b, c)) / 6
    assert volume == pytest.approx(6 if EXPECTED["files"][name]["shape"] == "box" else 1, rel=1e-6)


@pytest.mark.parametrize("name", ["mirrored.glb", "mirrored_matrix.glb", "second_scene.glb"])
def test_f4_mirrored_parts_wind_the_right_way_round(name):
    mesh, _ = load(FOLDER / name)
    a, b, c = (mesh["vertices"][mesh["faces"][:, i]] - mesh["vertices"][0] for i in range(3))
    assert np.sum(a * np.cross(b, c)) / 6 == pytest.approx(1, rel=1e-6)


# A second reader

TRIMESH_READS = ["box.obj", "dart.obj", "text.ply", "little.ply", "big.ply", "doubles.ply", "text.stl", "binary.stl"]
TRIMESH_READS += ["plain.glb", "interleaved.glb", "nested.glb", "instances.glb", "second_scene.glb", "strip.glb"]


@pytest.mark.parametrize("name", TRIMESH_READS)
def test_trimesh_reads_the_same_faces(name):
    other = trimesh.load(FOLDER / name, process=False)
    parts = other.dump() if isinstance(other, trimesh.Scene) else [other]
    mesh, _ = load(FOLDER / name)
    assert sum(len(part.faces) for part in parts) == len(mesh["faces"])
    if name != "dart.obj":  # a fan there
        assert sum(part.area for part in parts) == pytest.approx(area(mesh), rel=1e-6)


# Findings


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-be", "latin-1"])
@pytest.mark.parametrize("kind", ["obj", "off", "stl", "ply"])
def test_f1_text_is_decoded_once_at_the_door(tmp_path, encoding, kind):
    """Names with letters beyond ASCII too; only the head of a PLY file, which tells text from binary, stays bytes."""
    if kind == "ply" and encoding.startswith("utf-16"):
        pytest.skip("the head of a PLY file is ASCII")
    text = (FOLDER / {"obj": "box.obj", "off": "box.off", "stl": "text.stl", "ply": "text.ply"}[kind]).read_text()
    text = text.replace("solid a", "solid Würfel").replace("by hand", "für dich")
    text = "# Würfel\n" + text if kind in ("obj", "off") else text
    mark = b"\xfe\xff" if encoding == "utf-16-be" else b""
    (tmp_path / f"mesh.{kind}").write_bytes(mark + text.encode(encoding))
    mesh, told = load(tmp_path / f"mesh.{kind}")
    assert not told and area(mesh) == pytest.approx(9 if kind == "stl" else 22)


def test_f1_no_package_is_wanted_to_read_latin_1_names():
    mesh, _ = load(FOLDER / "latin1.obj")
    assert list(mesh["materials"]) == ["latin1.obj:grün"]


@pytest.mark.parametrize("order", list(itertools.permutations(range(4))))
def test_f2_quads_in_any_order_of_their_corners_are_whole(tmp_path, order):
    """16 of the 24 orders cross; the square lies in a tilted plane."""
    frame = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0][:2]
    corners = (np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]]) @ frame)[list(order)]
    text = "".join(f"v {x} {y} {z}\n" for x, y, z in corners.tolist()) + "f 1 2 3 4\n"
    (tmp_path / "quad.obj").write_text(text)
    mesh, told = load(tmp_path / "quad.obj")
    assert area(mesh) == pytest.approx(1, rel=1e-9)
    crossed = (order[2] - order[0]) % 2 == 1
    assert [("crossed order" in line) for line in told] == [True] * crossed


def test_f2_a_curved_grid_in_z_order_has_one_side(tmp_path):
    """Quads that are not quite plane are put in order as well, and agree on which side is up."""
    x, y = np.meshgrid(np.linspace(-1, 1, 21), np.linspace(-1, 1, 21))
    places = np.stack([x, y, 0.3 * np.cos(2 * x) * np.cos(y)], -1).reshape(-1, 3)
    first = (np.arange(20)[:, None] * 21 + np.arange(20)).ravel() + 1
    text = "".join(f"v {x} {y} {z}\n" for x, y, z in places.tolist())
    quads = [np.stack([first, first + 1, first + order[0], first + order[1]], -1) for order in ((22, 21), (21, 22))]
    meshes = []
    for name, rows in zip(("right.obj", "crossed.obj"), quads, strict=True):
        (tmp_path / name).write_text(text + "".join("f {} {} {} {}\n".format(*row) for row in rows.tolist()))
        meshes.append(load(tmp_path / name))
    assert not meshes[0][1] and "400 of 400 polygons have corners in crossed order" in meshes[1][1][0]
    np.testing.assert_array_equal(meshes[0][0]["faces"], meshes[1][0]["faces"])


def test_f2_quads_in_right_order_are_left_alone():
    """2,000 random ones, convex and concave, in random planes: the area is that of the outline, and nothing is told."""
    rng = np.random.default_rng(5)
    places = rng.uniform(-1, 1, (2000, 4, 2))
    # By angle around the corners' mean the outline does not cross itself
    angle = np.arctan2(*np.moveaxis(places - places.mean(axis=1, keepdims=True), -1, 0)[::-1])
    flat = np.take_along_axis(places, np.argsort(angle, axis=1)[..., None], axis=1)
    frames = np.linalg.qr(rng.normal(size=(2000, 3, 3)))[0][:, :2]
    corners = (flat @ frames + rng.normal(size=(2000, 1, 3))).reshape(-1, 3)
    found = triangulate(corners, Polygons(np.arange(8000), np.full(2000, 4)))
    assert len(found.uncrossed) == 0 and len(found.crossed) == 0
    x, y = np.moveaxis(flat, -1, 0)
    truth = np.abs(np.sum(x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y, axis=1)) / 2
    a, b, c = (corners[found.triangles[:, i]] for i in range(3))
    areas = np.bincount(found.sources, np.linalg.norm(np.cross(b - a, c - a), axis=-1) / 2)
    np.testing.assert_allclose(areas, truth, rtol=1e-9)
    assert np.sum(found.triangles[::2, 0] % 4 != 0) > 100  # concave ones, cut along their other diagonal


def test_f3_one_crossing_polygon_of_many_is_a_fan_and_told(tmp_path):
    angle = 4 * np.pi / 5 * np.arange(5)
    star = "".join(f"v {x + 5} {y} {x}\n" for x, y in zip(np.cos(angle), np.sin(angle), strict=True))
    (tmp_path / "chair.obj").write_text((FOLDER / "box.obj").read_text() + star + "f 9 10 11 12 13\nf 9 13 12 11 10\n")
    mesh, (told,) = load(tmp_path / "chair.obj")
    assert "2 of 8 polygons have outlines that cross themselves" in told and "(first: line 20)" in told
    assert len(mesh["faces"]) == 12 + 3 + 3


@pytest.mark.parametrize("name", ["KHR_draco_mesh_compression", "EXT_meshopt_compression", "VENDOR_unknown", "x" * 999])
def test_f4_extensions_that_are_needed_and_not_read_refuse_the_file(tmp_path, name):
    document, binary = glb_parts(FOLDER / "plain.glb")
    (tmp_path / "a.glb").write_bytes(glb_of(document | {"extensionsRequired": [name]}, binary))
    with pytest.raises(jaxrt.SceneError, match=f"needs the extension .{name[:20]}.*, which is not read: save it") as e:
        load(tmp_path / "a.glb")
    assert len(str(e.value)) < 300


def test_f4_extensions_of_looks_alone_are_no_hindrance(tmp_path):
    document, binary = glb_parts(FOLDER / "plain.glb")
    names = ["KHR_materials_unlit", "KHR_texture_transform", "KHR_lights_punctual"]
    (tmp_path / "a.glb").write_bytes(glb_of(document | {"extensionsRequired": names}, binary))
    assert area(load(tmp_path / "a.glb")[0]) == pytest.approx(9)


@pytest.mark.parametrize(("kind", "code", "most"), [("b", 5120, 127), ("B", 5121, 255), ("h", 5122, 32767)])
def test_f4_normalized_whole_numbers_are_fractions(tmp_path, kind, code, most):
    document, _ = glb_parts(FOLDER / "plain.glb")
    places = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) * most
    size = struct.calcsize(kind)
    stride = 4 * -(-3 * size // 4)
    packed = b"".join(struct.pack(f"<3{kind}", *row).ljust(stride, b"\0") for row in places.tolist())
    document["accessors"][0] |= {"componentType": code, "normalized": True}
    document["bufferViews"] = [
        {"buffer": 0, "byteLength": 4 * stride, "byteStride": stride},
        {"buffer": 0, "byteOffset": 4 * stride, "byteLength": 24},
    ]
    binary = packed + glb_parts(FOLDER / "plain.glb")[1][48:]
    document["buffers"] = [{"byteLength": len(binary)}]
    (tmp_path / "a.glb").write_bytes(glb_of(document, binary))
    mesh, _ = load(tmp_path / "a.glb")
    assert mesh["vertices"].min() == 0 and mesh["vertices"].max() == 1


def test_f5_all_numbers_of_a_text_file_are_read_in_full(tmp_path):
    """Text has more digits than the float that its head speaks of, and they are not thrown away."""
    text = (FOLDER / "survey.ply").read_text().replace("500000.25", "500000.123456")
    (tmp_path / "a.ply").write_text(text)
    assert load(tmp_path / "a.ply")[0]["vertices"][0, 0] == 500000.123456


@pytest.mark.parametrize(("name", "counts"), [("text.ply", "element face 6"), ("text.ply", "element vertex 8")])
@pytest.mark.parametrize("change", [-1, 1, 10**12])
def test_f5_announced_counts_are_compared(tmp_path, name, counts, change):
    words = counts.split()
    text = (FOLDER / name).read_text().replace(counts, f"{words[0]} {words[1]} {int(words[2]) + change}")
    (tmp_path / name).write_text(text)
    with pytest.raises(jaxrt.SceneError, match="announce|not as many numbers"):
        load(tmp_path / name)


@pytest.mark.parametrize("name", ["box.off", "normals.off", "textured.off", "homogeneous.off"])
def test_f6_line_ends_mean_nothing_in_a_stream(name, tmp_path):
    """The same words, so many on a line, are the same mesh or are refused: never another one."""
    words = (FOLDER / name).read_text().split()
    read = []
    for width in range(1, 81):
        lines = [" ".join(words[i : i + width]) for i in range(0, len(words), width)]
        (tmp_path / "a.off").write_text("\n".join(lines))
        try:
            mesh, told = load(tmp_path / "a.off")
        except jaxrt.SceneError:
            continue
        assert not told and area(mesh) == pytest.approx(22)
        read.append(width)
    assert set(range(8, 81)) <= set(read)


def test_f7_errors_of_materials_name_the_way_out_in_python(tmp_path):
    for name in ("case.obj", "only_map.obj", "windows_library.obj"):
        with pytest.raises(jaxrt.SceneError, match=r"name a material in the scene file \(in Python: materials=False\)"):
            load(FOLDER / name)
        mesh, told = load(FOLDER / name, materials=False)
        assert not told and "materials" not in mesh


def test_f7_all_that_is_left_out_is_one_warning_of_one_line(tmp_path):
    text = (FOLDER / "vertex_colours.obj").read_text().replace("f 1 3 4 2", "usemtl glass\nf 1 4 3 2")
    (tmp_path / "a.obj").write_text("mtllib glass.mtl\n" + text + "l 1 2\n")
    (tmp_path / "glass.mtl").write_text((FOLDER / "glass.mtl").read_text())
    mesh, (told,) = load(tmp_path / "a.obj")
    assert "colors" in mesh
    for part in ("crossed order", "edges and points", "only Kd and map_Kd are read"):
        assert part in told
    assert "\n" not in told


def test_f7_the_command_line_and_build_tell_it_once(tmp_path):
    scene = {"camera": {"position": [0, 0, 9]}, "environment": {"radiance": [1, 1, 1]}}
    scene["materials"] = {"white": {"type": "diffuse", "albedo": [0.8, 0.8, 0.8]}}
    text = "[camera]\nposition = [0, 0, 9]\n[environment]\nradiance = [1, 1, 1]\n[materials.white]\ntype = 'diffuse'\n"
    text += f"albedo = [0.8, 0.8, 0.8]\n[[meshes]]\nfile = '{FOLDER / 'weights.obj'}'\nmaterial = 'white'\n"
    (tmp_path / "scene.toml").write_text(text)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        description = read_description(tmp_path / "scene.toml", allow_folders=[FOLDER])
    (line,) = warnings_of(description)
    assert line == f"meshes[0] ({FOLDER / 'weights.obj'}): weights of vertices are not read"
    with pytest.warns(jaxrt.SceneWarning) as caught:
        jaxrt.load_scene(tmp_path / "scene.toml", allow_folders=[FOLDER])
    assert [str(warning.message) for warning in caught] == [line]
    # Told by load_mesh, it is not told again by build
    mesh, told = load(FOLDER / "weights.obj")
    assert told and "notes" not in mesh
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        jaxrt.build(scene | {"meshes": [mesh | {"material": "white"}]})


def test_f8_binary_stl_is_told_by_its_size(tmp_path):
    data = (FOLDER / "binary.stl").read_bytes()
    for head in (b"solid", b"solid facet normal outer loop vertex 0 0 0", b"\xff" * 80, b"SOLID x endsolid"):
        (tmp_path / "a.stl").write_bytes(head.ljust(80)[:80] + data[80:])
        assert area(load(tmp_path / "a.stl")[0]) == pytest.approx(9)


# Files that other files name


@pytest.fixture
def apart(tmp_path):
    """Return an OBJ file whose library lies in a folder beside its own."""
    (tmp_path / "mesh").mkdir()
    (tmp_path / "paint").mkdir()
    (tmp_path / "paint" / "red.mtl").write_text("newmtl red\nKd 0.8 0.1 0.1\n")
    text = (FOLDER / "box.obj").read_text().replace("f 1", "usemtl red\nf 1", 1)
    (tmp_path / "mesh" / "box.obj").write_text("mtllib ../paint/red.mtl\n" + text)
    return tmp_path / "mesh" / "box.obj"


def test_l6_a_library_outside_of_the_folder_is_opened_only_where_allowed(apart, tmp_path):
    with pytest.raises(jaxrt.SceneError, match=r"line 1: .* lies outside of the file's folder: .* --allow-folder "):
        load(apart)
    for folder in (tmp_path / "paint", tmp_path, str(tmp_path)):
        mesh, _ = load(apart, allow_folders=[folder])
        assert list(mesh["materials"]) == ["box.obj:red"]
    assert "materials" not in load(apart, materials=False)[0]


def test_l6_links_are_resolved(apart, tmp_path):
    (apart.parent / "link.mtl").symlink_to(tmp_path / "paint" / "red.mtl")
    apart.write_text(apart.read_text().replace("../paint/red.mtl", "link.mtl"))
    with pytest.raises(jaxrt.SceneError, match="lies outside of the file's folder"):
        load(apart)
    assert load(apart, allow_folders=[tmp_path / "paint"])[0]["materials"]
    # Within the folder, links are as good as files
    (apart.parent / "near.mtl").write_text("newmtl red\nKd 0.8 0.1 0.1\n")
    (apart.parent / "link.mtl").unlink()
    (apart.parent / "link.mtl").symlink_to(apart.parent / "near.mtl")
    assert load(apart)[0]["materials"]


@pytest.mark.parametrize("name", ["/etc/shadow", "/dev/zero", "../../../../etc/passwd", "a\0b", "x" * 5000, "loop.mtl"])
def test_l6_names_that_lead_nowhere_good_are_refused_at_once(apart, name):
    (apart.parent / "loop.mtl").symlink_to(apart.parent / "loop.mtl")
    apart.write_text(apart.read_text().replace("../paint/red.mtl", name))
    with pytest.raises(jaxrt.SceneError) as caught:
        load(apart)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 800


@pytest.mark.parametrize("kind", ["obj", "off", "ply", "stl", "glb", "mtl"])
def test_l6_pipes_and_devices_are_refused_at_once(apart, kind, tmp_path):
    os.mkfifo(apart.parent / f"pipe.{kind}")
    path = apart.parent / f"pipe.{kind}"
    if kind == "mtl":
        apart.write_text(apart.read_text().replace("../paint/red.mtl", "pipe.mtl"))
        path = apart
    with pytest.raises(jaxrt.SceneError, match="is a pipe or a device, no regular file"):
        load(path)
    (tmp_path / f"zero.{kind}").symlink_to("/dev/zero")
    if kind != "mtl":
        with pytest.raises(jaxrt.SceneError, match="is a pipe or a device, no regular file"):
            load(tmp_path / f"zero.{kind}")


def test_l6_the_size_of_a_file_is_bounded(tmp_path):
    with open(tmp_path / "large.obj", "wb") as file:
        file.truncate(MESH_BYTES + 1)
    with pytest.raises(jaxrt.SceneError, match="large.obj: has .*: make it smaller"):
        load(tmp_path / "large.obj")


# Slow input: the guards are 30 times what is expected


def spiral(corners):
    """Return the outline (k, 3) of a band that winds four times."""
    turn = np.linspace(0, 8 * np.pi, corners // 2)
    flat = [(1 + turn + width)[:, None] * np.stack([np.cos(turn), np.sin(turn)], -1) for width in (0, 0.8)]
    outline = np.concatenate([flat[0], flat[1][::-1]])
    return np.concatenate([outline, np.zeros((len(outline), 1))], -1)


@pytest.mark.parametrize("shape", ["spiral", "star", "comb"])
def test_l8_polygons_of_a_thousand_corners(tmp_path, shape):
    rng = np.random.default_rng(1)
    angle = np.sort(rng.uniform(0, 2 * np.pi, 1000))
    star = np.stack([np.cos(angle), np.sin(angle), 0 * angle], -1) * rng.uniform(0.1, 1, (1000, 1))
    teeth = np.arange(500)
    lower, upper = (np.stack([teeth, 5 * (teeth % 2) + up, 0 * teeth], -1) for up in (0, 0.5))
    outline = {"spiral": spiral(1000), "star": star, "comb": np.concatenate([lower, upper[::-1]])}[shape]
    x, y, _ = outline.T
    truth = abs(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) / 2
    text = "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in outline.tolist())
    (tmp_path / "a.obj").write_text(text + f"f {' '.join(map(str, range(1, 1001)))}\n")
    start = time.perf_counter()
    mesh, told = load(tmp_path / "a.obj")
    assert time.perf_counter() - start < 6
    assert not told and len(mesh["faces"]) == 998 and area(mesh) == pytest.approx(truth, rel=1e-9)


@pytest.mark.parametrize("kind", ["lines", "stream"])
def test_l8_an_off_file_of_many_faces(tmp_path, kind):
    count = 100
    x, y = np.meshgrid(np.arange(count + 1), np.arange(count + 1))
    first = (np.arange(count)[:, None] * (count + 1) + np.arange(count)).ravel()
    up = count + 1
    faces = np.concatenate(
        [np.stack([first, first + 1, first + up], -1), np.stack([first + 1, first + up + 1, first + up], -1)]
    )
    text = f"OFF\n{x.size} {len(faces)} 0\n" + "".join(
        f"{a} {b} 0\n" for a, b in zip(x.ravel(), y.ravel(), strict=True)
    )
    text += "".join("3 {} {} {}\n".format(*row) for row in faces.tolist())
    (tmp_path / "a.off").write_text(text if kind == "lines" else text.replace("\n", " "))
    start = time.perf_counter()
    mesh, _ = load(tmp_path / "a.off")
    assert time.perf_counter() - start < 5
    np.testing.assert_array_equal(mesh["faces"], faces)


def test_f8_no_facet_of_a_text_file_is_lost_without_a_word(tmp_path):
    """Each word in turn is spelt wrongly, in the plainest file and in one line of it."""
    text = (FOLDER / "text.stl").read_text()
    for whole in (text, text.replace("\n", " "), text + "solid b\nfacet normal 0 0 0\n outer loop\n  vertex 0 0 0\n"):
        words = re.split(r"(\s+)", whole)
        for i in range(0, len(words) - 1, 2):
            (tmp_path / "a.stl").write_text("".join([*words[:i], "x" + words[i], *words[i + 1 :]]))
            try:
                mesh, told = load(tmp_path / "a.stl")
            except jaxrt.SceneError:
                continue
            assert told or len(mesh["faces"]) == 4


# Base colours of GLB files


def painted_glb(path, materials, colors=False, **document):
    """Write a tetrahedron of two primitives, with places on a picture of 3x2 texels, and return that, linear."""
    levels = np.random.default_rng(0).integers(0, 256, (2, 3, 3), dtype=np.uint8)
    with io.BytesIO() as file:
        Image.fromarray(levels).save(file, "png")
        picture = file.getvalue()
    plain, binary = glb_parts(FOLDER / "plain.glb")
    uv = np.array([[0, 0], [1, 0], [0, 1], [1, 1]], "<f4").tobytes()
    rows = np.array([[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [51, 51, 51, 255]], np.uint8).tobytes()
    parts, views = [binary, uv, rows, picture], list(plain["bufferViews"])
    for i in (1, 2, 3):
        views.append({"buffer": 0, "byteOffset": sum(map(len, parts[:i])), "byteLength": len(parts[i])})
    n = len(plain["bufferViews"])
    accessors = [
        *plain["accessors"],
        {"bufferView": n, "componentType": 5126, "count": 4, "type": "VEC2"},
        {"bufferView": n + 1, "componentType": 5121, "normalized": True, "count": 4, "type": "VEC4"},
    ]
    attributes = {"POSITION": 0, "TEXCOORD_0": 2} | ({"COLOR_0": 3} if colors else {})
    primitives = [{"attributes": attributes, "indices": 1, "material": i} for i in range(len(materials))]
    made = plain | {
        "buffers": [{"byteLength": sum(map(len, parts))}],
        "bufferViews": views,
        "accessors": accessors,
        "meshes": [{"primitives": primitives}],
        "materials": materials,
        "textures": [{"source": 0, "sampler": 0}],
        "images": [{"bufferView": n + 2, "mimeType": "image/png", "name": "wood grain"}],
        "samplers": [{"wrapS": 33071, "wrapT": 33071}],
    }
    path.write_bytes(glb_of(made | document, b"".join(parts)))
    return srgb_decode(levels / 255)


MATT = {"metallicFactor": 0}
WOOD = {"name": "wood", "pbrMetallicRoughness": MATT | {"baseColorTexture": {"index": 0}}}


def test_base_colours_of_a_glb_file_become_diffuse_materials(tmp_path):
    plain = {"name": "wood", "pbrMetallicRoughness": MATT | {"baseColorFactor": [0.5, 0.25, 1, 1]}}
    linear = painted_glb(tmp_path / "a.glb", [WOOD, plain, {}])
    mesh, (told,) = load(tmp_path / "a.glb")
    assert told.endswith("not read but for base colours: metal and roughness are left out")
    assert mesh["materials"] == {
        "a.glb:wood": {"type": "diffuse", "albedo": {"texture": "a_wood_grain", "factor": [1, 1, 1]}},
        "a.glb:wood1": {"type": "diffuse", "albedo": [0.5, 0.25, 1]},
        "a.glb:material2": {"type": "diffuse", "albedo": [1, 1, 1]},
    }
    np.testing.assert_array_equal(mesh["face_materials"], np.repeat([0, 1, 2], 4))
    np.testing.assert_allclose(mesh["textures"]["a_wood_grain"]["texels"], linear, atol=1e-6)
    assert mesh["textures"]["a_wood_grain"]["wrap"] == "clamp"
    camera = {"position": [0, 0, 9], "width": 8, "height": 8}
    first = mesh | {key: mesh[key][:4] for key in ("faces", "face_materials")}
    built = jaxrt.build({"camera": camera, "meshes": [first], "environment": {"radiance": [1, 1, 1]}})
    np.testing.assert_allclose(jaxrt.parameters(built)["textures.a_wood_grain"], linear, atol=1e-6)
    bare, none = load(tmp_path / "a.glb", materials=False)
    assert not none and not {"materials", "textures", "face_materials"} & bare.keys()


def test_materials_of_a_glb_file_are_principled_where_asked_for(tmp_path):
    """By default of metal as rough as can be; the picture's blue is metal, its green roughness, both linear."""
    picture = {"baseColorTexture": {"index": 0}, "metallicRoughnessTexture": {"index": 0}}
    smooth = {"metallicFactor": 0, "roughnessFactor": 0.01, "metallicRoughnessTexture": {"index": 0}}
    looks = [{"pbrMetallicRoughness": picture | {"roughnessFactor": 0.5}}, {"pbrMetallicRoughness": smooth}, {}]
    linear = painted_glb(tmp_path / "a.glb", looks)
    mesh, (told,) = load(tmp_path / "a.glb", materials="principled")
    assert told.endswith("a.glb: roughness below 0.05 is taken as 0.05")
    white, rough = {"type": "principled", "albedo": [1, 1, 1]}, "a_wood_grain_roughness"
    colour = {"albedo": {"texture": "a_wood_grain", "factor": [1, 1, 1]}}
    assert list(mesh["materials"].values()) == [
        white
        | colour
        | {
            "metallic": {"texture": "a_wood_grain_metallic", "factor": 1},
            "roughness": {"texture": rough, "factor": 0.5},
        },
        white | {"metallic": 0, "roughness": {"texture": rough, "factor": 0.05}},
        white | {"metallic": 1, "roughness": 1},
    ]
    for field, channel in (("metallic", 2), ("roughness", 1)):
        shares = srgb_decode(mesh["textures"][f"a_wood_grain_{field}"]["texels"])
        np.testing.assert_allclose(shares, linear[..., channel], atol=1e-6)
    painted_glb(tmp_path / "a.glb", looks[:1])
    scene = "camera = {position = [0, 0, 9], width = 8, height = 8}\nenvironment = {radiance = [1, 1, 1]}\n[[meshes]]\n"
    (tmp_path / "a.toml").write_text(scene + 'file = "a.glb"\nmaterials = "principled"\n')
    found = jaxrt.parameters(jaxrt.load_scene(tmp_path / "a.toml"))
    assert (found["materials.metallic"], found["materials.roughness"]) == (1, 0.5)
    np.testing.assert_allclose(
        found["textures.a_wood_grain_metallic"][..., 0], mesh["textures"]["a_wood_grain_metallic"]["texels"]
    )


@pytest.mark.parametrize(
    ("file", "more", "says"),
    [
        ("a.glb", 'materials = "shiny"', 'a.glb: materials: "shiny" is unknown'),
        ("a.glb", 'materials = "principled"\nmaterial = "a"', '"material" and "materials" exclude each other: leave'),
        ("a.ply", 'materials = "principled"', 'only those of GLB files can be "principled": leave it out'),
    ],
)
def test_types_of_materials_that_cannot_be_are_told(tmp_path, file, more, says):
    painted_glb(tmp_path / "a.glb", [{}])
    (tmp_path / "a.ply").write_text("ply")
    (tmp_path / "a.toml").write_text(f'[[meshes]]\nfile = "{file}"\n{more}\n')
    with pytest.raises(jaxrt.SceneError, match=says):
        jaxrt.load_scene(tmp_path / "a.toml")


def test_base_colours_are_multiplied_by_colours_at_vertices(tmp_path):
    material = {"pbrMetallicRoughness": MATT | {"baseColorFactor": [0.5, 0.25, 1, 1]}}
    painted_glb(tmp_path / "a.glb", [material], colors=True)
    mesh, told = load(tmp_path / "a.glb")
    assert not told and mesh["textures"] == {"a_colors": {"type": "vertex_colors"}}
    assert mesh["materials"]["a.glb:material0"]["albedo"] == {"texture": "a_colors", "factor": [0.5, 0.25, 1]}
    np.testing.assert_allclose(mesh["colors"][3], 0.2)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"textures": []}, r"left out \(textures\[0\] does not exist"),
        ({"textures": [{"extensions": {"EXT_texture_webp": {"source": 0}}}]}, "neither PNG nor JPG"),
        ({"images": [{"uri": "../../lost.png"}]}, r"left out \(.*lies outside of the file's folder"),
        ({"images": [{"uri": "data:image/png;base64,iVBORw0KGgo="}]}, r"left out \(.*cannot be read as .png"),
        ({"images": [{"bufferView": 0}]}, "is neither PNG nor JPG"),
        ({"samplers": [{"wrapS": 33648}]}, "mirrored, or repeated one way, are repeated"),
    ],
)
def test_pictures_of_a_glb_file_that_are_not_read_are_told(tmp_path, change, says):
    painted_glb(tmp_path / "a.glb", [WOOD], **change)
    mesh, (told,) = load(tmp_path / "a.glb")
    assert re.search(says, told) and len(mesh["faces"]) == 4 and len(told) < 400


@pytest.mark.parametrize("number", [7, -1, "wood", [0], True])
def test_a_material_that_a_glb_file_lacks_is_told(tmp_path, number):
    document, binary = glb_parts(FOLDER / "plain.glb")
    document["meshes"][0]["primitives"][0]["material"] = number
    (tmp_path / "a.glb").write_bytes(glb_of(document, binary))
    with pytest.raises(jaxrt.SceneError, match=r"materials\[.*\] does not exist: save it again"):
        load(tmp_path / "a.glb")
