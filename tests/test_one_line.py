"""Whatever ends a command, or stands where a scene is wanted, is one line and an exit status."""

import io
import os
import re
import subprocess
import sys
from pathlib import Path

import jax
import pytest
from command import BALL, run, working_folder

import jaxrt
from jaxrt.cli import main, start
from jaxrt.core.messages import SceneError
from jaxrt.render import render_sum


def test_l7_jax_without_a_device_is_one_line(tmp_path, monkeypatch, capsys):
    working_folder(tmp_path, monkeypatch)
    for error in (RuntimeError("Unable to initialize backend 'tpu'\nand so on"), AssertionError()):

        def refuse(*_, error=error):
            raise error

        monkeypatch.setattr(jax, "devices", refuse)
        for command in (("info",), ("render",), ("gradcheck",), ("fit",)):
            more = {"gradcheck": ["camera.fov"], "fit": ["x.exr", "--parameters", "camera.fov"]}.get(command[0], [])
            status, out, err = run(capsys, *command, "ball.toml", *more)
            assert (status, out, err.count("\n")) == (2, "", 1)
            assert re.search(r"JAX finds no device \(.+\): unset JAX_PLATFORMS, or install JAX for that device", err)


def test_l7_jax_platforms_of_another_machine(tmp_path):
    (tmp_path / "ball.toml").write_text(BALL)
    command = [sys.executable, "-m", "jaxrt", "info", str(tmp_path / "ball.toml")]
    told = subprocess.run(
        command, env={**os.environ, "JAX_PLATFORMS": "nowhere"}, capture_output=True, text=True, timeout=300
    )
    assert (told.returncode, told.stdout, told.stderr.count("\n")) == (2, "", 1)


@pytest.mark.parametrize(
    ("error", "status", "line"),
    [
        (MemoryError(), 2, "memory: there is not enough of it: lower width and height, or the number of faces"),
        (RuntimeError("RESOURCE_EXHAUSTED: Out of memory\nallocating"), 2, "memory: there is not enough of it"),
        (RecursionError(), 2, "the scene is nested too deeply: flatten it"),
        (PermissionError(13, "Permission denied", "a/b"), 2, "a/b: Permission denied: choose another file"),
        (OSError(27, "File too large"), 2, "File too large: choose another file"),
        (ZeroDivisionError("a\nb\x1b"), 70, "internal error: ZeroDivisionError: a\\nb\\x1b: please report it, with"),
    ],
)
def test_l7_whatever_ends_a_command_is_one_line(tmp_path, monkeypatch, capsys, error, status, line):
    working_folder(tmp_path, monkeypatch)

    def fail(*arguments):
        raise error

    monkeypatch.setattr("jaxrt.cli.commands.info.read_description", fail)
    found, out, err = run(capsys, "info", "ball.toml")
    assert (found, out) == (status, "") and err.startswith(f"jaxrt: error: {line}") and err.count("\n") == 1
    monkeypatch.setenv("JAXRT_TRACEBACK", "1")
    assert "Traceback (most recent call last)" in run(capsys, "info", "ball.toml")[2]


def test_s8_folders_for_a_scene(tmp_path, monkeypatch, capsys):
    working_folder(tmp_path, monkeypatch)
    for name in (".", "..", "/"):
        for command in ("render", "info"):
            status, out, err = run(capsys, command, name)
            assert (status, out, err) == (2, "", f"jaxrt: error: {name}: is a folder: name a scene file in it\n")
    assert [path.name for path in tmp_path.iterdir()] == ["ball.toml"]


def test_s8_more_cores_than_there_are(monkeypatch, capsys):
    given = []
    monkeypatch.setattr(start, "use_cpu_cores", given.append)
    monkeypatch.setattr(start, "usable_cores", lambda: 4)
    assert [start.present(n) for n in (1, 4, 999)] == [1, 4, 4]
    assert capsys.readouterr().err == "jaxrt: warning: --cores 999: this machine has 4, taking these\n"


def test_s8_characters_that_the_terminal_lacks_are_escaped(tmp_path, monkeypatch):
    working_folder(tmp_path, monkeypatch)
    Path("ball.toml").rename("bäll\udcff.toml")
    page = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    monkeypatch.setattr(sys, "stdout", page)
    assert main(["info", "bäll\udcff.toml"]) == 0
    page.flush()
    assert b"b\\xe4ll\\udcff.toml" in page.buffer.getvalue() and b"fov 60 deg, " in page.buffer.getvalue()


def test_s8_names_neither_draw_on_the_terminal_nor_break_lines(tmp_path, monkeypatch, capsys):
    name = '"\\u001b[2J[red]x\\n\\u202ey"'
    text = (
        BALL.replace("materials.white", f"materials.{name}")
        .replace('"white"', name)
        .replace("radius   = 10", "radius = 31")
    )
    working_folder(tmp_path, monkeypatch, text)
    monkeypatch.setenv("COLUMNS", "200")
    status, out, _ = run(capsys, "info", "ball.toml")
    assert status == 0 and out.count("\\x1b[2J[red]x\\n\\u202ey") == 3 and "warning: lights[0] is " in out
    assert out.replace("\n", "").isprintable()
    start.warn("a\nb\x1b[31m")
    assert capsys.readouterr().err == "jaxrt: warning: a\\nb\\x1b[31m\n"


def test_s9_what_is_no_scene_is_refused_in_one_line():
    for use in (
        lambda x: jaxrt.render(x, 0),
        jaxrt.parameters,
        lambda x: jaxrt.with_parameters(x, {}),
        jaxrt.build,
    ):
        with pytest.raises(SceneError, match=r'"a\.toml" .*jaxrt\.load_scene') as told:
            use("a.toml")
        assert isinstance(told.value, TypeError) and str(told.value).isprintable()
    with pytest.raises(TypeError, match=r"scene: \{'camera': 1\} is no Scene: pass what jaxrt\.build returns"):
        jaxrt.render({"camera": 1}, 0)
    with pytest.raises(SceneError, match="is no Scene"):
        render_sum("a.toml", 0, 0, 1, spp=1)
