"""Every command and snippet of README and docs runs, in a small size."""

import re
import runpy
import shlex
import tomllib
import warnings
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import jaxrt
from benchmarks.choices import lights, spheres, triangles
from benchmarks.edge_pictures import SHEETS, size_of
from benchmarks.edge_scenes import rows
from jaxrt.boundary import caustics, lines, outlines, shadows
from jaxrt.cli import main
from jaxrt.core.system import usable_cores
from jaxrt.description import fields
from jaxrt.description.kinds import CAMERAS, LIGHTS, MATERIALS
from jaxrt.description.values import Measure

# What pages show is drawn small here: compiling is most of the time
pytestmark = pytest.mark.usefixtures("quick_compilation")
ROOT = Path(__file__).parent.parent
COMMANDS = runpy.run_path(str(ROOT / "docs/draw_gallery.py"))["commands"]()
SMALL = ["--width", "16", "--height", "16", "--spp", "1", "--max-depth", "1"]


def blocks(page: str, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", (ROOT / page).read_text(), re.MULTILINE | re.DOTALL)


def test_readme_has_two_set_up_commands() -> None:
    install, test = (block.strip() for block in blocks("README.md", "sh"))
    assert "\n" not in install + test
    assert "jaxrt example room -o room.toml" in install and "jaxrt render room.toml" in install and "pytest" in test


def test_s6_readme_shows_what_its_line_draws_and_tells_its_samples() -> None:
    """That the picture is the line's is tried by .ci/run, which draws it."""
    install, _ = blocks("README.md", "sh")
    before = (ROOT / "README.md").read_text().split("```sh")[0]
    (spp,) = re.findall(r"--spp (\d+)", install)
    assert "(docs/room.png)" in before and f"{spp} samples a pixel" in before
    with Image.open(ROOT / "docs/room.png") as picture:
        camera = jaxrt.example("room").camera
        assert picture.size == (camera.width, camera.height)


@pytest.fixture
def fresh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Let a snippet set up JAX as in a process of its own; return what it has set."""
    set_up: list[Any] = []
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr("jaxrt.programs.keep._kept", [])
    monkeypatch.setattr("jaxrt.programs.keep.lend_jax_files", set_up.append)
    monkeypatch.setattr("jaxrt.programs.keep.gc.freeze", lambda: None)
    monkeypatch.setattr("jaxrt.programs.keep.gc.set_threshold", lambda *counts: None)
    monkeypatch.setattr("jax.config.update", lambda name, value: set_up.append((name, value)))
    return set_up


def test_readme_snippet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fresh: list[Any]) -> None:
    snippet, _ = blocks("README.md", "python")
    assert "spp=4" in snippet
    (tmp_path / "scenes").symlink_to(ROOT / "scenes")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(snippet.replace("spp=4", "spp=1"), names)
    assert (tmp_path / "room.exr").exists() and isinstance(names["brighter"], jaxrt.Scene)
    assert jaxrt.parameters(names["redder"])["materials.albedo"][6].tolist() == pytest.approx([0.8, 0.2, 0.2])
    assert fresh == [("jax_num_cpu_devices", usable_cores()), tmp_path / "cache/jaxrt"]


def test_readme_fit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """In at most 8 lines; in a small size, and the same in the guide."""
    _, snippet = blocks("README.md", "python")
    assert len(snippet.splitlines()) <= 8 and snippet in blocks("docs/inverse.md", "python")
    (tmp_path / "scenes").mkdir()
    text = (ROOT / "scenes/ball_on_floor.toml").read_text().replace("= 64", "= 32")
    (tmp_path / "scenes/ball_on_floor.toml").write_text(text)
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    exec(snippet, names)
    printed, (told,) = capsys.readouterr().out.splitlines(), blocks("README.md", "text")
    assert [re.sub("[0-9.]+(e-[0-9]+)?|[+-]", "", line) for line in printed] == [
        re.sub("[0-9.]+(e-[0-9]+)?|[+-]", "", line) for line in told.splitlines()
    ]
    assert abs(names["answer"].values["lights.intensity[0]"] - 250).max() < 5


def test_derivatives_snippet(monkeypatch: pytest.MonkeyPatch) -> None:
    (snippet,) = blocks("docs/derivatives.md", "python")
    monkeypatch.chdir(ROOT)
    names: dict[str, Any] = {}
    exec(snippet, names)
    # The target lies in the direction of the three axes
    assert names["loss"] > 0 and names["slope"]["lights.position"].sum() < 0


def test_derivatives_page_tells_how_many_samples_each_kind_of_edge_has() -> None:
    page = " ".join((ROOT / "docs/derivatives.md").read_text().split())
    for told in (
        f"n/{outlines.SHARE} for outlines that surfaces see by scattered rays and n/{lines.SHARE} for those that are",
        f"n/{shadows.LIGHTS_ONLY} for shadows if a light has a size, n/{caustics.LIGHTS_ONLY} for caustics,",
        f"n/{outlines.LIGHTS_ONLY} for outlines and n/{lines.LIGHTS_ONLY} for lines. Of lines there are at least "
        f"{lines.LEAST}, or n.",
    ):
        assert told in page


def test_derivatives_page_shows_rows_of_the_benchmark() -> None:
    page, known = (ROOT / "docs/derivatives.md").read_text(), [row.name for row in rows()]
    for sheet, names in SHEETS.items():
        assert f"({sheet}.png)" in page and set(names) <= set(known)
        with Image.open(ROOT / f"docs/{sheet}.png") as picture:
            assert picture.size == size_of(len(names))  # all of them are drawn


@pytest.mark.parametrize("choice", [lights, spheres, triangles], ids=lambda choice: choice.NAME)
def test_design_choices_are_made_against_what_takes_the_same(choice: Any) -> None:
    for module, name, other in (swap for swaps in choice.SWAPS.values() for swap in swaps):
        assert [*signature(getattr(module, name)).parameters] == [*signature(other).parameters]


def test_compiling_snippet(monkeypatch: pytest.MonkeyPatch) -> None:
    _, snippet = blocks("docs/compiling.md", "python")
    monkeypatch.chdir(ROOT)
    names: dict[str, Any] = {}
    exec(snippet, names)
    assert names["step"]._cache_size() == 1


def test_own_kinds_snippet() -> None:
    snippets = blocks("docs/own-kinds.md", "python")
    names: dict[str, Any] = {"__name__": "notebook"}
    try:
        for snippet in snippets:
            exec(snippet, names)
        assert float(names["slope"](jaxrt.parameters(names["scene"])["materials.fuzz"])[0]) > 0
    finally:
        for family, name in ((MATERIALS, "velvet"), (LIGHTS, "spotlight"), (CAMERAS, "plan")):
            family.kinds.pop(name, None)


def test_cameras_snippets(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    names: dict[str, Any] = {}
    for snippet in blocks("docs/cameras.md", "python"):
        exec(snippet, names)
    assert float(jaxrt.parameters(names["tilted"])["camera.roll"]) == 10


def test_cameras_page_shows_every_kind() -> None:
    drawn = runpy.run_path(str(ROOT / "docs/draw_cameras.py"))
    assert {camera["type"] for camera in drawn["KINDS"].values()} == {
        kind.name for kind in CAMERAS.kinds.values() if kind.place.startswith("jaxrt.")
    }
    for camera in drawn["KINDS"].values():
        jaxrt.build(drawn["described"](camera))
    assert "(cameras.png)" in (ROOT / "docs/cameras.md").read_text() and (ROOT / "docs/cameras.png").exists()


def test_pages_tell_of_every_kind_and_field() -> None:
    scene_file, own = (ROOT / "docs/scene-format.md").read_text(), (ROOT / "docs/own-kinds.md").read_text()
    for kind in (kind for family in (MATERIALS, LIGHTS, CAMERAS) for kind in family.kinds.values()):
        if kind.place.startswith("jaxrt."):
            for word in (f'"{kind.name}"', *kind.measures, *kind.settings):
                assert word in scene_file, f"docs/scene-format.md: tell of {kind.name}: {word}"
    measured = [
        name
        for name, field in vars(fields).items()
        if any(isinstance(of, Measure) for of in getattr(field, "__metadata__", ()))
    ]
    assert len(measured) >= 12
    for name in measured:
        assert f"`{name}`" in own, f"docs/own-kinds.md: tell of {name}"


def test_set_up_snippet(tmp_path: Path, fresh: list[Any]) -> None:
    snippet, _ = blocks("docs/compiling.md", "python")
    exec(snippet, {})
    assert fresh == [("jax_num_cpu_devices", usable_cores()), tmp_path / "cache/jaxrt"]


def test_readme_names_every_option() -> None:
    text = (ROOT / "README.md").read_text()
    for option in (
        "-o",
        *SMALL[::2],
        "--seed",
        "--sampler",
        "--cores",
        "--exposure",
        "--srgb",
        "--resume",
        "--samples",
        "--hosts",
        "--outputs",
        "--camera",
    ):
        assert option in text


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache for the commands of the gallery, of which some draw by one program."""
    return tmp_path_factory.mktemp("cache")


@pytest.mark.parametrize("arguments", COMMANDS, ids=lambda a: " ".join(a[1:]))
def test_gallery_command(
    arguments: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    kept: Path,
) -> None:
    (tmp_path / "docs/gallery").mkdir(parents=True)
    (tmp_path / "scenes").symlink_to(ROOT / "scenes")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(kept))
    assert main(arguments + SMALL) == 0, capsys.readouterr().err
    assert Path(arguments[arguments.index("-o") + 1]).exists()


