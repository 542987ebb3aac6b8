"""`gradcheck` and the names of parameters' rows: what is compared, what is told, and the verdict."""

import re
import warnings

import numpy as np
import pytest
from command import BALL, run, working_folder

import jaxrt
from jaxrt.description import parse_description
from jaxrt.gradcheck import Component, heatmap
from jaxrt.gradcheck.coverage import BEHIND, SPECULAR, coverage
from jaxrt.gradcheck.functionals import functionals, loss_slope
from jaxrt.gradcheck.report import Difference, compare
from jaxrt.io.image import load_image
from jaxrt.scene.selectors import parse_selector, select

SCENE = {
    "camera": {"position": [0, 0, 9], "width": 16, "height": 12, "fov": 40},
    "materials": {
        "silver": {"type": "mirror", "albedo": [0.9, 0.9, 0.9]},
        "white": {"type": "diffuse", "albedo": [0.8, 0.7, 0.6]},
        "crown": {"type": "glass", "ior": 1.5},
        "flint": {"type": "glass", "ior": 1.7},
    },
    "spheres": [
        {"center": [2.0 * i - 3, 0, 0], "radius": 0.9, "material": m} for i, m in enumerate(("silver", "white"))
    ],
    "triangles": [{"vertices": [[-9, -1, -9], [9, -1, -9], [0, -1, 9]], "material": "white"}],
    "lights": [{"position": [0, 5, 1], "intensity": 30, "radius": 0.5}],
}


@pytest.fixture(scope="module")
def description():
    return parse_description(SCENE)


@pytest.fixture(scope="module")
def scene(description):
    return jaxrt.build(description)


# Names of rows


@pytest.mark.parametrize(
    ("text", "name", "row"),
    [
        ("lights.position[0]", "lights.position", 0),
        ("lights.position", "lights.position", 0),
        ("materials.albedo[white]", "materials.albedo", 1),
        ("materials.albedo[silver]", "materials.albedo", 0),
        ("materials.ior[flint]", "materials.ior", 1),
        ("materials.ior[1]", "materials.ior", 1),
        ("meshes.vertices[2]", "meshes.vertices", 2),
        ("camera.fov", "camera.fov", None),
        (" camera.position ", "camera.position", None),
    ],
)
def test_selectors(scene, text, name, row):
    assert parse_selector(text, scene) == (name, row)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "lights.positon[0]",
            r"^lights\.positon: the scene has no such parameter \(did you mean \"lights\.position\"\?\)",
        ),
        ("lights.position[1]", r"^lights\.position\[1\]: no such row: use lights\.position\[0\]$"),
        ("lights.position[" + "1" * 5000 + "]", r"^lights\.position\[1+ … "),
        ("lights.position[-1]", r"^lights\.position\[-1\]: no such row"),
        ("spheres.radius", r"^spheres\.radius: has 2 rows: choose one, spheres\.radius\[0\] to spheres\.radius\[1\]"),
        (
            "materials.albedo[whit]",
            r"^materials\.albedo\[whit\]: no material of that name \(did you mean \"white\"\?\)",
        ),
        ("materials.albedo[crown]", r"^materials\.albedo\[crown\]: no material of that name"),
        ("lights.position[white]", r"^lights\.position\[white\]: \"white\" is not a row number: write lights"),
        ("camera.fov[0]", r"^camera\.fov\[0\]: camera\.fov has no rows: write camera\.fov$"),
        ("camera.fov[x]", r"^camera\.fov\[x\]: camera\.fov has no rows: write camera\.fov$"),
        ("lights.position[0", r"^\"lights\.position\[0\": is no parameter: write NAME or NAME\[ROW\]"),
        ("", r"^\"\": is no parameter"),
    ],
)
def test_wrong_selectors_are_refused(scene, text, message):
    with pytest.raises(jaxrt.SceneError, match=message):
        parse_selector(text, scene)


def test_rows_need_no_description(scene):
    assert str(select(scene, "materials.albedo", 1)) == "materials.albedo[1]"
    assert parse_selector("materials.albedo[white]", scene).row == 1


# Functionals


