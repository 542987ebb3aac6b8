"""What finite differences the rows of moving edges are held against: as many keys as their noise wants."""

import numpy as np
import pytest

from benchmarks import edge_rows
from benchmarks.edge_rows import FD_FIRST, References
from benchmarks.edge_scenes import Row

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
