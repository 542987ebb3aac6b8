"""Every example runs, in its small setting, and leaves its figure."""

import runpy
import sys
from pathlib import Path

import jax
import pytest

ROOT = Path(__file__).parent.parent
EXAMPLES = sorted(p for p in (ROOT / "examples").glob("*.py") if p.name != "figure.py")
SLOW = {"fit_camera", "fit_pose", "fit_sphere_light", "fit_texture", "mesh_scene"}


@pytest.mark.usefixtures("quick_compilation")
@pytest.mark.parametrize(
    "example",
    [pytest.param(p, marks=pytest.mark.slow if p.stem in SLOW else (), id=p.stem) for p in EXAMPLES],
)
def test_example(example: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In this process, which has loaded JAX already; as `python examples/NAME.py` finds its folder and its scenes."""
    monkeypatch.syspath_prepend(example.parent)
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(sys, "argv", [str(example), "--quick", "--output", str(tmp_path)])
    with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):  # as outside of tests
        runpy.run_path(str(example), run_name="__main__")
    assert [p.name for p in tmp_path.iterdir()] == [f"{example.stem}.png"]


def test_examples_are_lessons() -> None:
    text = (ROOT / "examples/README.md").read_text()
    for example in EXAMPLES:
        assert len(example.read_text().splitlines()) <= 80, example
        assert f"({example.name})" in text, f"examples/README.md: name {example.name} in the reading order"
        assert (ROOT / f"docs/examples/{example.stem}.png").exists(), example
