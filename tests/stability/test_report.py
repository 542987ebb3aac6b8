"""The page of the stability report: it lists every case that tests state, and tells failures as such."""

import ast
import re
from pathlib import Path

import pytest

from tests.stability.report import COMMAND, FIGURES, GROUPS, Report, Row, stating
from tests.stability.test_twin import SCENES

ROOT = Path(__file__).parent.parent.parent
PAGE = ROOT / "docs/stability.md"
SOURCES = sorted((ROOT / "tests").rglob("test_*.py"))
OWN = Path(__file__)
STARRED = "X1 X2 X3 S1 S2 S3 T1 T2 B1 E1 L1 L2 L3 L4 M1 R1 R2 A1 A2 A3 A4 A5 A6 O1 I1a I1b I1c".split()


def calls(path: Path) -> list[ast.Call]:
    """Return the calls of a test file that state figures."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return [n for n in ast.walk(tree) if isinstance(n, ast.Call) and ast.unparse(n.func) == "figures"]


def stated() -> dict[str, set[str]]:
    """Return the cases that tests state, and what each is said to be; words that are no literal are not in it."""
    cases: dict[str, set[str]] = {}
    for call in (call for path in SOURCES if path != OWN for call in calls(path)):
        case, what = call.args[:2]
        assert isinstance(case, ast.Constant), f"{ast.unparse(call)}: name the case itself"
        words = {what.value} if isinstance(what, ast.Constant) else set()
        cases[case.value] = cases.get(case.value, set()) | words
    return cases


def listed() -> list[list[str]]:
    """Return the cells of the page's rows of cases."""
    rows = [line.strip("|").split("|") for line in PAGE.read_text(encoding="utf-8").splitlines() if line[:2] == "| "]
    rows = [[cell.strip() for cell in row] for row in rows]
    return [row for row in rows if re.fullmatch(r"[A-Z]\d+[abc]?", row[0])]


def test_the_page_lists_every_case_and_no_other() -> None:
    told = f"docs/stability.md: run {COMMAND}"
    rows, cases = listed(), stated()
    assert {row[0] for row in rows} == set(cases), told
    words = {row[1] for row in rows}
    assert set().union(*cases.values()) <= words, told
    constants = {
        n.value
        for path in SOURCES
        for n in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(n, ast.Constant) and isinstance(n.value, str)
    }
    assert words <= constants, told


def test_the_page_is_of_a_whole_run_that_passed() -> None:
    rows, text = listed(), PAGE.read_text(encoding="utf-8")
    assert all(len(row) == 6 and row[5] in ("yes", "xfail") for row in rows)
    assert set(STARRED) <= {row[0] for row in rows} and len({row[0] for row in rows}) >= 60
    assert all(f"\n## {letter}: " in text for letter in GROUPS)
    assert all(f"| {scene} |" in text for scene in SCENES)


@pytest.mark.parametrize("path", [p for p in SOURCES if p.parent == OWN.parent and p != OWN], ids=lambda p: p.name)
def test_cases_named_by_tests_state_figures(path: Path) -> None:
    names = set(re.findall(r"^def test_([a-z]\d+[abc]?)_", path.read_text(encoding="utf-8"), re.MULTILINE))
    assert {name.capitalize() for name in names} <= set(stated())


def run_of(tmp_path: Path, *tests: tuple[str, str, list[Row], bool]) -> str:
    """Return the page of a run of tests (name, outcome, rows, whether a failure is expected)."""
    report = Report(tmp_path / "page.md")
    for name, outcome, rows, expected in tests:
        told = pytest.TestReport(f"test_a.py::{name}", ("", 0, ""), {}, outcome, None, "call")
        told.user_properties = [(FIGURES, vars(row)) for row in rows]
        if expected:
            told.wasxfail = "known"
        report.pytest_runtest_logreport(told)
    return report.page()


def test_failures_are_told(tmp_path: Path) -> None:
    good, bad = (Row("A1", "slope", 2.0, x, 1.0, False) for x in (0.5, 3.0))
    assert "| A1 | slope | 2 | 0.5 | ≤ 1 | yes |" in run_of(tmp_path, ("test_a1_x", "passed", [good], False))
    both = run_of(tmp_path, ("test_a1_x[1]", "passed", [good], False), ("test_a1_x[2]", "failed", [bad], False))
    assert "| A1 | slope | 2 | 3 | ≤ 1 | **no** |" in both and both.count("| A1 |") == 1
    assert "| 3 | ≤ 1 | xfail |" in run_of(tmp_path, ("test_a1_x", "skipped", [bad], True))
    assert "| A1 | `test_a1_x` | | | | **no** |" in run_of(tmp_path, ("test_a1_x", "failed", [], False))
    assert "| **no** |" in run_of(tmp_path, ("test_a1_x", "failed", [good], False))


def test_figures_are_asserted() -> None:
    state = stating(lambda *_: None)
    with pytest.raises(AssertionError, match="A1: slope: 2, limit 1"):
        state("A1", "slope", ours=[0.5, 2.0], at_most=1)
    with pytest.raises(AssertionError, match="naive 0.5 keeps 1"):
        state("A1", "slope", ours=0.5, naive=0.5, at_most=1)
    with pytest.raises(AssertionError, match="A1: slope: nan"):
        state("A1", "slope", ours=float("nan"), at_least=1)