def test_functionals_see_a_shadow_move_and_the_mean_does_not():
    before, after = np.ones((12, 16, 3)), np.ones((12, 16, 3))
    before[4:8, 6:8] = after[4:8, 8:10] = 0
    change = after - before
    assert change.mean() == 0
    groups = functionals(change)
    # Two columns of four pixels, 1/8 apart each from −1 to 1: moved by two columns
    assert groups["first moments"][0] == pytest.approx(-8 * 2 * 2 / 16 / 192)
    assert groups["first moments"][1] == pytest.approx(0, abs=1e-15)
    assert abs(groups["Gaussian bumps"]).max() > 0.01
    assert loss_slope(before - after, change) < 0


def test_functionals_are_linear():
    a, b = np.random.default_rng(0).normal(size=(2, 9, 5, 3))
    for name, value in functionals(2 * a - b).items():
        np.testing.assert_allclose(value, 2 * functionals(a)[name] - functionals(b)[name], atol=1e-12)


# The verdict


def component(fine, coarse, interior, total, k=4, spread=1e-4):
    """Return a check of derivatives with these lengths and independent noise."""
    rng = np.random.default_rng(0)
    numbers = [x * np.ones((8, k)) + spread * rng.normal(size=(8, k)) for x in (fine, coarse, interior, total)]
    pictures = [np.full((2, 3, 3), x, np.float32) for x in (fine, interior, total)]
    return Component("x", 0.0, 0.1, (compare("moments", *numbers),), *pictures)


@pytest.mark.parametrize(
    ("check", "verdict", "told"),
    [
        (component(1, 1, 0.8, 1), "agrees", "within 0.0"),
        (component(1, 1, 0.8, 1.1), "differs", "by 10 % "),
        (component(1, 1.1, 0.8, 1), "inconclusive", "try half the step"),
        (component(1, 1, 0.8, 1, spread=0.1), "inconclusive", "noise of"),
        (component(1, 1, 1, 1.5, spread=1), "inconclusive", "noise of"),
        (component(0, 0, 0, 0, spread=0), "agrees", "within 0 %, of 2 % allowed"),
        # Rounding, of many standard errors
        (component(1, 1, 1, 1 + 1e-6, spread=1e-9), "agrees", "within 0.001 %, of 2 % allowed"),
        (component(0, 0, 0, 1, spread=0), "differs", "by 100 % "),
    ],
)
def test_verdicts(check, verdict, told):
    found, why = check.verdict(0.02)
    assert found == verdict and told in why, (found, why)


@pytest.mark.parametrize(
    ("share", "noise", "told"),
    [
        (0, 0, "0 %"),
        (9.7e-7, 4.6e-8, "below 0.001 %"),
        (0.0123, 0.003, "1.2 % (4.1 sigma)"),
        (0.5, 0.001, "50 % (500 sigma)"),
        (12.34, 0.01, "1234 % (999 sigma)"),
    ],
)
def test_differences_are_told_in_figures_that_mean_something(share, noise, told):
    assert str(Difference(share, noise)) == told


def test_heatmap_colours():
    picture = heatmap([component(1, 1, 0, -1, spread=0)])
    assert picture.shape[1] == 3 * (picture.shape[0] * 3 // 2) + 2 * 8 and picture.dtype == np.float32
    third = picture.shape[1] // 3
    finite, interior, total = (picture[5, third * i + third // 2] for i in range(3))
    assert finite[0] > 3 * finite[2] and total[2] > 3 * total[0]
    assert interior.min() == interior.max() > 0.9


# What is in, and what is not


@pytest.mark.parametrize(
    ("name", "included", "missing"),
    [
        ("materials.albedo", {"interior"}, set()),
        ("lights.intensity", {"interior"}, set()),
        (
            "lights.position",
            {
                "interior",
                "shadow edges",
                "outlines of lights seen by the camera",
                "edges seen in mirrors and through glass",
                "shadow edges in indirect light",
                "outlines of lights seen by scattered rays",
                "edges of caustics",
            },
            {SPECULAR, BEHIND},
        ),
        (
            "spheres.center",
            {
                "interior",
                "shadow edges",
                "outlines seen by the camera",
                "edges seen in mirrors and through glass",
                "shadow edges in indirect light",
                "outlines seen by scattered rays",
                "edges of caustics",
            },
            {SPECULAR, BEHIND},
        ),
        # Nothing is of glass
        ("materials.ior", {"interior"}, set()),
    ],
)
def test_coverage(scene, name, included, missing):
    found = coverage(scene, name, 3, 100)
    assert (set(found.included), set(found.missing)) == (included, missing)
    alone = coverage(scene, name, 3, 0)
    assert alone.included == ("interior",) and len(alone.missing) == len(included) + len(missing) - 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"seeds": 1}, "seeds is 1, want at least 2"),
        ({"step": 0}, "step is 0, want a positive number"),
        ({"tolerance": -1}, "tolerance is -1, want a positive number"),
        ({"component": 3}, "lights.position.0.: no component 3"),
        ({"row": 4}, "no such row"),
    ],
)
def test_arguments_are_checked(scene, options, message):
    with pytest.raises(ValueError, match=message):
        jaxrt.gradcheck(scene, "lights.position", **({"key": 0} | options))


