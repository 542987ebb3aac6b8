"""The command line: pictures appear, or one clear line does and nothing is written."""

import os
import re
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import numpy as np
import pytest
from command import BALL, run, working_folder
from jax.stages import Compiled

import jaxrt
from jaxrt import chunks, cli, programs
from jaxrt.cli import progress, start
from jaxrt.cli.commands import render, summary
from jaxrt.description.kinds import CAMERAS, LIGHTS, MATERIALS
from jaxrt.io.image import load_image
from jaxrt.io.partial import Partial
from jaxrt.io.scene_file import read_description
from jaxrt.render import Run
from jaxrt.transport.film import BLOCK

ROOT = Path(__file__).parents[1]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty working folder with ball.toml in it."""
    return working_folder(tmp_path, monkeypatch)


def refused(capsys, folder, *argv):
    """Return the one line of a refusal, having made sure that nothing was written."""
    before = sorted(folder.iterdir())
    status, out, err = run(capsys, *argv)
    assert (status, out) == (2, "")
    assert err.startswith("jaxrt: error: ") and err.count("\n") == 1 and err.endswith("\n")
    assert sorted(folder.iterdir()) == before
    return err.removeprefix("jaxrt: error: ").rstrip()


def test_render_writes_the_picture_that_render_returns(folder, capsys):
    import jaxrt

    status, out, err = run(capsys, "render", "ball.toml", "-o", "ball.exr", "--seed", 3)
    assert status == 0 and err in ("", "jaxrt: compiling\n")
    pattern = r"ball\.exr: 16x12, 2 spp, max_depth 1, sobol: compile [\d.]+ s, render [\d.]+ s, [\d.]+ Mpaths/s"
    assert re.match(pattern, out)
    picture = load_image(folder / "ball.exr")
    np.testing.assert_array_equal(picture, jaxrt.render(jaxrt.load_scene("ball.toml"), 3))
    assert picture[6, 8].min() > 0.05 and picture[0, 0].max() == 0


@pytest.mark.parametrize("path", ["no folder", "compiled", "loaded"])
def test_a_program_runs_once_before_it_draws(folder, capsys, monkeypatch, path):
    """The time of compiling is told apart from that of drawing by a run of no samples, which a mesh makes dear."""
    keep, calls = folder / "programs", []
    keep.mkdir()
    if path != "no folder":
        monkeypatch.setattr(start, "start_jax", lambda cores: keep)
    if path == "loaded":
        run(capsys, "render", "ball.toml")
    counted = {
        "no folder": (programs, "sum_share"),
        "compiled": (Compiled, "__call__"),
        "loaded": (Compiled, "__call__"),
    }
    original = getattr(*counted[path])

    def count(*arguments, **options):
        calls.append(next(int(a.end) - int(a.first) for a in arguments if isinstance(a, Run)))
        return original(*arguments, **options)

    monkeypatch.setattr(*counted[path], count)
    assert run(capsys, "render", "ball.toml", "--spp", 6)[0] == 0
    # The picture has two packets, which are two shares
    assert calls == [0, 4, 4, 2, 2]


def test_the_default_output_is_a_png_in_the_current_folder(folder, capsys):
    (folder / "deep").mkdir()
    (folder / "ball.toml").rename(folder / "deep" / "ball.toml")
    assert run(capsys, "render", "deep/ball.toml")[0] == 0
    assert load_image(folder / "ball.png").shape == (12, 16, 3)
    assert sorted(p.name for p in folder.iterdir()) == ["ball.png", "deep"]


def test_arguments_override_the_file(folder, capsys):
    options = ("--spp", 4, "--max-depth", 2, "--width", 8, "--height", 6, "--sampler", "independent")
    status, out, _ = run(capsys, "render", "ball.toml", "-o", "a.exr", *options)
    assert status == 0
    assert out.startswith("a.exr: 8x6, 4 spp, max_depth 2, independent: ")
    assert load_image("a.exr").shape == (6, 8, 3)


def test_exposure_and_srgb_reach_the_file(folder, capsys):
    for name, *options in (("a.exr",), ("b.exr", "--exposure", -1), ("c.png",), ("d.png", "--srgb")):
        assert run(capsys, "render", "ball.toml", "-o", name, *options)[0] == 0
    plain = load_image("a.exr")
    np.testing.assert_array_equal(load_image("b.exr"), plain / 2)
    np.testing.assert_allclose(load_image("c.png"), np.clip(plain, 0, 1), atol=6e-3)
    np.testing.assert_allclose(load_image("d.png", srgb=True), np.clip(plain, 0, 1), atol=6e-3)


def test_the_cores_are_all_usable_ones_unless_told(folder, capsys, monkeypatch):
    asked, original = [], render.painter
    monkeypatch.setattr(render, "painter", lambda *all_: asked.append(all_[-1]) or original(*all_))
    monkeypatch.setattr(start, "usable_cores", lambda: 5)
    run(capsys, "render", "ball.toml")
    run(capsys, "render", "ball.toml", "--cores", 3)
    assert asked == [5, 3]
    monkeypatch.undo()
    monkeypatch.delattr(start.os, "sched_getaffinity", raising=False)
    assert start.usable_cores() == (os.cpu_count() or 1)


def test_jax_is_started_with_the_cores_and_a_cache(tmp_path, monkeypatch):
    import jax

    asked, options = [], {}
    monkeypatch.setattr(start, "use_cpu_cores", asked.append)
    monkeypatch.setattr(start.gc, "disable", lambda: asked.append("no collector"))
    monkeypatch.setattr(jax.config, "update", options.__setitem__)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR", raising=False)
    with jax.enable_x64(False):
        start.start_jax(2)
    assert asked == [2, "no collector"]
    assert Path(options["jax_compilation_cache_dir"]).parent == tmp_path / "jaxrt"
    assert (tmp_path / "jaxrt").stat().st_mode & 0o7777 == 0o700


def test_warnings_are_one_line_each_and_no_error(folder, capsys):
    (folder / "dark.toml").write_text(BALL.split("[[lights]]")[0])
    status, _, err = run(capsys, "render", "dark.toml")
    assert status == 0
    assert err.startswith("jaxrt: warning: no light and no environment: the picture is black, add [[lights]]")
    assert load_image("dark.png").max() == 0


def test_r4_sobol_warns_of_spp_that_is_no_power_of_two(folder, capsys):
    _, _, err = run(capsys, "render", "ball.toml", "--spp", 3)
    assert "jaxrt: warning: spp 3 is not a power of two: sobol is at its best with 2 or 4\n" in err
    _, _, err = run(capsys, "render", "ball.toml", "--spp", 3, "--sampler", "independent")
    assert "warning" not in err


BAD_SCENES = [
    ("radius   = 10", "radius   = nan", "spheres[0].radius: nan is not finite: write a finite number"),
    ("radius   = 10", "radius   = 1e999", "spheres[0].radius: inf is not finite: write a finite number"),
    ("radius   = 10", "radius   = 0", "spheres[0].radius: 0.0 is not > 0: use a positive radius"),
    ("radius   = 10", "radius   = -1", "spheres[0].radius: -1.0 is not > 0: use a positive radius"),
    (
        "[0.8, 0.8, 0.8]",
        "[0.8, 1.5, 0.8]",
        "materials.white.albedo[1]: 1.5 is outside [0, 1]: choose an albedo",
    ),
    ("width    = 16", "fov = 0", "camera.fov: 0.0 is not between 0 and 180: choose degrees"),
    ("width    = 16", "fov = 180", "camera.fov: 180.0 is not between 0 and 180: choose degrees"),
    ("width    = 16", "width = 0", "camera.width: 0 is out of range: write an integer from 1"),
    ("spp       = 2", "spp = 0", "render.spp: 0 is out of range: write an integer from 1"),
    ("width    = 16", "up = [0, 0, 1]", "camera.up: (0.0, 0.0, 1.0) is parallel to the view: choose another"),
    ("radius   = 10", "raduis = 10", 'spheres[0]: unknown key "raduis" (did you mean "radius"?)'),
    ('material = "white"', 'material = "whit"', 'unknown material "whit" (did you mean "white"?)'),
    ("[camera]", "[camera", "line 2, column 8: not valid TOML: "),
]


@pytest.mark.parametrize(("old", "new", "message"), BAD_SCENES)
def test_bad_scenes_are_refused_by_render_and_info(folder, capsys, old, new, message):
    (folder / "bad.toml").write_text(BALL.replace(old, new))
    for command in ("render", "info"):
        line = refused(capsys, folder, command, "bad.toml")
        assert line.startswith("bad.toml: ") and message in line


def test_missing_scenes_are_refused_with_the_nearest_name(folder, capsys):
    line = refused(capsys, folder, "render", "bal.toml")
    assert line == 'bal.toml: no such file (did you mean "ball.toml"?)'


def test_i12_images_larger_than_memory_are_refused(folder, capsys):
    line = refused(capsys, folder, "render", "ball.toml", "--width", 100_000, "--height", 100_000)
    assert re.fullmatch(
        r"ball\.toml: camera: image 100000x100000 needs [\d.]+ GiB, this machine has [\d.]+ GiB: "
        r"lower width or height",
        line,
    )


BAD_ARGUMENTS = [
    ((), "the following arguments are required: COMMAND: see jaxrt --help"),
    (("rendr", "ball.toml"), "invalid choice: 'rendr'"),
    (("render",), "the following arguments are required: SCENE: see jaxrt render --help"),
    (
        ("render", "ball.toml", "--spp", "0"),
        "argument --spp: 0 is out of range, use 1 to 2147483647: see jaxrt",
    ),
    (("render", "ball.toml", "--spp", "many"), 'argument --spp: "many" is not a whole number'),
    (("render", "ball.toml", "--width", "0"), "argument --width: 0 is out of range"),
    (("render", "ball.toml", "--height", "-1"), "argument --height: -1 is out of range"),
    (("render", "ball.toml", "--max-depth", "0"), "argument --max-depth: 0 is out of range"),
    (("render", "ball.toml", "--cores", "0"), "argument --cores: 0 is out of range"),
    (("render", "ball.toml", "--seed", "-1"), "argument --seed: -1 is out of range, use 0 to 4294967295"),
    (("render", "ball.toml", "--exposure", "nan"), "argument --exposure: nan is out of range"),
    (("render", "ball.toml", "--exposure", "x"), 'argument --exposure: "x" is not a number'),
    (("render", "ball.toml", "--sampler", "sobel"), 'unknown sampler "sobel" (did you mean "sobol"?)'),
    (("render", "ball.toml", "--ssp", "3"), "unrecognized arguments: --ssp 3"),
    (("render", "ball.toml", "-o", "a.jpg"), 'a.jpg: unknown suffix ".jpg": use .png or .exr'),
    (("render", "ball.toml", "-o", "a"), "a: no suffix: use .png or .exr"),
    (("render", "ball.toml", "-o", "no/a.png"), 'no/a.png: the folder "no" does not exist: make it first'),
    (("diff", "x.png", "y.png"), "x.png: no such file: check the path"),
    (("diff", "ball.toml", "y.png"), 'ball.toml: unknown suffix ".toml": use .png or .exr'),
]


@pytest.mark.parametrize(("argv", "message"), BAD_ARGUMENTS)
def test_bad_arguments_are_refused(folder, capsys, argv, message):
    assert message in refused(capsys, folder, *argv)


def test_outputs_that_cannot_be_written_are_refused_before_rendering(folder, capsys, monkeypatch):
    (folder / "a.png").mkdir()
    assert "a.png: is a folder" in refused(capsys, folder, "render", "ball.toml", "-o", "a.png")
    monkeypatch.setattr(start.os, "access", lambda path, mode: False)
    assert "is not writable: choose another" in refused(capsys, folder, "render", "ball.toml", "-o", "b.png")


@pytest.mark.parametrize("moment", ["jaxrt.cli.commands.render.painter", "jaxrt.cli.commands.render.built"])
def test_ctrl_c_before_there_is_anything_leaves_nothing(folder, capsys, monkeypatch, moment):
    def interrupt(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(moment, interrupt)
    status, out, err = run(capsys, "render", "ball.toml")
    assert (status, out) == (130, "")
    assert err.endswith("jaxrt: interrupted, nothing written\n")
    assert [p.name for p in folder.iterdir()] == ["ball.toml"]


# Idle: what a chunk takes besides its samples, as for the tables of a mesh
@pytest.mark.parametrize(("seconds_per_sample", "idle"), [(1e-4, 0), (0.02, 0), (3.0, 0), (0.13, 0.57), (1e-3, 0.03)])
def test_chunks_cover_every_sample_once(monkeypatch, seconds_per_sample, idle):
    clock, drawn, ends, spp = [0.0], [], [], 1001

    def draw(first, count):
        clock[0] += idle + seconds_per_sample * count
        drawn.append((first, count))
        return np.full((2, 3, 3, 3), count, np.float32)

    monkeypatch.setattr(chunks.time, "perf_counter", lambda: clock[0])
    nothing = Partial.nothing({"width": 3, "height": 2, "spp": spp}, 0)
    total = chunks.accumulate(draw, nothing, spp, lambda sums: ends.append(sums.end) or True)
    np.testing.assert_array_equal(total.high, np.full((2, 3, 3), 3 * spp))
    assert [first for first, _ in drawn] == [0, *np.cumsum([count for _, count in drawn])[:-1]]
    assert ends == [first + count for first, count in drawn] and ends[-1] == spp
    assert clock[0] < 1.25 * spp * max(seconds_per_sample, idle / 10)
    # Whole blocks, in powers of two, of at most 5 s each unless a block takes longer
    assert all(count % BLOCK == 0 and count & (count - 1) == 0 for _, count in drawn[:-1])
    assert max(count for _, count in drawn) * seconds_per_sample + idle <= max(5, BLOCK * seconds_per_sample)


def test_progress_in_a_pipe_is_a_few_lines(monkeypatch, capsys):
    """Also of a day's work, after a resumption, and of quick work."""
    clock = [0.0]
    monkeypatch.setattr(progress.time, "perf_counter", lambda: clock[0])
    for seconds, lines in ((4, 0), (6, 1), (60, 6)):
        with progress.progress(1000) as report:
            report(500)
            for i in range(500):
                clock[0] += seconds / 500
                report(501 + i)
        err = capsys.readouterr().err
        assert err.count("\n") == lines and len(err) < 40 * lines + 1
        if lines:
            assert re.match(rf"jaxrt: \d+/1000 spp, {seconds - 5} s left\n", err)


