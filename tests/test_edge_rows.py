"""What finite differences the rows of moving edges are held against: as many keys as their noise wants."""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import jaxrt
from benchmarks import edge_pictures, edge_rows, edge_scenes, edges
from benchmarks.edge_rows import FD_FIRST, References, Result, measure
from benchmarks.edge_scenes import Row, box

ROW = Row("made up", "flat mirror", "camera.position", "x", bound=0.05, size=12)


@pytest.mark.parametrize(
    ("first", "others", "keys"), [(0.0, 0.0, 4), (0.07, 0.0, 12), (0.07, 0.07, 8)], ids=["short", "noise", "too long"]
)
def test_what_one_key_says_of_a_step_is_not_taken_for_true(
    monkeypatch: pytest.MonkeyPatch, first: float, others: float, keys: int
) -> None:
    """A step may be a fifth of the bound too long, .01. One key in four has one twice as long, off by thrice it.

    Where the first key alone is off, three are needed to tell, .07/9 < .01; where all are off alike, two tell so.
    """

    def difference(row: Row, step: float, key: int) -> np.ndarray:
        off = (first if key == FD_FIRST else others) if step > row.step else 0.0
        return np.full((row.size, row.size, 3), 1 + off)

    monkeypatch.setattr(edge_rows, "difference", difference)
    monkeypatch.setattr(References, "_interior", lambda self, row: np.zeros((1, row.size, row.size, 3)))
    assert len(References(None, 128).of(ROW).near) == keys


def measured(monkeypatch: pytest.MonkeyPatch, edges: float, inside: float, most: int) -> Result:
    """Return the figures of a derivative that is 1: .4 by edges, .6 inside of them, seeds off by so much."""

    def derivatives(row: Row, samples: int, spp: int = 64, first: int = 0) -> Iterator[np.ndarray]:
        for seed in range(first, 2**31):
            off = np.random.default_rng(seed).normal(size=2) * [edges, inside]
            sum(range(5_000 if samples else 500))  # the time that each takes
            yield np.full((row.size, row.size, 3), 0.6 + off[1] + (0.4 + off[0] if samples else 0))

    monkeypatch.setattr(edge_rows, "derivatives", derivatives)
    monkeypatch.setattr(edge_rows, "difference", lambda row, step, key: np.ones((row.size, row.size, 3)))
    return measure(ROW, References(None, 4), most)


def test_the_part_that_makes_the_noise_gets_the_seeds(monkeypatch: pytest.MonkeyPatch) -> None:
    """By 16,000 seeds of .5 at most: of the error, of which .05/3 may be noise, four standard errors."""
    found = measured(monkeypatch, edges=1e-3, inside=0.5, most=512)
    assert found.seeds[0] == ROW.seeds and found.seeds[1] >= 256 and found.word == "holds"
    assert found.noise <= ROW.bound / 3 and found.error < 4 * found.noise
    found = measured(monkeypatch, edges=0.1, inside=1e-3, most=512)
    assert found.seeds[1] == ROW.seeds and found.seeds[0] >= 16 and found.error < 4 * found.noise


def test_what_stays_noisy_is_called_so(monkeypatch: pytest.MonkeyPatch) -> None:
    found = measured(monkeypatch, edges=3.0, inside=3.0, most=8)
    assert found.seeds == (8, 8 * edge_rows.INSIDE) and found.word == "too noisy"


def test_sheets_of_pictures_are_drawn_whole_or_not_at_all(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Else some rows would take the place of a sheet that shows all of them."""
    command = ["edges", "--draw", str(tmp_path), "--rows", "half-sunk ball", "room of balls"]
    monkeypatch.setattr(edge_pictures, "_sheet", lambda path, results: path.touch())
    monkeypatch.setattr(edges, "measured", lambda chosen, references, seeds: [_measured(row) for row in chosen])
    monkeypatch.setattr(sys, "argv", command)
    assert edges.main() == 2
    assert "--draw: --rows leaves out some" in capsys.readouterr().err
    monkeypatch.setattr(sys, "argv", [*command, "two boxes that overlap"])
    assert edges.main() == 0
    assert [path.name for path in tmp_path.iterdir()] == ["edges-crossings.png"]


def _measured(row: Row) -> Result:
    one = np.ones((row.size, row.size, 3))
    return Result(row, 0, 0, (0, 0), 0, 0, 0, (1, 1), 1, 0, (one, one, one))


@pytest.mark.usefixtures("quick_compilation")
def test_a_pose_moves_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """A picture of all parameters of a turned scene would be turned again by its pose, beside its turned vertices."""
    posed = box("box", "red", [0, 0.5, 0], 0.5, [0, 20, 0]) | {"pose": True}
    lamp = {"position": [-2, 5, 4], "intensity": 40}
    monkeypatch.setitem(
        edge_scenes.SCENES, "posed", edge_scenes.scene(edge_scenes.CAMERA, meshes=[posed], lights=[lamp])
    )
    row = Row("made up", "posed", "meshes.rotate[box]", "y", bound=0.05, size=8, fd_spp=4)
    here, value = edge_scenes.built(row), np.float32([0, 2, 0])
    ahead, behind = (
        jaxrt.render(jaxrt.with_parameters(here, {row.parameter: sign * value}), 7, spp=4, max_depth=1)
        for sign in (1, -1)
    )
    wanted = np.asarray(ahead - behind) / 4
    assert np.abs(wanted).max() > 0
    np.testing.assert_allclose(edge_rows.difference(row, 2.0, 7), wanted, atol=1e-5)
