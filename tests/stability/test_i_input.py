"""Bad and unusual mesh files: read rightly, or refused in one line with file, place and remedy (I1 to I7, T6)."""

import numpy as np
import pytest
import trimesh

import jaxrt
from jaxrt.io.meshes.ears import clip_ears

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
DART = [[0, 0, 0], [2, 0, 0], [2, 2, 0], [1, 0.3, 0], [0, 2, 0]]  # concave: area 2.3, that of its fan 3.7
DART_AREA = 2.3


@pytest.fixture
def load(tmp_path):
    """Return a function that writes a file and loads it."""

    def write_and_load(content, name="mesh.obj"):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return jaxrt.load_mesh(path)

    return write_and_load


@pytest.fixture
def refusal(load, tmp_path):
    """Return a function that loads a bad file and returns what is said of it."""

    def refused(content, name="mesh.obj"):
        with pytest.raises(jaxrt.SceneError) as caught:
            load(content, name)
        text = str(caught.value)
        assert text.startswith(f"{tmp_path / name}: ") and "\n" not in text
        return text.removeprefix(f"{tmp_path / name}: ")

    return refused


def area(mesh):
    a, b, c = (mesh["vertices"][mesh["faces"][:, i]] for i in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=-1).sum() / 2


def dart(kind, start=0):
    """Return the dart as a file, its polygon beginning at corner `start`."""
    order = [(start + i) % 5 for i in range(5)]
    rows = "".join("{} {} {}\n".format(*place) for place in DART)
    if kind == "obj":
        return "".join(f"v {row}\n" for row in rows.splitlines()) + f"f {' '.join(str(i + 1) for i in order)}\n"
    polygon = f"5 {' '.join(map(str, order))}\n"
    if kind == "off":
        return f"OFF\n5 1 0\n{rows}{polygon}"
    head = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n"
    return f"{head}element face 1\nproperty list uchar int vertex_indices\nend_header\n{rows}{polygon}"


@pytest.mark.parametrize("kind", ["obj", "off", "ply"])
@pytest.mark.parametrize("start", range(5))
def test_i1a_concave_polygons_keep_their_area(figures, load, kind, start):
    """A fan has 3.7 instead of 2.3 from four of the five corners."""
    mesh = load(dart(kind, start), f"dart.{kind}")
    assert mesh["faces"].shape == (3, 3)
    order = [(start + i) % 5 for i in range(5)]
    fan = area({"vertices": np.array(DART), "faces": np.array([[order[0], *order[i : i + 2]] for i in (1, 2, 3)])})
    bad, error = (abs(x / DART_AREA - 1) for x in (fan, area(mesh)))
    bad = bad if start != 3 else None
    figures(
        "I1a",
        "error of a concave polygon's area, in OBJ, OFF and PLY; naive: a fan",
        naive=bad,
        ours=error,
        at_most=1e-6,
    )


def test_i1a_a_ply_of_mixed_polygons_is_cut_anew(load):
    text = dart("ply").replace("element face 1", "element face 2") + "3 0 1 2\n"
    mesh = load(text, "two.ply")
    np.testing.assert_array_equal(mesh["faces"][-1], [0, 1, 2])
    assert area(mesh) == pytest.approx(DART_AREA + 2, rel=1e-6)


