"""The stability report: each test states its figures, and a run with --stability-report writes them to a page.

A pytest plugin. Figures travel as user properties of the tests' reports, so that they arrive from the workers of
pytest-xdist too. A test that only the page wants is marked `report`; other runs leave it out.
"""

import platform
import re
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from datetime import date
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.processes import cpu_model

FIGURES, TWIN = "stability figures", "stability twin"
COMMAND = "python -m pytest -n 2 --stability-report=docs/stability.md"
GROUPS = {
    "X": ("The platform", "What a compiler, a gather, a flag or an index may do to a renderer."),
    "S": ("Rays and spheres", "Far, huge, touching and impossible spheres."),
    "T": ("Rays and triangles", "Edges, vertices, slivers, faces without area, scenes far from the origin."),
    "B": ("The tree of a mesh", "Its search must find what a test of every face finds."),
    "E": ("Leaving a surface", "A ray must not hit again what it leaves, nor skip what is near."),
    "L": ("Lights", "Lights that are small, near, touching, dark or behind glass."),
    "F": ("Frames and sample maps", "Frames at the poles, and the ends of the interval of random numbers."),
    "M": ("Glass and long paths", "Fresnel's equations, nested glass, paths that do not end, large values."),
    "R": ("Random numbers and sums", "Streams that must not be related, and sums that must not stop growing."),
    "A": ("Derivatives", "Where automatic differentiation gives no number, the wrong one, or a biased one."),
    "O": ("Fits", "What goes wrong when parameters are sought, and whether the verdict says so."),
    "I": ("Input", "Bad and unusual files: read rightly, or refused in one line."),
}
HEAD = """\
# Where methods fail

Each row is a case in which a usual method of rendering, differentiation, fitting or reading fails. *Naive* is that
method's figure, measured in the same test, which asserts that it misses the limit: so the test is known to bite. *Ours*
is jaxrt's, asserted to keep the limit. A dash means that there is no naive method to compare with; words stand for what
cannot be run here; nan is no number, inf beyond all. Of a case with several settings the worst figures are shown.
*xfail* is a known failure: asserted to be one, so that the row changes when it goes away.

This page is written by a run of the tests, of those that state figures:

```sh
{command}
```

{count} cases, {rows} rows. Run on {date} with {versions}, on {machine}.
"""
TWIN_HEAD = """
## Float64 twin

Every scene in `scenes/`, drawn in float32 and in float64 with the same random numbers, at the scene's own depth.
*Off* counts the pixels that differ by more than 1e-3 of the picture's mean; *largest* is the largest difference.

| scene | pixels × samples | off | median | largest | limit | pass | why |
|---|---|---|---|---|---|---|---|
"""


@dataclass(frozen=True)
class Row:
    """One case's figures. A figure keeps the limit when it is <= `limit`, or >= where `least`."""

    case: str
    what: str
    naive: float | str | None
    ours: float
    limit: float
    least: bool

    def keeps(self, figure: float) -> bool:
        return figure >= self.limit if self.least else figure <= self.limit

    def merged(self, other: "Row") -> "Row":
        """Return the row with the worse figures of two."""
        naives = [x for x in (self.naive, other.naive) if x is not None]
        numbers = all(isinstance(x, float) for x in naives)
        naive = worst(naives, self.least) if naives and numbers else next(iter(naives), None)
        return Row(self.case, self.what, naive, worst([self.ours, other.ours], self.least), self.limit, self.least)


def worst(values: Any, least: bool) -> float:
    """Return the smallest or largest of one or many figures; NaN where one is NaN."""
    return float(np.min(values) if least else np.max(values))


@pytest.fixture
def figures(record_property: Callable[[str, object], None]) -> Callable[..., None]:
    """Return the function that states a case's figures, and asserts them."""
    return stating(record_property)


def stating(record: Callable[[str, object], None]) -> Callable[..., None]:
    """Return the function that hands figures to `record`, and asserts them."""

    def state(case: str, what: str, *, ours: Any, at_most: Any = None, at_least: Any = None, naive: Any = None) -> None:
        """Record figures, numbers or arrays, of a case whose id is a group's letter and a number.

        ours is asserted to keep the limit, naive to miss it. A naive method that cannot be run is told in words. Of
        parametrised tests, rows of the same id and words become one.
        """
        least = at_least is not None
        limit = worst(at_least if least else at_most, least)
        measured = not isinstance(naive, str | None)
        row = Row(case, what, worst(naive, least) if measured else naive, worst(ours, least), limit, least)
        record(FIGURES, asdict(row))
        assert row.keeps(row.ours), f"{case}: {what}: {row.ours:.6g}, limit {limit:.6g}"
        assert not measured or not row.keeps(row.naive), f"{case}: {what}: naive {row.naive:.6g} keeps {limit:.6g}"

    return state


