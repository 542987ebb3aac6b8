"""Every example runs, in its small setting, and leaves its figure."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
EXAMPLES = sorted(p for p in (ROOT / "examples").glob("*.py") if p.name != "figure.py")


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda p: p.stem)
def test_example(example: Path, tmp_path: Path) -> None:
    # Compiling is most of the time, and unoptimised programs give the same figures to the digits shown
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_backend_optimization_level=0"
    environment = os.environ | {"PYTHONPATH": str(ROOT), "XLA_FLAGS": flags}
    command = [sys.executable, str(example), "--quick", "--output", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert [p.name for p in tmp_path.iterdir()] == [f"{example.stem}.png"]


def test_examples_are_lessons() -> None:
    text = (ROOT / "examples/README.md").read_text()
    for example in EXAMPLES:
        assert len(example.read_text().splitlines()) <= 80, example
        assert f"({example.name})" in text, f"examples/README.md: name {example.name} in the reading order"
        assert (ROOT / f"docs/examples/{example.stem}.png").exists(), example