def test_a_point_light_among_others_has_no_central_difference_in_its_radius():
    lights = [{"position": [0, 5, 1], "intensity": 3, "radius": r} for r in (0.5, 0)]
    scene = jaxrt.build(SCENE | {"lights": lights})
    with pytest.raises(jaxrt.SceneError, match=r"^lights\.radius\[1\]: a radius of 0 has no central difference"):
        jaxrt.gradcheck(scene, "lights.radius", 0, row=1)


# The command

LARGE = BALL.replace("width    = 16", "width    = 128").replace("height   = 12", "height   = 96")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    return working_folder(tmp_path, monkeypatch, LARGE)


@pytest.mark.usefixtures("quick_compilation")
def test_the_command_tells_and_draws(folder, capsys):
    """Pictures are made small: 64 pixels on the longer side."""
    arguments = ("ball.toml", "materials.albedo[white]", "-o", "a.png", "--spp", 4, "--seeds", 2, "--component", 1)
    status, out, err = run(capsys, "gradcheck", *arguments)
    assert status == 0, out
    assert "d(picture)/d(materials.albedo[0]): 4 spp, max_depth 1, 0 boundary samples, 2 seeds" in out
    assert re.search(r"^materials\.albedo\[0\] g = 0\.8, step 0\.02$", out, re.M)
    assert re.search(r"^  first moments +[\d.e-]+ ± [\d.e-]+ ", out, re.M)
    assert re.search(r"^  agrees within ", out, re.M) and "nothing known" in out
    assert set(err.splitlines()) <= {"jaxrt: compiling"} or re.search(r"^jaxrt: \d+/12 draws, ", err, re.M)
    assert load_image("a.png").shape == (5 * 48, 3 * 5 * 64 + 16, 3)


@pytest.mark.usefixtures("quick_compilation")
def test_the_command_fails_where_derivatives_differ(folder, capsys, monkeypatch):
    from jaxrt import gradcheck as package

    true = package.__globals__["_derivative"]
    monkeypatch.setitem(package.__globals__, "_derivative", lambda *a: tuple(1.1 * part for part in true(*a)))
    status, out, _ = run(
        capsys, "gradcheck", "ball.toml", "materials.albedo", "--spp", 4, "--seeds", 2, "--component", 1
    )
    assert status == 1 and re.search(r"^  differs by 10 % ", out, re.M)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("ball.toml", "materials.albedo[red]"), r"^materials\.albedo\[red\]: no material of that name"),
        (("ball.toml", "lights.radius"), r"^lights\.radius: the scene has no such parameter"),
        (("ball.toml",), r"required: NAME\[ROW\]: see jaxrt gradcheck --help"),
        (("none.toml", "camera.fov"), r"none\.toml: "),
        (("ball.toml", "camera.fov", "-o", "a.jpg"), r"unknown suffix"),
        (("ball.toml", "camera.fov", "--seeds", 1), r"1 is out of range"),
        (("ball.toml", "camera.fov", "--step", -1), r"step is -1.0, want a positive number"),
    ],
)
def test_bad_arguments_are_told_in_one_line(folder, capsys, arguments, message):
    before = sorted(folder.iterdir())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        status, out, err = run(capsys, "gradcheck", *arguments)
    assert (status, out) == (2, "") and err.count("\n") == 1
    assert re.search(message, err.removeprefix("jaxrt: error: "))
    assert sorted(folder.iterdir()) == before
