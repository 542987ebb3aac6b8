"""A newcomer's first minutes: versions, help, examples, where results go, what is typed wrongly, plain terminals."""

import io
import os
import re
import subprocess
import sys
import tomllib
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from command import run, working_folder

import jaxrt
from jaxrt import cli
from jaxrt.cli.arguments import parser
from jaxrt.cli.streams import PLAIN, spelt
from jaxrt.core.examples import copy_of, examples
from jaxrt.io.image import save_image
from jaxrt.io.partial import Partial
from jaxrt.io.scene_file import read_description

ROOT = Path(__file__).parents[1]
COMMANDS = sorted(parser().commands)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """A working folder with a scene, a picture, a file of sums and a folder in it."""
    working_folder(tmp_path, monkeypatch)
    save_image("seen.exr", np.ones((12, 16, 3), np.float32))
    (tmp_path / "there").mkdir()
    Partial.nothing({"width": 3, "height": 2, "spp": 4}, 0).write(tmp_path / "sums.partial")
    return tmp_path


def refused(capsys, folder, *argv):
    """Return the one line of a refusal, having made sure that nothing was written."""
    before = {path: path.is_file() and path.read_bytes() for path in folder.rglob("*")}
    status, out, err = run(capsys, *argv)
    assert (status, out) == (2, ""), err
    assert err.startswith("jaxrt: error: ") and err.count("\n") == 1
    assert {path: path.is_file() and path.read_bytes() for path in folder.rglob("*")} == before
    return err.removeprefix("jaxrt: error: ").rstrip()


