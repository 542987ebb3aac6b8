"""Random scenes are built and told of; random damage to files gives one clear line, or a scene.

Hypothesis draws the same examples in every run: a test passes always or never. Values inside of fixed structures, with
their derivatives, are drawn in test_horrors.py, which has compiled programs for them.
"""

import contextlib
import io
import tempfile
import warnings
from pathlib import Path

import numpy as np
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console

import jaxrt
from jaxrt.checks import warnings_of
from jaxrt.cli import main
from jaxrt.description import SceneError, parse_description
from jaxrt.summary import print_summary
from tests import meshes

FIXED = {"deadline": None, "derandomize": True, "database": None}

# Random structures

coordinate = st.sampled_from([0, 1, -1, 1e-6, 1e6]) | st.floats(-9, 9, width=32)
place = st.tuples(coordinate, coordinate, coordinate)
length = st.sampled_from([1e-6, 1, 1e5]) | st.floats(0.0625, 9, width=32)
share = st.floats(0, 1, width=32)
color = st.tuples(share, share, share)
power = st.floats(0, 1e6, width=32)
MATERIALS = {
    "diffuse": st.builds(lambda a: {"type": "diffuse", "albedo": a}, color),
    "mirror": st.builds(lambda a: {"type": "mirror", "albedo": a}, color),
    "glass": st.builds(lambda n: {"type": "glass", "ior": n}, st.floats(0.125, 4, width=32)),
}


@st.composite
def some_mesh(draw, name):
    vertices, faces = draw(st.sampled_from([meshes.icosphere(0), meshes.icosphere(2), meshes.coplanar_quads(3)]))
    turn = draw(st.tuples(*[st.integers(-180, 180)] * 3))
    put = {"scale": draw(length), "rotate": turn, "translate": draw(place), "smooth": draw(st.booleans())}
    return {"vertices": vertices, "faces": faces, "material": draw(name), **put}


@st.composite
def scenes(draw):
    """Return descriptions with none, one or some of each kind of thing; some are refused, for lack of area or so."""
    kinds = draw(st.lists(st.sampled_from(list(MATERIALS)), min_size=1, max_size=4))
    materials = {f"m{i}": draw(MATERIALS[kind]) for i, kind in enumerate(kinds)}
    name = st.sampled_from(list(materials))
    camera = {"position": draw(place), "target": draw(place), "fov": draw(st.floats(1, 179, width=32))}
    ball = st.fixed_dictionaries({"center": place, "radius": length, "material": name})
    triangle = st.fixed_dictionaries({"vertices": st.tuples(place, place, place), "material": name})
    light = st.fixed_dictionaries({"position": place, "intensity": power | color, "radius": st.just(0) | length})
    scene = {"camera": camera, "materials": materials}
    for kind, members, most in (("spheres", ball, 3), ("triangles", triangle, 60), ("lights", light, 3)):
        scene[kind] = draw(st.lists(members, max_size=most))
    scene["meshes"] = draw(st.lists(some_mesh(name), max_size=2))
    if draw(st.booleans()):
        scene["environment"] = {"radiance": draw(color)}
    return scene


@settings(max_examples=150, **FIXED)
@given(scenes())
def test_random_structures_are_built_and_told_of(description):
    page = io.StringIO()
    try:
        parsed = parse_description(description)
    except SceneError as error:
        assert "\n" not in str(error)
        return
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jaxrt.SceneWarning)
        scene = jaxrt.build(parsed)
    print_summary("scene", parsed, scene, warnings_of(parsed), Console(file=page))
    assert "parameters" in page.getvalue()
    assert all(np.isfinite(x).all() for x in jaxrt.parameters(scene).values())


# Random damage