def test_compiling_is_told_once_it_takes_long(monkeypatch, capsys):
    monkeypatch.setattr(progress, "COMPILING_SECONDS", 0.05)
    with progress.compiling():
        time.sleep(0.5)
    assert capsys.readouterr().err == "jaxrt: compiling\n"
    monkeypatch.setattr(progress, "COMPILING_SECONDS", 30)
    with progress.compiling():
        pass
    assert capsys.readouterr().err == ""


def test_progress_is_a_bar_on_a_terminal(monkeypatch, capsys):
    monkeypatch.setattr(progress.sys.stderr, "isatty", lambda: True, raising=False)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(progress, "FIRST_SECONDS", 0)
    with progress.progress(4) as report:
        for done in (0, 1, 4):
            report(done)
    assert "spp, " not in capsys.readouterr().err


def test_info_tells_what_is_in_a_scene(folder, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    status, out, err = run(capsys, "info", ROOT / "scenes" / "seed" / "glass_ball.toml")
    assert (status, err) == (0, "")
    for piece in (
        "7 spheres, 0 meshes, 0 triangles, 1 lights, 7 materials",
        "(0, 0, 55) to (0, 0, 0), up (0, 1, 0), fov 60°, 512x512",
        "spheres, diffuse, glass, point lights",
        "triangles, mirror, ",
        "sphere lights, environment",
        "albedo (0.4, 0.4, 0.8)",
        "ior 1.5",
        "(3000, 3000, 3000)",
        "warning: lights[0] is a point light and the scene has glass: no path can connect them",
    ):
        assert piece in out
    assert re.search(r"spheres\.center\W+\(7, 3\)", out) and re.search(r"camera\.fov\W+\(\)", out)


def test_long_tables_are_cut():
    table = summary._table("lights", ("", "b"), [("x", "[b]")] * 30)
    assert table.row_count == summary.ROWS + 1


def test_features_of_an_empty_scene():
    present, absent = summary.features(read_description(ROOT / "scenes" / "room.toml"))
    assert present == ["spheres", "diffuse", "mirror", "glass", "sphere lights"]
    others = {name for family in (MATERIALS, LIGHTS, CAMERAS) for name in family.kinds}  # of tests beside this one
    assert [name for name in absent if name.split()[0] not in others] == [
        "triangles",
        "point lights",
        "environment",
        "textures",
    ]


def test_info_tells_of_meshes(folder, capsys, monkeypatch):
    """Faces, vertices and what is dropped of each mesh; brute force or the tree's figures of them all."""
    monkeypatch.setenv("COLUMNS", "200")
    rows = ["0 0 0", "1 0 0", "1 1 0", "0 1 0"]
    (folder / "quad.obj").write_text("".join(f"v {row}\n" for row in rows) + "f 1 2 3 4\nf 1 1 2\n")
    mesh = "[[meshes]]\nfile = 'quad.obj'\nmaterial = 'white'\n"
    (folder / "quad.toml").write_text(BALL + mesh)
    status, out, _ = run(capsys, "info", "quad.toml")
    assert status == 0
    for piece in ("1 meshes, 0 triangles", "quad.obj │ 2     │ 4        │ 1", "brute force: every face is tested"):
        assert piece in out, piece
    assert "warning: meshes[0] (quad.obj): 1 of 3 faces have no area and are dropped, first 2" in out
    status, out, _ = run(capsys, "info", ROOT / "scenes" / "seed" / "mesh_in_room.toml")
    for piece in ("../cat.obj", "25672", "12826", "BVH: a tree of boxes", "build time", "nodes, leaves", "nodes, "):
        assert piece in out, piece


def test_help_tells_the_commands(capsys):
    with pytest.raises(SystemExit) as caught:
        cli.main(["--help"])
    assert caught.value.code == 0
    out = capsys.readouterr().out
    assert "render" in out and "info" in out and "diff" in out


def test_the_command_as_a_process(tmp_path):
    (tmp_path / "ball.toml").write_text(BALL)
    environment = os.environ | {"PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(tmp_path / "cache")}
    environment.pop("PYTHONWARNINGS", None)
    command = [sys.executable, "-m", "jaxrt", "render", "ball.toml", "--cores", "2"]
    pictures = set()
    for _ in range(2):
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        assert done.stdout.startswith("ball.png: 16x12, 2 spp")
        assert set(done.stderr.splitlines()) <= {"jaxrt: compiling"} and len(done.stderr) < 300
        assert load_image(tmp_path / "ball.png").shape == (12, 16, 3)
        pictures.add((tmp_path / "ball.png").read_bytes())
        # Damage (finding L2) is found before anything is loaded, and mended
        kept = [*(tmp_path / "cache/jaxrt").glob("*.program"), *(tmp_path / "cache/jaxrt/jax").iterdir()]
        assert len(kept) > 1
        for file in kept:
            content = bytearray(file.read_bytes())
            content[len(content) // 2] ^= 1
            file.write_bytes(content)
    assert len(pictures) == 1


@pytest.mark.parametrize("argv", [["--help"], ["render", "--help"], ["fit", "--help"], ["render", "--spp", "x", "a"]])
def test_help_and_typing_errors_load_nothing_large(argv: list[str]) -> None:
    code = (
        "import sys; from jaxrt.cli import main\n"
        f"try: status = main({argv!r})\nexcept SystemExit as end: status = end.code\n"
        "large = {'jax', 'numpy', 'trimesh', 'pydantic'} & sys.modules.keys()\n"
        "sys.exit(f'imported {large}' if large else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_the_package_shows_its_public_names_whatever_was_imported_before() -> None:
    code = "from jaxrt.render import prepare; import jaxrt.gradcheck, jaxrt\nprint(dir(jaxrt), jaxrt.render.__name__)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == f"{sorted([*jaxrt.__all__, '__version__'])} render\n"


def test_s5_the_package_says_its_version_and_that_it_has_types() -> None:
    about = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert jaxrt.__version__ == about["version"]
    assert f"version: {about['version']}\n" in (ROOT / "CITATION.cff").read_text()
    assert Path(jaxrt.__file__).with_name("py.typed").exists()
