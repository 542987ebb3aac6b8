"""Random scenes are built and told of; bad and damaged files give one clear line, or what is in them.

Hypothesis draws the same examples in every run: a test passes always or never. Values inside of fixed structures, with
their derivatives, are drawn in test_horrors.py, which has compiled programs for them.
"""

import contextlib
import io
import tempfile
import warnings
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console

import jaxrt
from benchmarks.fuzz import pictures as picture_files
from benchmarks.fuzz import reports as report_files
from benchmarks.fuzz import scenes as scene_files
from benchmarks.fuzz.__main__ import read_scene, read_target, report_reader
from benchmarks.fuzz.judge import Case, Hang, judge, traps
from benchmarks.fuzz.judge import run as judged
from benchmarks.fuzz.values import BOX as BOX_OBJ
from jaxrt.cli import main
from jaxrt.cli.commands.summary import print_summary
from jaxrt.description import SceneError, parse_description
from jaxrt.scene.checks import warnings_of
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


# Bad files. `python -m benchmarks.fuzz` draws more of them, with other seeds


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with what scene files name, good and bad."""
    path = tmp_path_factory.mktemp("fuzz")
    (path / "box.obj").write_text(BOX_OBJ)
    traps(path)
    return path


def faults_of(cases, folder, read, least_read):
    counts, faults = judged(cases, folder, read)
    assert counts["read"] >= least_read
    return [f"{verdict.fault}: {verdict.case.name}: {verdict.text[-300:]}" for verdict in faults]


def test_l7_bad_scene_files_are_refused_in_one_line(folder):
    """Each key with each kind of bad value, keys lost, doubled, misspelt, text that is none: 2,000 of them."""
    assert faults_of(scene_files.mutations(1, 2000), folder, read_scene, 5) == []


def test_l7_damaged_scene_files_are_read_or_refused_in_one_line(folder):
    cases = [*scene_files.mutations(1, 4000)][-300:]
    assert {case.taken for case in cases} == {None}
    assert faults_of(cases, folder, read_scene, 5) == []


def test_l7_damaged_pictures_are_read_or_refused_in_one_line(folder):
    assert faults_of(picture_files.mutations(1, 600), folder, read_target, 50) == []


def test_l7_damaged_reports_are_read_or_refused_in_one_line(folder):
    assert faults_of(report_files.mutations(1, 400), folder, report_reader(folder / "scene.toml"), 10) == []


def test_the_judge_finds_faults(folder):
    """Crashes, hangs, several lines, no file's name, wrong reasons, and what is taken or refused against the rules."""

    def fail(path):
        raise errors[path.read_text()]

    place = f"{folder / 'case.x'}: "
    errors = {
        "crash": KeyError("x"),
        "message": ValueError("without a name"),
        "lines": ValueError(f"{place}two\nlines"),
        "long": ValueError(place + "x" * 2000),
        "reason": ValueError(f"{place}camera"),
        "refused": ValueError(f"{place}sound"),
        "hang": Hang(),
    }
    for name, fault in zip(
        errors, ("crash", "message", "message", "message", "reason", "refused", "hang"), strict=True
    ):
        case = Case(name, name.encode(), ".x", taken=name == "refused", names="spheres" if name == "reason" else "")
        assert judge(case, folder, fail).fault == fault
    assert judge(Case("a", b"", ".x", taken=False), folder, lambda path: 1).fault == "accepted"
    assert judge(Case("a", b"", ".x", check=lambda result: "off"), folder, lambda path: 1).fault == "wrong"
    assert judge(Case("a", b"", ".x", taken=True), folder, lambda path: 1).fault == ""


def test_bad_scene_files_end_the_command_with_status_2(folder):
    """`jaxrt info` tells what is in the file with status 0, or what is wrong with it in one line with status 2."""
    path = folder / "scene.toml"
    for case in [*scene_files.mutations(2, 60), Case("sound", scene_files.scene().encode(), ".toml", taken=True)]:
        path.write_bytes(case.content)
        out, err = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            status = main(["info", str(path)])
        told = err.getvalue()
        if case.taken:
            assert status == 0 and "parameters" in out.getvalue() and told == ""
        else:
            assert status == 2 and out.getvalue() == ""
            assert told.startswith(f"jaxrt: error: {path}: ") and told.count("\n") == 1 and told.endswith("\n")


# Random damage to meshes

BOX = trimesh.creation.box()
JUNK = st.sampled_from(["nan", "-inf", "1e999", "1e39", "-1", "0", "1e-30", ""]) | st.text(max_size=9)


@st.composite
def damaged(draw, content):
    """Return bytes with a piece cut out and another put in."""
    start = draw(st.integers(0, len(content)))
    end = draw(st.integers(start, min(start + 40, len(content))))
    piece = draw(st.binary(max_size=6) | JUNK.map(lambda text: text.encode(errors="surrogatepass")))
    return content[:start] + piece + content[end:]


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