class Report:
    """Gathers figures from the reports of tests."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rows: dict[tuple[str, str, float], tuple[Row | None, set[str]]] = {}
        self.twins: dict[str, tuple[dict[str, Any], bool]] = {}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        stated = [Row(**value) for name, value in report.user_properties if name == FIGURES]
        if report.when == "call":
            for row in stated:
                self.add(row, verdict_of(row, report.failed, hasattr(report, "wasxfail")))
            for name, value in report.user_properties:
                if name == TWIN:
                    self.twins[value["scene"]] = value, report.passed
        case = re.search(r"::test_([a-z]\d+[abc]?)_", report.nodeid)
        if report.failed and not stated and case:
            self.rows[case[1].capitalize(), report.nodeid.split("::")[-1], 0] = None, {"**no**"}

    def add(self, row: Row, verdict: str) -> None:
        key = row.case, row.what, row.limit
        known, verdicts = self.rows.get(key, (row, set()))
        self.rows[key] = (known.merged(row) if known else row), verdicts | {verdict}

    def pytest_sessionfinish(self) -> None:
        self.path.write_text(self.page(), encoding="utf-8")

    def page(self) -> str:
        """Return the whole page."""
        cases = {case for case, _, _ in self.rows}
        names = [f"{name} {version(name)}" for name in ("jax", "jaxlib", "numpy")]
        head = HEAD.format(
            command=COMMAND,
            count=len(cases),
            rows=len(self.rows),
            date=date.today().isoformat(),
            versions=f"Python {platform.python_version()}, {', '.join(names)}",
            machine=cpu_model(),
        )
        return head + "".join(self.groups()) + "".join(self.twin_table())

    def groups(self) -> Iterator[str]:
        for letter, (title, sentence) in GROUPS.items():
            keys = sorted((key for key in self.rows if key[0][0] == letter), key=order)
            if keys:
                yield f"\n## {letter}: {title}\n\n{sentence}\n\n"
                yield "| case | what | naive | ours | limit | pass |\n|---|---|---|---|---|---|\n"
                yield from (line(key, *self.rows[key]) for key in keys)

    def twin_table(self) -> Iterator[str]:
        if self.twins:
            yield TWIN_HEAD
        for scene, (twin, passed) in sorted(self.twins.items()):
            figures = f"{twin['off']} | {twin['median']:.1e} | {twin['largest']:.1e} | {twin['limit']}"
            verdict = "yes" if passed else "**no**"
            yield f"| {scene} | {twin['pixels']} × {twin['samples']} | {figures} | {verdict} | {twin['why']} |\n"


def verdict_of(row: Row, failed: bool, expected: bool) -> str:
    if not row.keeps(row.ours) and expected:
        return "xfail"
    return "**no**" if failed or not row.keeps(row.ours) else "yes"


def order(key: tuple[str, str, float]) -> tuple[int, str]:
    return int(re.sub(r"\D", "", key[0])), key[0]


def line(key: tuple[str, str, float], row: Row | None, verdicts: set[str]) -> str:
    """Return a row of the table; of several verdicts the worst."""
    verdict = min(verdicts, key=["**no**", "xfail", "yes"].index)
    if row is None:
        return f"| {key[0]} | `{key[1]}` | | | | {verdict} |\n"
    limit = f"{'≥' if row.least else '≤'} {shown(row.limit)}"
    return f"| {row.case} | {row.what} | {shown(row.naive)} | {shown(row.ours)} | {limit} | {verdict} |\n"


def shown(figure: float | str | None) -> str:
    """Return a figure with three digits, whole numbers with all of theirs."""
    if figure is None or isinstance(figure, str):
        return figure or "–"
    return f"{figure:.0f}" if abs(figure) < 1e6 and figure == int(figure) else f"{figure:.3g}"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--stability-report", metavar="PAGE", help="run what states figures, and write them to PAGE")


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "report: only for the page of --stability-report")
    page = config.getoption("--stability-report")
    if page:
        config.option.markexpr = ""  # slow tests too
    if page and not hasattr(config, "workerinput"):
        config.pluginmanager.register(Report(Path(page).absolute()))


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Keep what the page wants; without the page, all but what only it wants."""
    page = config.getoption("--stability-report")

    def wanted(item: pytest.Item) -> bool:
        names = getattr(item, "fixturenames", ())
        return "figures" in names or "twin" in names if page else item.get_closest_marker("report") is None

    config.hook.pytest_deselected(items=[item for item in items if not wanted(item)])
    items[:] = [item for item in items if wanted(item)]