def process(*argv, **variables):
    """Return a finished process of the command line, and its output in bytes."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)} | variables
    return subprocess.run([sys.executable, "-m", "jaxrt", *argv], env=environment, capture_output=True)


# Versions and help


@pytest.mark.parametrize("flag", ["--version", "-V"])
def test_s8_the_versions_that_a_report_needs(capsys, flag):
    with pytest.raises(SystemExit) as end:
        cli.main([flag])
    assert end.value.code == 0
    python = ".".join(map(str, sys.version_info[:3]))
    jax = f"jax {version('jax')}, jaxlib {version('jaxlib')}"
    assert capsys.readouterr().out == f"jaxrt {version('jaxrt')} ({jax}, Python {python})\n"


def test_s8_help_versions_and_examples_load_nothing_large():
    """Of every command, in one process."""
    asked = [["--version"], ["--help"], ["example"], ["example", "room"], ["help", "fit"], ["redner", "a.toml"]]
    asked += [[command, "--help"] for command in COMMANDS]
    code = (
        "import sys; from jaxrt.cli import main\n"
        f"for argv in {asked!r}:\n    try: main(argv)\n    except SystemExit as end: assert end.code == 0\n"
        "large = {'jax', 'numpy', 'trimesh', 'pydantic', 'rich', 'PIL'} & sys.modules.keys()\n"
        "sys.exit(f'imported {large}' if large else 0)"
    )
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_help_needs_no_dashes(capsys):
    for argv in (["help"], ["help", "help"], ["--help"]):
        with pytest.raises(SystemExit) as end:
            cli.main(argv)
        assert end.value.code == 0 and "begin with:\n  jaxrt example room" in capsys.readouterr().out


@pytest.mark.parametrize("command", COMMANDS)
def test_help_says_what_each_command_does_with_an_example(capsys, command):
    for argv in ([command, "--help"], ["help", command]):
        with pytest.raises(SystemExit) as end:
            cli.main(argv)
        out = capsys.readouterr().out
        assert end.value.code == 0 and f"example:\n  jaxrt {command} " in out
        # Every option has words of its own
        assert not re.search(r"^  -[^ ]+( [A-Z]+)?(, --[^ ]+( [A-Z]+)?)?\n(  -|\n|$)", out, re.M)
    with pytest.raises(SystemExit):
        cli.main(["--help"])
    assert re.search(rf"^    {command} +\w", capsys.readouterr().out, re.M)


# Examples


@pytest.mark.parametrize("name", sorted(examples()))
def test_s6_every_example_is_written_with_its_files(capsys, name):
    """Into any folder, from where it is the same scene and loads; twice is as once."""
    for _ in range(2):
        status, out, err = run(capsys, "example", name, "-o", "there/mine.toml")
        assert (status, err) == (0, "") and out.startswith("there/mine.toml: written")
    written = tomllib.loads(Path("there/mine.toml").read_text())
    original = tomllib.loads(examples()[name].read_text())
    for mesh, mine in zip(original.get("meshes", []), written.get("meshes", []), strict=True):
        if "file" in mesh:
            assert Path("there", mine["file"]).read_bytes() == (examples()[name].parent / mesh["file"]).read_bytes()
            mesh["file"] = mine["file"]
    assert written == original
    # Whatever it names is there, and nothing else
    read_description("there/mine.toml")
    text = Path("there/mine.toml").read_text()
    assert all(path.name == "mine.toml" or f'"{path.name}"' in text for path in Path("there").iterdir())


def test_s6_an_example_is_a_scene_in_python_and_a_file_that_loads(capsys):
    assert run(capsys, "example", "room")[0] == run(capsys, "example", "mesh_in_room")[0] == 0
    mine, theirs = jaxrt.load_scene("room.toml"), jaxrt.example("room")
    for name, value in jaxrt.parameters(theirs).items():
        np.testing.assert_array_equal(jaxrt.parameters(mine)[name], value)
    # The mesh's file is found beside
    assert len(read_description("mesh_in_room.toml").meshes[0].faces) == 25672
    with pytest.raises(
        jaxrt.SceneError, match=r'^example "rom": there is none of this name \(did you mean "room"\?\)$'
    ):
        jaxrt.example("rom")


def test_s6_examples_are_in_the_package_and_listed(capsys):
    built = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["wheel"]
    assert built["force-include"] == {"scenes": "jaxrt/scenes"}
    assert set(examples().values()) == set((ROOT / "scenes").rglob("*.toml"))
    status, out, _ = run(capsys, "example")
    assert status == 0 and re.search(r"^room +The classic room: ", out, re.M)
    assert {line.split()[0] for line in out.split("\n\n")[0].splitlines()} == set(examples())


def test_s6_what_somebody_has_changed_is_not_replaced(folder, capsys):
    assert run(capsys, "example", "room")[0] == 0
    with open("room.toml", "a") as file:
        file.write("# mine\n")
    line = refused(capsys, folder, "example", "room")
    assert line == "room.toml: is there, and is not this example: choose another name with -o"
    (mesh,) = copy_of("mesh_in_room")[1]
    Path("there", mesh).write_text("# mine\n")
    assert refused(capsys, folder, "example", "mesh_in_room", "-o", "there/m.toml").startswith(
        f"there/{mesh}: is there"
    )


def test_s6_a_missing_scene_of_an_examples_name_is_told_of(folder, capsys):
    line = refused(capsys, folder, "render", "scenes/room.toml")
    assert line.endswith('the folder "scenes" does not exist, check the path, or write it: jaxrt example room')


# Where results go: one rule

WRITERS = {
    "example": (["example", "room"], ".toml"),
    "render": (["render", "ball.toml"], ".png"),
    "render --samples": (["render", "ball.toml", "--samples", "0:4", "--spp", "4"], ".partial"),
    "diff": (["diff", "seen.exr", "seen.exr"], ".png"),
    "merge": (["merge", "sums.partial"], ".exr"),
    "gradcheck": (["gradcheck", "ball.toml", "camera.fov"], ".png"),
    "fit": (["fit", "ball.toml", "seen.exr", "--parameters", "camera.fov"], ""),
}


def test_the_rule_is_tried_on_all_that_write():
    assert {name.split()[0] for name in WRITERS} == set(COMMANDS) - {"info"}


@pytest.mark.parametrize("command", WRITERS)
def test_s8_no_command_makes_folders_on_the_way(folder, capsys, command):
    argv, suffix = WRITERS[command]
    for place, told in (
        ("no", 'the folder "no" does not exist: make it first'),
        ("there/no", 'the folder "there/no" does not exist: make it first'),
        ("seen.exr", '"seen.exr" is a file, not a folder: choose another'),
    ):
        assert refused(capsys, folder, *argv, "-o", f"{place}/a{suffix}") == f"{place}/a{suffix}: {told}"


@pytest.mark.parametrize("command", WRITERS)
def test_s8_a_folder_is_no_file_and_a_file_no_folder(folder, capsys, command):
    argv, suffix = WRITERS[command]
    if command == "fit":
        told = "ball.toml: is a file, and the results are several: name a folder"
        assert refused(capsys, folder, *argv, "-o", "ball.toml") == told
        return
    named = f"there{suffix}" if command == "render --samples" else "there"
    (folder / named).mkdir(exist_ok=True)
    line = refused(capsys, folder, *argv, "-o", named)
    assert line.startswith(f"{named}: is a folder: name a file in it, such as {named}/")


@pytest.mark.parametrize("command", WRITERS)
def test_s8_a_folder_that_takes_nothing_is_refused_before_work(folder, capsys, monkeypatch, command):
    argv, suffix = WRITERS[command]
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    told = f'there/a{suffix}: the folder "there" is not writable: choose another'
    assert refused(capsys, folder, *argv, "-o", f"there/a{suffix}") == told


# What is typed

TYPED = [
    (["help", "rendr"], "invalid choice: 'rendr' (did you mean \"render\"?)"),
    (["--spp", "3", "render", "ball.toml"], "unrecognized arguments: --spp: options come after the command"),
    (["-v"], "unrecognized arguments: -v: options come after the command: see jaxrt --help"),
    (["render", "ball.toml", "-spp", "3"], "-spp 3 (did you mean --spp?): see jaxrt render --help"),
    (["render", "ball.toml", "--sp=3"], "--sp=3 (did you mean --spp?)"),
    (["render", "ball.toml", "--size", "9x9"], "--size 9x9 (did you mean --width and --height?)"),
    (["render", "ball.toml", "--threads", "2"], "--threads 2 (did you mean --cores?)"),
    (["render", "ball.toml", "-j", "2"], "-j 2 (did you mean --cores?)"),
    (["render", "ball.toml", "--samples-per-pixel", "2"], "--samples-per-pixel 2 (did you mean --spp?)"),
    (["render", "ball.toml", "--gpu"], "--gpu (did you mean the variable JAX_PLATFORMS?)"),
    (["render", "ball.toml", "--verbose"], "unrecognized arguments: --verbose: see"),
    (["render", "ball.toml", "--sampler", "SOBOL"], 'unknown sampler "SOBOL" (did you mean "sobol"?)'),
    (["gradcheck", "ball.toml", "albedo"], 'no such parameter (did you mean "materials.albedo"?)'),
    (["gradcheck", "ball.toml", "camera.fov", "--step", "x"], 'argument --step: "x" is not a number'),
    (["diff", "seen.exr", "there"], "there: is a folder: name a picture in it"),
    (["render", "ball.toml", "ball.png"], "ball.png (did you mean -o ball.png?)"),
    (["render", "ball.toml", "other.toml"], "unrecognized arguments: other.toml: see"),
    (["render", "ball.toml", "--samples", "64"], '"64" is no range: write FIRST:END, such as 0:512; --spp is how many'),
    (["render", "."], ".: is a folder: name a scene file in it"),
    (["info", "there"], "there: is a folder: name a scene file in it"),
    (["render", "ball"], 'ball: no such file (did you mean "ball.toml"?)'),
    (["render", "BALL.TOML"], 'BALL.TOML: no such file (did you mean "ball.toml"?)'),
    (["render", "seen.exr"], "seen.exr: is a picture, not a scene: name a scene file (.toml)"),
    (["info", "a.obj"], 'a.obj: is a mesh, not a scene: name it in a scene file (.toml), by [[meshes]] file = "a.obj"'),
    (["diff", "seen.exr", "sen.exr"], 'sen.exr: no such file (did you mean "seen.exr"?)'),
    (["merge", "seen.exr", "-o", "b.exr"], "seen.exr: holds no sums of samples"),
    (["gradcheck", "ball.toml"], "the following arguments are required: NAME[ROW]"),
    (["example", "-o", "a.toml"], "a.toml: of which example? name it, as in jaxrt example room -o a.toml"),
    (["example", "room", "-o", "a"], "a: a scene file ends in .toml: name it a.toml"),
    (["example", "room", "seen.exr"], "unrecognized arguments: seen.exr"),
]


@pytest.mark.parametrize(("argv", "told"), TYPED, ids=lambda value: " ".join(value) if isinstance(value, list) else "")
def test_s8_what_is_typed_wrongly_is_told_with_a_remedy(folder, capsys, argv, told):
    (folder / "a.obj").write_text("v 0 0 0\n")
    assert told in refused(capsys, folder, *argv)


def test_s8_more_cores_than_there_are_is_a_warning(monkeypatch, capsys):
    asked = []

    def painter(*arguments):
        asked.append(arguments[-1])
        raise KeyboardInterrupt

    monkeypatch.setattr("jaxrt.cli.start.usable_cores", lambda: 1)
    monkeypatch.setattr("jaxrt.cli.commands.render.painter", painter)
    status, _, err = run(capsys, "render", "ball.toml", "--cores", "999")
    assert (status, asked) == (130, [1])
    assert err.startswith("jaxrt: warning: --cores 999: this machine has 1, taking these\n")


# Terminals that lack characters, and readers that leave


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "utf-8", "cp437"])
def test_s8_every_encoding_prints_tables_that_are_straight(monkeypatch, encoding):
    stream = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    monkeypatch.setattr(sys, "stdout", stream)
    text = Path("ball.toml").read_text().replace("white", '"größe ✓"', 1).replace('"white"', '"größe ✓"')
    Path("ball.toml").write_text(text, encoding="utf-8")
    assert cli.main(["info", "ball.toml"]) == 0
    out = stream.buffer.getvalue().decode(encoding)
    tables = [block for block in re.split(r"\n(?=[^\W\d])", out) if block.count("\n") > 2]
    assert len(tables) >= 4 and "fov" in out and "gr" in out
    for table in tables:
        widths = {len(line) for line in table.splitlines()[1:] if line[0] not in "pw"}
        assert len(widths) == 1, table


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_s8_characters_of_jaxrts_own_have_plain_ones(encoding):
    shown = spelt("fov 60°, 1 ± 2, 9 spp … ✓ \udcb0", encoding)
    assert shown.encode(encoding).decode(encoding) == shown and "\\u2713" in shown and "..." in shown
    assert spelt("".join(PLAIN), "ascii").isascii() and "\\" not in spelt("".join(PLAIN), "ascii")


def test_s8_plain_terminals_and_readers_that_leave(folder):
    (folder / "sc°ne.toml").write_text("[cämera]\n", encoding="utf-8")
    for variables in (
        {"PYTHONIOENCODING": "ascii"},
        {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"},
        {"PYTHONIOENCODING": "latin-1:strict"},
    ):
        done = process("example", "r°m", **variables)
        assert done.returncode == 2 and b"Traceback" not in done.stderr and done.stderr.count(b"\n") == 1
    code = f"{sys.executable} -m jaxrt"
    for line in (
        f"{code} --help | head -c 5",
        f"{code} example >&-",
        f"{code} example 2>&- >/dev/full",
        f"{code} x 2>&-",
    ):
        done = subprocess.run(["bash", "-c", line], env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True)
        assert done.stderr == b"", line