@pytest.mark.parametrize("seed", range(20))
def test_i1a_random_star_polygons_are_filled(figures, seed):
    """Area by the shoelace formula; 30 corners of random radii, in a random plane, any winding."""
    rng = np.random.default_rng(seed)
    n = 30
    angle = np.sort(rng.uniform(0, 2 * np.pi, n))
    flat = np.stack([np.cos(angle), np.sin(angle)], -1) * rng.uniform(0.1, 1, (n, 1))
    x, y = flat.T
    truth = abs(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) / 2
    frame = np.linalg.qr(rng.normal(size=(3, 3)))[0][:2]
    corners = (flat[::-1] if seed % 2 else flat) @ frame + rng.normal(size=3)
    triangles = clip_ears(corners)
    assert triangles.shape == (n - 2, 3)
    fan = np.stack([np.zeros(n - 2, int), np.arange(1, n - 1), np.arange(2, n)], -1)
    bad, error = (abs(area({"vertices": corners, "faces": faces}) / truth - 1) for faces in (fan, triangles))
    # Some corners see the whole star
    bad = bad if bad > 1e-3 else None
    figures("I1a", "error of the area of stars of 30 corners; naive: a fan", naive=bad, ours=error, at_most=1e-10)


BOW = "0 0 0\n3 1 0\n3 0 0\n0 2 0\n"  # crosses itself; in order its area is 4.5


@pytest.mark.parametrize("kind", ["obj", "off", "ply"])
def test_i1a_a_quad_that_crosses_itself_is_put_in_order_and_told(load, kind):
    head = dart("ply").split("end_header")[0].replace("vertex 5", "vertex 4")
    content, place = {
        "obj": ("".join(f"v {row}\n" for row in BOW.splitlines()) + "\nf 1 2 3 4\n", "line 6"),
        "off": (f"OFF\n4 1 0\n{BOW}4 0 1 2 3\n", "line 7"),
        "ply": (f"{head}end_header\n{BOW}4 0 1 2 3\n", "face 0"),
    }[kind]
    with pytest.warns(jaxrt.SceneWarning, match=rf"1 of 1 polygons .* crossed order, .* \(first: {place}\)"):
        mesh = load(content, f"bow.{kind}")
    assert area(mesh) == pytest.approx(4.5, rel=1e-12)


def test_i1a_a_polygon_of_more_corners_that_crosses_itself_is_a_fan_and_told(load):
    angles = 4 * np.pi / 5 * np.arange(5)
    star = "".join(f"v {x} {y} 0\n" for x, y in zip(np.cos(angles), np.sin(angles), strict=True)) + "f 1 2 3 4 5\n"
    with pytest.warns(jaxrt.SceneWarning, match=r"1 of 1 polygons .* cross themselves, .* \(first: line 6\)"):
        assert load(star)["faces"].tolist() == [[0, 1, 2], [0, 2, 3], [0, 3, 4]]


def test_i1a_a_bent_quad_is_no_crossing(load):
    """A saddle has no plane, but both its fans are right."""
    mesh = load("v 0 0 0\nv 1 0 1\nv 1 1 0\nv 0 1 1\nf 1 2 3 4\n")
    assert mesh["faces"].shape == (2, 3)


def test_i1b_index_zero_is_refused(figures, refusal):
    assert refusal(SQUARE + "# a face\nf 0 1 2\n") == "line 6: vertex 0 does not exist: count from 1"
    read = np.arange(4)[np.array([0, 1, 2]) - 1]
    bad = int(read[0] == 3)
    figures("I1b", "faces taken that name vertex 0; naive: v[i − 1], the last vertex", naive=bad, ours=0, at_most=0)


def test_i1b_mixed_corners_in_one_face_are_read(figures, load):
    with pytest.warns(jaxrt.SceneWarning, match="4 of 6 corners have no place on a texture"):
        mesh = load(SQUARE + "vt 0 0\nvn 0 0 1\nf 1/1 2 3//1\nf 1/1/1 3 4\n")
    wrong = np.sum(mesh["faces"] != [[0, 1, 2], [0, 2, 3]])
    figures("I1b", "corners misread of faces that mix v, v/vt and v//vn", ours=wrong, at_most=0)