def test_gallery_shows_what_it_draws() -> None:
    text = (ROOT / "docs/gallery.md").read_text()
    for arguments in COMMANDS:
        picture = arguments[arguments.index("-o") + 1]
        assert f"({picture.removeprefix('docs/')})" in text and (ROOT / picture).exists(), picture


def test_scene_file_example() -> None:
    example, _ = blocks("docs/scene-format.md", "toml")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jaxrt.SceneWarning)
        scene = jaxrt.build(tomllib.loads(example))
    assert scene.camera.width == 512 and "materials.ior" in jaxrt.parameters(scene)


def test_scene_file_textures(tmp_path: Path) -> None:
    """Of those that the page shows, the ball takes one; the others are told to be unused."""
    _, example = blocks("docs/scene-format.md", "toml")
    Image.new("RGB", (3, 2)).save(tmp_path / "wood.png")
    ball = '[camera]\nposition = [0, 0, 9]\n[[spheres]]\ncenter = [0, 0, 0]\nradius = 1\nmaterial = "table"\n'
    (tmp_path / "scene.toml").write_text(example + ball + "[environment]\nradiance = [1, 1, 1]\n")
    with pytest.warns(jaxrt.SceneWarning, match="is used by nothing"):
        scene = jaxrt.load_scene(tmp_path / "scene.toml")
    assert jaxrt.parameters(scene)["textures.wood"].shape == (2, 3, 3)