SCENE = """\
[camera]
position = [0, 0, 5]
target = [0, 0, 0]
up = [0, 1, 0]
fov = 60
width = 8
height = 8
[render]
spp = 4
max_depth = 3
[environment]
radiance = [0.1, 0.2, 0.3]
[materials.white]
type = "diffuse"
albedo = [0.8, 0.8, 0.8]
[materials.ball]
type = "glass"
ior = 1.5
[[spheres]]
center = [0, 0, 0]
radius = 1
material = "ball"
[[triangles]]
vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
material = "white"
[[meshes]]
file = "box.obj"
material = "white"
scale = 2
rotate = [0, 90, 0]
translate = [0, 0, -3]
smooth = true
[[lights]]
position = [0, 4, 5]
intensity = [9, 9, 9]
radius = 0.5
"""
LINES = SCENE.splitlines()
VALUES = [i for i, line in enumerate(LINES) if " = " in line]
BOX = trimesh.creation.box()
JUNK = st.sampled_from(
    [
        "nan",
        "-inf",
        "1e999",
        "1e39",
        "-1",
        "0",
        "2",
        "''",
        '"white"',
        "true",
        "[]",
        "{}",
        "[1, 2]",
        "[[1]]",
        "[nan, 0, 0]",
    ]
    + ["1979-05-27", "99999999999999999999", "[0, 0, 5]", "{a = 1}", '"../x"', '"box.obj"', "[[[0]]]", "1e-30", "0x7f"]
) | st.text(max_size=9)


@st.composite
def damaged_values(draw):
    """Return the scene with some values replaced, some keys misspelt, and some lines lost or doubled."""
    lines = list(LINES)
    for _ in range(draw(st.integers(1, 2))):
        row = draw(st.sampled_from(VALUES))
        key, value = LINES[row].split(" = ", 1)
        kind = draw(st.sampled_from(["value", "value", "value", "key", "lost", "twice"]))
        lines[row] = {
            "value": f"{key} = {draw(JUNK)}",
            "key": f"{key}{draw(st.sampled_from(['s', '_', '.x', ' y']))} = {value}",
            "lost": "",
            "twice": f"{lines[row]}\n{lines[row]}",
        }[kind]
    return "\n".join(lines).encode(errors="surrogatepass")


@st.composite
def damaged(draw, content):
    """Return bytes with a piece cut out and another put in."""
    start = draw(st.integers(0, len(content)))
    end = draw(st.integers(start, min(start + 40, len(content))))
    piece = draw(st.binary(max_size=6) | JUNK.map(lambda text: text.encode(errors="surrogatepass")))
    return content[:start] + piece + content[end:]


@settings(max_examples=250, **FIXED)
@given(damaged_values() | damaged(SCENE.encode()))
def test_damaged_scene_files_give_one_clear_line(content):
    """`jaxrt info` tells what is in the file with status 0, or what is wrong with it in one line with status 2."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.toml"
        path.write_bytes(content)
        (Path(folder) / "box.obj").write_text(BOX.export(file_type="obj"))
        out, err = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            status = main(["info", str(path)])
    told = err.getvalue()
    if status == 0:
        assert "parameters" in out.getvalue() and told == ""
    else:
        assert status == 2 and out.getvalue() == ""
        assert told.startswith(f"jaxrt: error: {path}: ") and told.count("\n") == 1 and told.endswith("\n")


def whole(kind):
    content = BOX.export(file_type=kind, **({"encoding": "ascii"} if kind == "ply" else {}))
    return content.encode() if isinstance(content, str) else content


FILES = {kind: whole(kind) for kind in ("obj", "off", "ply", "stl", "glb")}


@settings(max_examples=250, **FIXED)
@given(st.sampled_from(list(FILES)).flatmap(lambda kind: st.tuples(st.just(kind), damaged(FILES[kind]))))
def test_damaged_mesh_files_give_one_clear_line(file):
    """A mesh of finite vertices and faces that name them, or one SceneError."""
    kind, content = file
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"mesh.{kind}"
        path.write_bytes(content)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", jaxrt.SceneWarning)
                mesh = jaxrt.load_mesh(path)
        except SceneError as error:
            assert str(error).startswith(f"{path}: ") and "\n" not in str(error)
            return
    assert np.isfinite(mesh["vertices"]).all() and len(mesh["faces"]) > 0
    assert mesh["faces"].min() >= 0 and mesh["faces"].max() < len(mesh["vertices"])