def test_i1c_negative_indices_count_from_their_own_line(figures, load):
    """Resolved at the end of the file, both faces have its last vertices."""
    mesh = load("v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 5 0 0\nv 6 0 0\nv 5 1 0\nf -3 -2 -1\nf 1 -2 3\n")
    np.testing.assert_array_equal(mesh["faces"][2], [0, 4, 2])
    want, at_end = np.array([[0, 1, 2], [3, 4, 5]]), np.arange(6)[np.array([[-3, -2, -1]] * 2)]
    bad, wrong = np.sum(at_end != want), np.sum(mesh["faces"][:2] != want)
    figures(
        "I1c",
        "corners misread of negative indices; naive: counted from the file's end",
        naive=bad,
        ours=wrong,
        at_most=0,
    )


def test_i1c_negative_indices_before_the_first_vertex_are_refused(refusal):
    text = refusal("v 0 0 0\nv 1 0 0\nf -3 -2 -1\nv 0 1 0\n")
    assert text == "line 3: vertex -3 does not exist: only 2 come before this line"


@pytest.mark.parametrize("content", ["", "# nothing\n", SQUARE, "l 1 2\n"])
def test_i2_no_faces(figures, refusal, content):
    assert refusal(content) == "no faces: save the mesh with its faces"
    bad = int(not [line for line in content.splitlines() if line.startswith("f ")])
    figures("I2", "files without faces taken; naive: a mesh of 0 faces", naive=bad, ours=0, at_most=0)


def test_i2_faces_without_vertices_and_faces_of_two(refusal):
    assert refusal("f 1 2 3\n") == "line 1: vertex 3 does not exist: the file has no vertices"
    assert refusal(SQUARE + "f 1 2\n") == "line 5: a face of 2 vertices: name 3 or more"


@pytest.mark.parametrize("kind", ["ply", "stl", "glb", "off"])
@pytest.mark.parametrize("content", [b"", b"rubbish \xff\x00"])
def test_i2_empty_and_broken_files_of_other_kinds(refusal, kind, content):
    text = refusal(content, f"mesh.{kind}")
    assert ": " in text and text.split(": ")[-1] in {
        "save it again",
        "save the mesh with its faces",
        "check that this is an OFF file",
    }


@pytest.mark.parametrize("kind", ["ply", "stl", "glb", "off"])
def test_i2_truncated_files(refusal, kind):
    whole = trimesh.creation.box().export(file_type=kind)
    whole = whole.encode() if isinstance(whole, str) else whole
    assert refusal(whole[: len(whole) * 2 // 3], f"half.{kind}").endswith("save it again")


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "1e999"])
def test_i3_t6_vertices_that_are_no_numbers(figures, refusal, value):
    text = refusal(f"v 0 0 0\nv 1 0 0\nv 0 {value} 0\nf 1 2 3\n")
    assert text.startswith("line 3: vertex 3: ") and text.endswith("is not finite: repair the mesh")
    text = refusal(f"OFF\n3 1 0\n0 0 0\n1 0 0\n0 {value} 0\n3 0 1 2\n", "mesh.off")
    assert text.startswith("line 5: ") and "finite" in text
    ply = dart("ply").replace("1 0.3 0", f"1 {value} 0").replace("5 0 1 2 3 4", "3 0 1 2")
    text = refusal(ply, "mesh.ply")
    assert text.startswith("vertex 3: ") and text.endswith("is not finite: repair the mesh")
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, float(value), 0]])
    with np.errstate(invalid="ignore"):
        size = area({"vertices": corners, "faces": np.array([[0, 1, 2]])})
        # A box of a NaN is missed by every ray, and all that is in it
        box = np.minimum(corners, 1).min(0) <= 0.5
    figures(
        "I3",
        "files taken with a vertex that is no number; naive: their area is none",
        naive=int(not np.isfinite(size)),
        ours=0,
        at_most=0,
    )
    bad = int(not box.all()) if value == "nan" else None
    figures("T6", "boxes lost by a vertex that is no number", naive=bad, ours=0, at_most=0)