@pytest.mark.parametrize("command", ["example", "render", "merge", "info", "diff"])
def test_help_runs(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main([command, "--help"])
    assert stop.value.code == 0 and command in capsys.readouterr().out


def test_inverse_guide(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    (commands,), (_, snippet) = blocks("docs/inverse.md", "sh"), blocks("docs/inverse.md", "python")
    (tmp_path / "scenes").mkdir()
    text = (ROOT / "scenes/ball_on_floor.toml").read_text().replace("= 64", "= 16")
    (tmp_path / "scenes/ball_on_floor.toml").write_text(text)
    (tmp_path / "guess.toml").write_text(text.replace("[4, 9, 3]", "[3, 8, 2]"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("jaxrt.cli.start.start_jax", lambda cores: None)
    render, fit = (shlex.split(line)[1:] for line in commands.splitlines())
    assert main(render) == 0
    assert main([*fit, "--spp", "4", "--max-steps", "6"]) in (0, 1), capsys.readouterr().err
    assert {p.name for p in Path("result").iterdir()} == {"fitted.toml", "fit.json", "loss.png", "before_after.png"}
    names: dict[str, Any] = {}
    exec(snippet.replace("16384", "1024"), names)
    assert float(abs(names["solution"].value - jaxrt.parameters(names["scene"])["lights.position"]).max()) < 0.5


def test_command_line_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Its commands in their order, in a small size; ranges and --spp as they stand."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("jaxrt.cli.start.start_jax", lambda cores: None)
    for line in "".join(blocks("docs/command-line.md", "sh")).splitlines():
        small = ["--width", "16", "--height", "16", "--max-depth", "1"] if " render " in line else []
        assert main([*shlex.split(line)[1:], *small]) == 0, capsys.readouterr().err
    assert Path("room.exr").exists() and not Path("room.exr.partial").exists()


def test_hosts_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its command starts what it should; its snippet, on the one host that there is."""
    started: list[Any] = []
    monkeypatch.setattr("jaxrt.cli.together.launch", lambda hosts, words: started.append((hosts, words)) or 0)
    (command,) = blocks("docs/hosts.md", "sh")
    assert main(shlex.split(command)[1:]) == 0
    assert started == [(["localhost", "localhost"], ["render", "room.toml", "-o", "room.exr"])]
    (snippet,) = blocks("docs/hosts.md", "python")
    monkeypatch.setattr("jax.distributed.initialize", lambda heartbeat_timeout_seconds: None)
    monkeypatch.setattr("jaxrt.use_cpu_cores", lambda: None)
    monkeypatch.setattr("jaxrt.render", lambda scene, key: scene.camera.width)
    names: dict[str, Any] = {}
    exec(snippet, names)
    assert names["picture"] == 256


def test_outputs_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Its command writes layers that are read back; its snippets draw the same, filtered, and two frames."""
    (tmp_path / "docs").mkdir()
    text = (ROOT / "docs/outputs.toml").read_text().replace("= 160", "= 16").replace("= 128", "= 8")
    (tmp_path / "docs/outputs.toml").write_text(text.replace("max_depth = 4", "max_depth = 1"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("jaxrt.cli.start.start_jax", lambda cores: None)
    ((command,), (first, smooth, frames)) = blocks("docs/outputs.md", "sh"), blocks("docs/outputs.md", "python")
    assert main([*shlex.split(command)[1:], "--spp", "4"]) == 0, capsys.readouterr().err
    layers = {name: jaxrt.load_image("balls.exr", layer=name) for name in ("depth", "normal", "alpha")}
    picture = jaxrt.load_image("balls.exr")
    names: dict[str, Any] = {}
    exec(first, names)
    for name, layer in layers.items():
        np.testing.assert_allclose(layer, names["found"][name], atol=2e-5)
    np.testing.assert_allclose(picture, names["found"]["foreground"], rtol=1e-5, atol=1e-6)
    np.testing.assert_array_equal(names["depth"], names["found"]["depth"])
    exec(smooth, names)
    assert names["smooth"].shape == (8, 16, 3)
    exec(frames, names)
    assert names["frames"].shape == (2, 8, 16, 3)


def test_links_lead_somewhere() -> None:
    for page in (page for folder in (".", "docs", "benchmarks", "examples") for page in (ROOT / folder).glob("*.md")):
        for link in re.findall(r"\]\(([^)#]+)\)", page.read_text()):
            assert link.startswith("https://") or (page.parent / link).exists(), f"{page.name}: {link}"


def test_s8_citations_name_the_version() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    citation = (ROOT / "CITATION.cff").read_text().splitlines()
    assert f"version: {project['version']}" in citation and f"license: {project['license']}" in citation
