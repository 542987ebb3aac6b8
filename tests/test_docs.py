"""Every command and snippet of README and docs runs, in a small size."""

import re
import runpy
import shlex
import tomllib
import warnings
from pathlib import Path
from typing import Any

import pytest

import jaxrt
from jaxrt.cli import main

ROOT = Path(__file__).parent.parent
COMMANDS = runpy.run_path(str(ROOT / "docs/draw_gallery.py"))["commands"]()
SMALL = ["--width", "16", "--height", "16", "--spp", "1", "--max-depth", "1"]


def blocks(page: str, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", (ROOT / page).read_text(), re.MULTILINE | re.DOTALL)


def test_readme_has_two_set_up_commands() -> None:
    install, test = (block.strip() for block in blocks("README.md", "sh"))
    assert "\n" not in install + test
    assert "jaxrt render scenes/room.toml" in install and "pytest" in test


def test_readme_snippet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    snippet, _ = blocks("README.md", "python")
    assert "spp=4" in snippet
    (tmp_path / "scenes").symlink_to(ROOT / "scenes")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(snippet.replace("spp=4", "spp=1"), names)
    assert (tmp_path / "room.exr").exists() and isinstance(names["brighter"], jaxrt.Scene)


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
    assert [re.sub("[0-9.]+|[+-]", "", line) for line in printed] == [
        re.sub("[0-9.]+|[+-]", "", line) for line in told.splitlines()
    ]
    assert abs(names["answer"].values["lights.intensity[0]"] - 250).max() < 5


def test_derivatives_snippet(monkeypatch: pytest.MonkeyPatch) -> None:
    (snippet,) = blocks("docs/derivatives.md", "python")
    monkeypatch.chdir(ROOT)
    names: dict[str, Any] = {}
    exec(snippet, names)
    # The target lies in the direction of the three axes
    assert names["loss"] > 0 and names["slope"]["lights.position"].sum() < 0


def test_compiling_snippet(monkeypatch: pytest.MonkeyPatch) -> None:
    (snippet,) = blocks("docs/compiling.md", "python")
    monkeypatch.chdir(ROOT)
    names: dict[str, Any] = {}
    exec(snippet, names)
    assert names["step"]._cache_size() == 1


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
    ):
        assert option in text


@pytest.mark.parametrize("arguments", COMMANDS, ids=lambda a: " ".join(a[1:]))
def test_gallery_command(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "docs/gallery").mkdir(parents=True)
    (tmp_path / "scenes").symlink_to(ROOT / "scenes")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert main(arguments + SMALL) == 0, capsys.readouterr().err
    assert Path(arguments[arguments.index("-o") + 1]).exists()


def test_gallery_shows_what_it_draws() -> None:
    text = (ROOT / "docs/gallery.md").read_text()
    for arguments in COMMANDS:
        picture = arguments[arguments.index("-o") + 1]
        assert f"({picture.removeprefix('docs/')})" in text and (ROOT / picture).exists(), picture


def test_scene_file_example() -> None:
    (example,) = blocks("docs/scene-format.md", "toml")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jaxrt.SceneWarning)
        scene = jaxrt.build(tomllib.loads(example))
    assert scene.camera.width == 512 and "materials.ior" in jaxrt.parameters(scene)


@pytest.mark.parametrize("command", ["render", "merge", "info", "diff"])
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
    (tmp_path / "scenes").symlink_to(ROOT / "scenes")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("jaxrt.cli.start.start_jax", lambda cores: None)
    for line in "".join(blocks("docs/command-line.md", "sh")).splitlines():
        small = ["--width", "16", "--height", "16", "--max-depth", "1"] if " render " in line else []
        assert main([*shlex.split(line)[1:], *small]) == 0, capsys.readouterr().err
    assert Path("room.exr").exists() and not Path("room.exr.partial").exists()


def test_links_lead_somewhere() -> None:
    for page in (page for folder in (".", "docs", "benchmarks", "examples") for page in (ROOT / folder).glob("*.md")):
        for link in re.findall(r"\]\(([^)#]+)\)", page.read_text()):
            assert link.startswith("https://") or (page.parent / link).exists(), f"{page.name}: {link}"