def test_i3_t6_arrays_with_a_nan_are_refused():
    vertices = np.eye(3)
    vertices[1, 2] = np.nan
    with pytest.raises(
        jaxrt.SceneError, match=r"^scene: meshes\[0\]\.vertices\[1\]: .* is not finite: repair the mesh$"
    ):
        jaxrt.build(scene_of({"vertices": vertices, "faces": [[0, 1, 2]], "material": "white"}))


def scene_of(mesh):
    return {
        "camera": {"position": [0, 0, 5], "width": 8, "height": 8},
        "materials": {"white": {"type": "diffuse", "albedo": [0.8, 0.8, 0.8]}},
        "meshes": [mesh],
        "lights": [{"position": [0, 4, 5], "intensity": 9}],
    }


def test_i4_tiny_meshes_keep_their_vertices(figures, load):
    ball = trimesh.creation.icosphere(1)
    text = "".join(f"v {x * 1e-9!r} {y * 1e-9!r} {z * 1e-9!r}\n" for x, y, z in ball.vertices.tolist())
    mesh = load(text + "".join(f"f {a} {b} {c}\n" for a, b, c in (ball.faces + 1).tolist()))
    np.testing.assert_allclose(mesh["vertices"], np.asarray(ball.vertices) * 1e-9, rtol=1e-12)
    merged, kept = (len(np.unique(v, axis=0)) for v in (np.round(mesh["vertices"], 8), mesh["vertices"]))
    figures(
        "I4",
        "vertices of a mesh of size 1e-9; naive: merged to 8 decimals",
        naive=merged,
        ours=kept,
        at_least=len(ball.vertices),
    )
    scene = jaxrt.build(scene_of(mesh | {"material": "white", "scale": 1e9}))
    assert scene.triangles.faces.shape == ball.faces.shape
    assert jaxrt.build(scene_of(mesh | {"material": "white"})).triangles.faces.shape == ball.faces.shape


def test_i5_coordinates_beyond_float32(figures, refusal, load):
    far = SQUARE.replace("1 1 0", "1 1e39 0") + "f 1 2 3\n"
    assert refusal(far).startswith("line 3: vertex 3: ") and "too large for float32" in refusal(far)
    with np.errstate(over="ignore"):
        bad = int(np.isinf(np.float64(1e39).astype(np.float32)))
    figures("I5", "coordinates of 1e39 taken; naive: infinite in float32", naive=bad, ours=0, at_most=0)
    mesh = load(SQUARE + "f 1 2 3\n")
    with pytest.raises(jaxrt.SceneError, match=r"meshes\[0\]\.vertices\[1\]: .* too far out for float32: stay within"):
        jaxrt.build(scene_of(mesh | {"material": "white", "scale": 1e20}))
    with pytest.raises(jaxrt.SceneError, match=r"meshes\[0\]\.faces: no face has an area .*: scale it up"):
        jaxrt.build(scene_of(mesh | {"material": "white", "scale": 1e-12}))


def test_i6_indices_out_of_range(refusal):
    assert refusal(SQUARE + "f 1 2 9\n") == "line 5: vertex 9 does not exist: use 1 to 4"
    assert refusal("OFF\n3 1 0\n0 0 0\n1 0 0\n1 1 0\n3 0 1 7\n", "a.off").startswith("line 6: vertex 7 does not exist")
    triangle = dart("ply").replace("5 0 1 2 3 4", "3 0 1 {}")
    assert refusal(triangle.format(77), "a.ply") == "face 0: vertex 77 does not exist: use 0 to 4"
    assert refusal(triangle.format(-2), "a.ply") == "face 0: vertex -2 does not exist: use 0 to 4"
    assert "vertex 9 does not exist" in refusal(dart("ply").replace("5 0 1 2 3 4", "5 0 1 2 3 9"), "b.ply")


