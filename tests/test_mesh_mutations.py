"""Mutated mesh files in process: refused in one line, or read as before or as a second reader reads them."""

import logging
from collections import Counter

from benchmarks.fuzz.meshes import judge, mutations, prepare

COUNT = 800


def test_no_mutant_crashes_hangs_or_is_read_as_another_mesh(tmp_path, monkeypatch):
    monkeypatch.setattr(logging.getLogger("trimesh"), "disabled", True)
    prepare(tmp_path)
    verdicts = [(mutant.base, mutant.change, judge(mutant, tmp_path)) for mutant in mutations(7, COUNT)]
    counts = Counter(verdict.outcome for _, _, verdict in verdicts)
    bad = [row for row in verdicts if row[2].outcome in ("crash", "slow", "differs")]
    assert not bad
    # Not all is refused, and little is left without a second reader
    assert counts["as before"] + counts["as the second reader"] > COUNT / 8
    assert counts["read by nobody else"] < COUNT / 100
    # The same seed gives the same files
    again = mutations(7, 5)
    assert [mutant.base for mutant in again] == [base for base, _, _ in verdicts[:5]]
