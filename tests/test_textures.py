"""Textures: lookups against NumPy, what scenes and files may say, and that who has none pays nothing."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from PIL import Image

import jaxrt
from jaxrt.cli.commands.summary import print_summary
from jaxrt.core.records import Chart
from jaxrt.fit.document import write_scene
from jaxrt.io.color import srgb_decode
from jaxrt.io.scene_file import read_description
from jaxrt.scene.selectors import parse_selector
from jaxrt.textures import Layout, Textures, color_at
from jaxrt.textures.pyramid import joined, parted
from jaxrt.transport.path import tables_of

RNG = np.random.default_rng(3)
WOOD = RNG.uniform(size=(5, 7, 3))
SQUARE = {"vertices": [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], "faces": [[0, 1, 2], [0, 2, 3]]}
UV = [[0, 0], [1, 0], [1, 1], [0, 1]]


def scene(albedo="wood", textures=None, size=16, **mesh):
    """Return a square that fills the picture of a camera far away, lit from there."""
    return {
        "camera": {"position": [0, 0, 100], "fov": 2 * np.degrees(np.arctan(0.01)), "width": size, "height": size},
        "textures": {"wood": {"texels": WOOD, "wrap": "clamp"}} if textures is None else textures,
        "materials": {"paint": {"type": "diffuse", "albedo": albedo}},
        "meshes": [SQUARE | {"uv": UV, "material": "paint"} | mesh],
        "lights": [{"position": [0, 0, 100], "intensity": [3e4, 3e4, 3e4]}],
    }


def albedo(description, spp=1):
    return np.asarray(jaxrt.render(jaxrt.build(description), 0, spp=spp, outputs=("albedo",))["albedo"])


def bilinear(texels, uv, clamp):
    """Return the colours of places (n, 2) in float64, by the words of the documentation."""
    h, w, _ = texels.shape
    x, y = uv[:, 0] * w - 0.5, (1 - uv[:, 1]) * h - 0.5
    total = 0
    for dx in (0, 1):
        for dy in (0, 1):
            i, j = np.floor(y).astype(int) + dy, np.floor(x).astype(int) + dx
            share = (1 - abs(y - i)) * (1 - abs(x - j))
            i, j = (np.clip(i, 0, h - 1), np.clip(j, 0, w - 1)) if clamp else (i % h, j % w)
            total = total + share[:, None] * texels[i, j]
    return total


def textures(texels, clamp, sort=0, scale=(1.0, 1.0)):
    layout = Layout(
        jnp.zeros(1, jnp.int32),
        jnp.asarray([texels.shape[:2]], jnp.int32),
        jnp.asarray([clamp]),
        jnp.asarray([scale]),
        jnp.asarray([sort], jnp.int32),
    )
    sorts = (("image", "checker", "vertex_colors")[sort],)
    return Textures(jnp.asarray(texels.reshape(-1, 3), jnp.float32), layout, {}, (texels.shape[:2],), sorts, ("t",))


@pytest.mark.parametrize("clamp", [True, False])
@pytest.mark.parametrize("shape", [(5, 7), (1, 1), (1, 4), (2, 2)])
def test_pictures_are_interpolated_and_wrap(clamp, shape):
    texels = RNG.uniform(size=(*shape, 3))
    uv = np.concatenate([RNG.uniform(-2, 3, (200, 2)), [[0, 0], [1, 1], [0.5, 0], [-1, 2]]]).astype(np.float32)
    look = jax.vmap(lambda uv: color_at(textures(texels, clamp), jnp.int32(0), Chart(uv=uv)))
    found = look(jnp.asarray(uv))
    wanted = bilinear(texels, np.clip(uv, 0, 1) if clamp else uv.astype(float), clamp)
    np.testing.assert_allclose(found, wanted, atol=3e-6)


def test_slopes_in_place_are_those_of_the_interpolation():
    """So that a picture laid on a moving surface moves with it."""
    table = textures(WOOD, False)
    for uv in RNG.uniform(size=(5, 2)):
        uv, step = jnp.asarray(uv, jnp.float32), 1e-3
        slope = jax.jacfwd(lambda uv: color_at(table, jnp.int32(0), Chart(uv=uv)))(uv)
        for axis in range(2):
            sides = [np.asarray(uv, float)[None] + side * step * np.eye(2)[axis] for side in (1, -1)]
            ahead, behind = (bilinear(WOOD, side, False)[0] for side in sides)
            np.testing.assert_allclose(slope[:, axis], (ahead - behind) / (2 * step), rtol=2e-2, atol=2e-2)


def test_checkers_and_vertex_colours():
    two = np.asarray([[[0.9, 0.8, 0.7], [0.1, 0.2, 0.3]]])
    uv = RNG.uniform(-2, 2, (50, 2)).astype(np.float32)
    found = jax.vmap(lambda uv: color_at(textures(two, False, 1, (4.0, 3.0)), jnp.int32(0), Chart(uv=uv)))(uv)
    odd = np.floor(uv * np.asarray([[4.0, 3.0]], np.float32)).sum(-1).astype(int) % 2
    np.testing.assert_allclose(found, two[0, odd], atol=1e-6)
    chart = Chart(vertices=jnp.asarray([4, 0, 2], jnp.int32), shares=jnp.asarray([0.5, 0.3, 0.2]))
    rows = RNG.uniform(size=(6, 1, 3))
    found = color_at(textures(rows, False, 2), jnp.int32(0), chart)
    np.testing.assert_allclose(found, 0.5 * rows[4, 0] + 0.3 * rows[0, 0] + 0.2 * rows[2, 0], atol=1e-6)


def test_a_square_shows_its_picture():
    """Upright: the first row on top, u from left to right."""
    size, parts = 16, 8
    shown = albedo(scene(size=size), spp=64)
    middle = (np.arange(size * parts) + 0.5) / (size * parts)
    u, v = np.meshgrid(middle, 1 - middle)
    wanted = bilinear(WOOD, np.stack([u, v], -1).reshape(-1, 2), True)
    np.testing.assert_allclose(shown, wanted.reshape(size, parts, size, parts, 3).mean((1, 3)), atol=0.005)


def test_seams_are_where_corners_differ():
    """A vertex of two places: each face has its own, and colours jump between them."""
    whole, seam = albedo(scene()), albedo(scene(uv=[*UV, [0.1, 0.1]], face_uv=[[0, 1, 2], [4, 4, 4]]))
    # The picture's first row is on top, so the diagonal from lower left to upper right parts the faces
    row, column = np.indices((16, 16))
    below, above = column + row > 17, column + row < 13
    np.testing.assert_allclose(seam[below], whole[below], atol=1e-5)
    here = bilinear(WOOD, np.asarray([[0.1, 0.1]]), True)
    np.testing.assert_allclose(seam[above], np.broadcast_to(here, seam[above].shape), atol=1e-5)


def test_a_factor_scales_a_texture():
    plain, scaled = albedo(scene()), albedo(scene({"texture": "wood", "factor": [0.5, 1, 0]}))
    np.testing.assert_allclose(scaled, plain * np.asarray([0.5, 1, 0]), atol=1e-6)
    description = scene({"texture": "wood", "factor": [0.5, 1, 0]})
    found = jaxrt.parameters(jaxrt.build(description), "materials.albedo[paint]")
    np.testing.assert_allclose(found, [0.5, 1, 0])


@pytest.mark.usefixtures("quick_compilation")
def test_rough_kinds_are_painted_without_code_of_their_own():
    """Half of a field by a texture is half of it by its number, in the picture and in its slope."""
    grey = {"grey": {"texels": np.full((1, 1, 3), 0.5)}}

    def picture(texture, x):
        field = {"texture": "grey", "factor": 0.8} if texture else 0.4
        material = {"type": "conductor", "albedo": [0.6, 0.5, 0.4], "roughness": field}
        built = jaxrt.build(scene(textures=grey if texture else {}, size=8) | {"materials": {"paint": material}})
        name = "textures.grey" if texture else "materials.roughness"
        value = jaxrt.parameters(built)[name] * x
        return jaxrt.render(jaxrt.with_parameters(built, {name: value}), 0, spp=4, max_depth=1).sum()

    painted, plain = (jax.value_and_grad(lambda x, t=t: picture(t, x))(1.0) for t in (True, False))
    assert abs(plain[1]) > 0.01 * plain[0]
    np.testing.assert_allclose(painted, plain, rtol=1e-4)


def test_texels_are_a_parameter():
    built = jaxrt.build(scene())
    values = jaxrt.parameters(built)
    np.testing.assert_allclose(values["textures.wood"], WOOD, rtol=1e-6)
    new = jaxrt.with_parameters(built, {"textures.wood": jnp.full((5, 7, 3), 0.25)})
    np.testing.assert_allclose(jaxrt.parameters(new, "textures.wood"), 0.25)
    with pytest.raises(jaxrt.SceneError, match=r"textures.wood: shape \(5, 3\), want \(5, 7, 3\)"):
        jaxrt.with_parameters(built, {"textures.wood": jnp.zeros((5, 3))})
    with pytest.raises(jaxrt.SceneError, match=r"textures.wood\[0\]: textures.wood has no rows"):
        jaxrt.parameters(built, "textures.wood[0]")


def test_scenes_without_textures_have_no_code_for_them():
    """Places on textures alone, for which nothing but an output asks, change no table; counts: test_specialisation."""
    plain = scene([0.5, 0.5, 0.5], {})
    del plain["meshes"][0]["uv"]
    both = [jaxrt.build(plain | {"meshes": [mesh]}) for mesh in (scene()["meshes"][0], plain["meshes"][0])]
    assert len({str(jax.tree.map(jnp.shape, tables_of(one))) for one in both}) == 1
    assert both[0].materials.textures is None and both[0].triangles.chart is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"albedo": "wod"}, r'materials.paint.albedo: unknown texture "wod" \(did you mean "wood"'),
        ({"albedo": {"factor": [1, 1, 1]}}, r'materials.paint.albedo: "texture" is missing'),
        ({"albedo": {"texture": "wood", "tint": 1}}, r'materials.paint.albedo: unknown key "tint"'),
        ({"albedo": {"texture": "wood", "factor": [1, 1, 2]}}, r"materials.paint.albedo.*2.*outside \[0, 1\]"),
        ({"textures": {"wood": {"texels": WOOD * 2}}}, r"textures.wood.texels: texel \[\d\]\[\d\].*outside \[0, 1\]"),
        ({"textures": {"wood": {"texels": [1, 2]}}}, r"textures.wood.texels: an array \(2,\) of int64 does not fit"),
        ({"textures": {"wood": {"file": "wood.png"}}}, r'textures.wood.file: "wood.png" has not been read'),
        ({"textures": {"wood": {"type": "chequer"}}}, r'textures.wood.type: unknown texture type "chequer"'),
        ({"textures": {"wood": {"texels": WOOD, "wrap": "mirror"}}}, r'textures.wood.wrap: "mirror" is unknown'),
        ({"textures": {"wood": {"texels": WOOD, "scale": 0}}}, r"textures.wood.scale.*0 is not > 0"),
        ({"textures": {"a.b": {"type": "checker"}}}, r'textures.*"a.b" cannot be a texture\'s name'),
        ({"textures": {"wood": {"type": "vertex_colors"}}}, r"meshes\[0\]: has no colours at its vertices"),
        ({"uv": None}, r"meshes\[0\]: has no uv"),
        ({"uv": [[0, 0]]}, r"meshes\[0\].uv: has 1 rows for 4 vertices"),
        ({"face_uv": [[0, 1, 2], [0, 1, 9]]}, r"meshes\[0\].face_uv: is not three rows of uv, 0 to 3, for each of 2"),
        ({"colors": [[1, 1, 300]] * 4}, r"meshes\[0\].colors: is outside \[0, 1\]: divide it"),
    ],
)
def test_what_is_wrong_is_told(change, message):
    with pytest.raises(jaxrt.SceneError, match=message):
        jaxrt.build(scene(**change))


def test_glass_bends_by_no_texture():
    description = scene()
    description["materials"]["glass"] = {"type": "glass", "ior": "wood"}
    with pytest.raises(jaxrt.SceneError, match=r'materials.glass.ior: "wood" is not a number'):
        jaxrt.build(description)


def test_unused_textures_are_told_and_left_out():
    description = scene()
    description["textures"]["spare"] = {"type": "checker"}
    with pytest.warns(jaxrt.SceneWarning, match='textures: "spare" is used by nothing'):
        built = jaxrt.build(description)
    assert "textures.spare" not in jaxrt.parameters(built)


# Files

TOML = """
[camera]
position = [0, 0, 100]
fov = 1.2
width = 8
height = 8
[materials.paint]
type = "diffuse"
albedo = {albedo}
{more}
[[meshes]]
file = "square.obj"
material = "paint"
[[lights]]
position = [0, 0, 100]
intensity = 3e4
"""
OBJ = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n{}f 1/1 2/2 3/3 4/4\n"


@pytest.fixture
def folder(tmp_path):
    levels = RNG.integers(0, 256, (4, 6, 3), dtype=np.uint8)
    Image.fromarray(levels).save(tmp_path / "wood.png")
    Image.fromarray(levels).resize((60, 40), 0).save(tmp_path / "wood.jpg", quality=100, subsampling=0)
    jaxrt.save_image(tmp_path / "wood.exr", srgb_decode(levels / 255).astype(np.float32))
    (tmp_path / "square.obj").write_text(OBJ.format(""))
    return tmp_path, srgb_decode(levels / 255)


def write(path, albedo, more=""):
    (path / "scene.toml").write_text(TOML.format(albedo=albedo, more=more))
    return path / "scene.toml"


@pytest.mark.parametrize("name", ["wood.png", "wood.exr"])
def test_a_file_alone_names_a_texture(folder, name):
    path, linear = folder
    loaded = jaxrt.load_scene(write(path, f'"{name}"'))
    np.testing.assert_allclose(jaxrt.parameters(loaded, "textures.wood"), linear, atol=1e-6)


def test_pictures_are_srgb_or_linear(folder):
    path, linear = folder
    loaded = jaxrt.load_scene(write(path, '"w"', '[textures.w]\nfile = "wood.png"\nencoding = "linear"'))
    decoded = srgb_decode(np.asarray(jaxrt.parameters(loaded, "textures.w"), float))
    np.testing.assert_allclose(decoded, linear, atol=1e-5)
    texels = jaxrt.load_texture(path / "wood.jpg")["texels"].reshape(4, 10, 6, 10, 3)[:, 5, :, 5]
    assert np.abs(texels - linear).mean() < 0.02


@pytest.mark.parametrize(
    ("albedo", "more", "message"),
    [
        ('"would.png"', "", r'materials.paint.albedo: .*would.png: no such file \(did you mean ".*wood.png"'),
        ('"w"', '[textures.w]\nfile = "wood.tga"', r'textures.w.file: .*unknown kind of picture ".tga"'),
        ('"w"', "[textures.w]\nfile = 3", r"textures.w.file: 3 is not a name"),
        ('"w"', '[textures.w]\nfile = "wood.png"\nencoding = "gamma"', 'encoding: "gamma" is unknown'),
        ('"wood.png"', '[textures.wood]\nfile = "wood.exr"', r'"wood.png" would be texture "wood", which is another'),
        ('"../../wood.png"', "", "lies outside of the file's folder"),
        ('"square.png"', "", "cannot be read as .png"),
    ],
)
def test_files_that_are_wrong_are_told(folder, albedo, more, message):
    path, _ = folder
    (path / "square.png").write_bytes(b"\x89PNG nothing")
    with pytest.raises(jaxrt.SceneError, match=message):
        jaxrt.load_scene(write(path, albedo, more))


def test_beyond_one_is_told(tmp_path):
    jaxrt.save_image(tmp_path / "bright.exr", np.full((2, 2, 3), 1.5, np.float32))
    with pytest.warns(jaxrt.SceneWarning, match=r"bright.exr: 4 texels are outside \[0, 1\]"):
        table = jaxrt.load_texture(tmp_path / "bright.exr")
    assert table["texels"].max() == 1


def test_mtl_pictures(folder):
    """`map_Kd`, with Kd as its factor, its options, and what is left out."""
    path, linear = folder
    (path / "square.obj").write_text("mtllib a.mtl\n" + OBJ.format("usemtl wood\n"))
    (path / "a.mtl").write_text("newmtl wood\nKd 0.5 0.5 0.5\nmap_Kd -s 2 3 1 -clamp on wood.png\n")
    mesh = jaxrt.load_mesh(path / "square.obj")
    assert mesh["materials"]["square.obj:wood"]["albedo"] == {"texture": "square_wood", "factor": [0.5, 0.5, 0.5]}
    table = mesh["textures"]["square_wood"]
    np.testing.assert_allclose(table["texels"], linear, atol=1e-6)
    assert table["scale"] == [2, 3] and table["wrap"] == "clamp"
    built = jaxrt.build(scene() | {"materials": {}, "textures": {}, "meshes": [mesh]})
    assert jaxrt.parameters(built, "textures.square_wood").shape == (4, 6, 3)
    (path / "a.mtl").write_text("newmtl wood\nKd 0.5 0.5 0.5\nmap_Kd -bm 2 lost.png\n")
    with pytest.warns(jaxrt.SceneWarning, match='map_Kd "lost.png" is left out .*no such file'):
        mesh = jaxrt.load_mesh(path / "square.obj")
    assert mesh["materials"]["square.obj:wood"]["albedo"] == [0.5, 0.5, 0.5]


@pytest.mark.parametrize(
    ("faces", "uv"),
    [
        ("f 1/4 2/3 3/2 4/1", [3, 2, 1, 0]),
        ("f 1/-1/7 2/-2/7 3/-3/7 4/-4/7", [3, 2, 1, 0]),
        ("f 1/1 2/1 3/4 4/2", [0, 0, 3, 1]),
    ],
)
def test_obj_corners_name_their_places(tmp_path, faces, uv):
    (tmp_path / "a.obj").write_text(OBJ.format("").rsplit("f", 1)[0] + faces + "\n")
    mesh = jaxrt.load_mesh(tmp_path / "a.obj")
    np.testing.assert_allclose(mesh["uv"][mesh["face_uv"]], np.asarray(UV)[uv][mesh["faces"]])


def test_obj_corners_without_a_place_are_told(tmp_path):
    (tmp_path / "a.obj").write_text(OBJ.format("").replace("4/4", "4"))
    with pytest.warns(jaxrt.SceneWarning, match="1 of 4 corners have no place on a texture"):
        jaxrt.load_mesh(tmp_path / "a.obj")


PLY = (
    "ply\nformat ascii 1.0\nelement vertex 4\n{}element face 1\nproperty list uchar int vertex_indices\n{}end_header\n"
)


def test_ply_places_and_colours(tmp_path):
    properties = "".join(f"property float {name}\n" for name in ("x", "y", "z", "s", "t"))
    properties += "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    rows = [f"{x} {y} 0 {u} {v} {50 * i} 0 255" for i, ((x, y), (u, v)) in enumerate(zip(np.sign(UV), UV, strict=True))]
    (tmp_path / "a.ply").write_text(PLY.format(properties, "") + "\n".join([*rows, "4 0 1 2 3"]) + "\n")
    mesh = jaxrt.load_mesh(tmp_path / "a.ply")
    np.testing.assert_allclose(mesh["uv"], UV)
    reds = np.arange(4) * 50 / 255
    np.testing.assert_allclose(mesh["colors"], srgb_decode(np.stack([reds, reds * 0, reds * 0 + 1], -1)), atol=1e-12)


def test_ply_places_of_faces(tmp_path):
    places = "".join(f"property float {name}\n" for name in "xyz")
    rows = [f"{x} {y} 0" for x, y in UV]
    text = PLY.format(places, "property list uchar float texcoord\n")
    face = "4 0 1 2 3 8 " + " ".join(f"{1 - u} {v}" for u, v in UV)
    (tmp_path / "a.ply").write_text(text + "\n".join([*rows, face]) + "\n")
    mesh = jaxrt.load_mesh(tmp_path / "a.ply")
    flipped = mesh["vertices"][mesh["faces"]][..., :2] * np.asarray([-1, 1]) + np.asarray([1, 0])
    np.testing.assert_allclose(mesh["uv"][mesh["face_uv"]], flipped)


# Derivatives

KINDS = {
    "wood": {"texels": WOOD},
    "one": {"texels": [[[0.3, 0.5, 0.7]]]},
    "tiles": {"type": "checker"},
    "paint": {"type": "vertex_colors"},
}


@pytest.fixture(scope="module")
def corner():
    """A floor, a wall and balls that light one another, each with another sort of texture."""
    wall = {"vertices": [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1]], "faces": SQUARE["faces"]}
    floor = {"vertices": [[-1, -1, 1], [1, -1, 1], [1, -1, -1], [-1, -1, -1]], "faces": SQUARE["faces"]}
    return jaxrt.build(
        {
            "camera": {"position": [0, 0.3, 4], "fov": 35, "width": 8, "height": 8},
            "textures": KINDS,
            "materials": {
                "floor": {"type": "diffuse", "albedo": "wood"},
                "wall": {"type": "diffuse", "albedo": "paint"},
                "ball": {"type": "diffuse", "albedo": "tiles"},
                "plain": {"type": "diffuse", "albedo": "one"},
            },
            "meshes": [
                wall | {"colors": RNG.uniform(size=(4, 3)), "material": "wall"},
                floor | {"uv": [*UV, [0.3, 0.4]], "face_uv": [[0, 1, 2], [4, 2, 3]], "material": "floor"},
            ],
            "spheres": [
                {"center": [-0.4, -0.6, 0], "radius": 0.4, "material": "ball"},
                {"center": [0.5, -0.65, 0.2], "radius": 0.3, "material": "plain"},
            ],
            "lights": [{"position": [0.5, 2, 3], "intensity": [20, 20, 20]}],
        }
    )


@pytest.mark.usefixtures("quick_compilation")
def test_texel_gradients_are_those_of_finite_differences(corner):
    """Of every sort, of one texel alone, over a seam, beside another parameter."""
    names = [*(f"textures.{name}" for name in KINDS), "materials.albedo"]
    values = {name: jaxrt.parameters(corner)[name] for name in names}
    weight = jnp.asarray(RNG.uniform(0.5, 1.5, (8, 8, 3)), jnp.float32)

    @jax.jit
    def total(values):
        built = jaxrt.with_parameters(corner, values)
        return jnp.sum(weight * jaxrt.render(built, 3, spp=4, max_depth=2))

    gradient = jax.jit(jax.grad(total))(values)
    for name in names:
        way = RNG.normal(size=values[name].shape)
        sides = [total(values | {name: values[name] + side * 0.02 * way.astype(np.float32)}) for side in (1, -1)]
        difference = (float(sides[0]) - float(sides[1])) / 0.04
        assert np.sum(np.asarray(gradient[name], float) * way) == pytest.approx(difference, rel=2e-3, abs=1e-3), name
    # The slope in a factor is that in all texels together, weighed by them: both scale the same light
    of_texels = jnp.sum(gradient["textures.wood"] * values["textures.wood"], (0, 1))
    np.testing.assert_allclose(gradient["materials.albedo"][0], of_texels, rtol=1e-4)


def test_marks_add_up_rows_past_what_float32_counts():
    from jaxrt.textures.recording import add_marks, read

    texels, rows = jnp.zeros((9000, 3)), jnp.asarray([8999, 3, 4096, 3], jnp.int32)
    weights, change = jnp.asarray([0.1, 0.2, 0.3, 0.4]), jnp.asarray([1.0, 2.0, 3.0])
    (mark,) = jax.vjp(lambda mark: read(texels, list(zip(rows, weights, strict=True)), mark), jnp.zeros(15))[1](change)
    sums = jax.jit(add_marks)(jnp.zeros((9000, 6)), mark[None])
    wanted = np.zeros((9000, 3))
    np.add.at(wanted, np.asarray(rows), np.outer(weights, change))
    np.testing.assert_allclose(sums[:, :3], wanted, rtol=1e-6)


SPHERE = '[[spheres]]\ncenter = [0, 0, -9]\nradius = 1\nmaterial = "b"\n'


def test_a_fitted_scene_has_its_texels_beside_it(folder):
    """In another folder, and what is not fitted is found where it lies."""
    path, linear = folder
    (path / "other.png").write_bytes((path / "wood.png").read_bytes())
    more = '[materials.b]\ntype = "mirror"\nalbedo = "other.png"'
    source, out = write(path, '"wood.png"', more), path / "out"
    source.write_text(source.read_text() + SPHERE)
    out.mkdir()
    texels = RNG.uniform(size=(4, 6, 3)).astype(np.float32)
    factor = np.asarray([0.5, 0.25, 1], np.float32)
    scene, description = jaxrt.load_scene(source), read_description(source)
    values = {"textures.wood": texels, "materials.albedo[paint]": factor}
    selectors = {text: parse_selector(text, scene) for text in values}
    write_scene(source, out / "fitted.toml", values, selectors, description)
    again = jaxrt.parameters(jaxrt.load_scene(out / "fitted.toml", allow_folders=[path]))
    np.testing.assert_array_equal(again["textures.wood"], texels)
    np.testing.assert_allclose(again["textures.other"], linear, atol=1e-6)
    np.testing.assert_array_equal(again["materials.albedo"], [factor, [1, 1, 1]])


def test_pictures_that_a_field_names_are_found_from_another_folder(folder):
    """Beside a factor too; and a texture that came with a mesh keeps how it repeats."""
    path, linear = folder
    (path / "square.obj").write_text("mtllib a.mtl\n" + OBJ.format("usemtl wood\n"))
    (path / "a.mtl").write_text("newmtl wood\nmap_Kd -s 2 3 -clamp on wood.png\n")
    source, out = (
        write(path, '{ texture = "wood.png", factor = [0.5, 0.5, 0.5] }', SPHERE.replace('"b"', '"paint"')),
        path / "out",
    )
    source.write_text(source.read_text().replace('file = "square.obj"\nmaterial = "paint"', 'file = "square.obj"'))
    out.mkdir()
    scene, description = jaxrt.load_scene(source), read_description(source)
    brought = "textures.square_wood"
    for values in (
        {"materials.albedo[paint]": np.asarray([0.5, 0.25, 1], np.float32)},
        {brought: np.full((4, 6, 3), 0.25, np.float32)},
        {"materials.albedo[square.obj:wood]": np.asarray([0.5, 0.25, 1], np.float32)},
        # The file is left behind, but not what came with it
        {"meshes.vertices[0]": np.asarray([-1.5, -1, 0], np.float32)},
    ):
        selectors = {text: parse_selector(text, scene) for text in values}
        write_scene(source, out / "fitted.toml", values, selectors, description)
        again = read_description(out / "fitted.toml", allow_folders=[path])
        assert again.textures["square_wood"].scale == (2, 3) and again.textures["square_wood"].wrap == "clamp"
        np.testing.assert_allclose(again.textures["wood"].texels, linear, atol=1e-6)
        built = jaxrt.parameters(jaxrt.build(again))
        np.testing.assert_allclose(built["materials.albedo"][0], values.get("materials.albedo[paint]", [0.5] * 3))
        wanted = values.get(brought, linear)
        np.testing.assert_allclose(built[brought], wanted, atol=1e-6)
        np.testing.assert_array_equal(again.meshes[0].uv, description.meshes[0].uv)


@pytest.mark.parametrize("shape", [(128, 128, 3), (5, 7, 3), (1, 9, 3), (2, 2, 1)])
def test_levels_add_up_to_their_picture(shape):
    picture = RNG.uniform(size=shape).astype(np.float32)
    levels = parted(jnp.asarray(picture), coarsest=2)
    assert levels[0].shape == shape and min(levels[-1].shape[:2]) <= 2
    np.testing.assert_allclose(joined(levels), picture, atol=1e-6)
    # The coarsest level is what all texels have in common
    flat = parted(jnp.full(shape, 0.25))
    assert all(np.allclose(level, 0, atol=1e-6) for level in flat[:-1]) and np.allclose(flat[-1], 0.25, atol=1e-6)


def test_info_tells_of_textures(folder, capsys):
    path, _ = folder
    print_summary("a", *_described(write(path, '"wood.png"')), [])
    told = capsys.readouterr().out
    assert "image" in told and "6x4" in told and "wood times (1, 1, 1)" in told and "textures.wood" in told


def _described(path):
    description = read_description(path)
    return description, jaxrt.build(description)