def test_i6_tabs_indents_and_comments_are_read(figures, load):
    text = "  v 0 0 0 # corner\n\tv\t1 0 0\nv  0 1 0\n f\t1 2  3 # face\n"
    mesh = load(text)
    np.testing.assert_array_equal(mesh["vertices"], [[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    lost = 4 - len(mesh["vertices"]) - len(mesh["faces"])
    skipped = sum(not line.startswith(("v ", "f ")) for line in text.splitlines())
    figures(
        "I6",
        "lines lost that hold tabs, indents and comments; naive: begin with v or f",
        naive=skipped,
        ours=lost,
        at_most=0,
    )
    np.testing.assert_array_equal(mesh["faces"], [[0, 1, 2]])


def test_i6_bad_tokens(refusal):
    comma = refusal("v 0,5 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert comma == 'line 1: vertex 1: "0,5 0 0" is not a place: write decimals with a point'
    assert refusal("v 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n") == 'line 1: vertex 1: "0 0" is not a place: write v x y z'
    assert refusal(SQUARE + "f 1 b 3\n").startswith('line 5: "b" does not name a vertex: write its number')
    assert refusal("OFF\n3 1 0\n0 0 0\n1 x 0\n1 1 0\n3 0 1 2\n", "a.off").startswith('line 4: "1 x 0" is not')


def test_i7_what_loads_as_expected(figures, load):
    quad = load(SQUARE + "f 1 2 3 4\n")
    assert quad["faces"].shape == (2, 3) and area(quad) == pytest.approx(1)
    twice = load(SQUARE + "f 1 2 3\nf 1 2 3\n")
    np.testing.assert_array_equal(twice["faces"], [[0, 1, 2]] * 2)
    np.testing.assert_array_equal(load(SQUARE + "vn 0 0 1\nf 1//1 2//1 3//1\n")["faces"], [[0, 1, 2]])
    colours = load("v 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 0 1 0 1 0 0\nf 1 2 3\n")
    np.testing.assert_array_equal(colours["vertices"], [[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    np.testing.assert_array_equal(colours["colors"], [[1, 0, 0]] * 3)
    np.testing.assert_array_equal(load(SQUARE + "f 1 2 \\\n3\n")["faces"], [[0, 1, 2]])
    np.testing.assert_array_equal(load(SQUARE + "o a\nf 1 2 3\no b\nf 1 3 4\n")["faces"], [[0, 1, 2], [0, 2, 3]])
    np.testing.assert_array_equal(load((SQUARE + "f 1 2 3\n").replace("\n", "\r\n"))["faces"], [[0, 1, 2]])
    weighted = load("v 0 0 0 1\nv 1 0 0 1\nv 0 1 0 1\nf 1 2 3\n")
    assert weighted["vertices"].shape == (3, 3)
    error = abs(area(quad) - 1)
    figures("I7", "error of a square's area: quads, colours, continued lines, CRLF are read", ours=error, at_most=1e-12)


def test_i7_line_numbers_count_continued_lines(refusal):
    assert refusal("v 0 0 \\\n0\nv 1 0 0\nv 0 1 0\nf 1 2 \\\n\\\n3\nf 1 2 4\n").startswith("line 8: vertex 4")


def test_missing_files_and_unknown_kinds(load, refusal, tmp_path):
    load(SQUARE + "f 1 2 3\n", "blob.obj")
    with pytest.raises(jaxrt.SceneError, match=r'blop\.obj: no such file \(did you mean ".*blob\.obj"\?\)'):
        jaxrt.load_mesh(tmp_path / "blop.obj")
    with pytest.raises(jaxrt.SceneError, match="is a folder: name a mesh file in it"):
        (tmp_path / "folder.obj").mkdir()
        jaxrt.load_mesh(tmp_path / "folder.obj")
    assert (
        refusal("", "mesh.fbx") == 'unknown kind of mesh file ".fbx" (known: .obj, .ply, .stl, .glb, .off): convert it'
    )
    assert refusal("", "mesh.objj").startswith('unknown kind of mesh file ".objj" (did you mean ".obj"?)')
