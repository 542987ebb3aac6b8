"""Figures of variants, on file and as a verdict: which variant is dominated by which."""

import csv
from collections.abc import Callable, Iterable, Mapping
from io import StringIO
from pathlib import Path
from typing import Literal, NamedTuple

from benchmarks.interleave import Spread, interleaved, ratios, spread
from jaxrt.core.writing import write_text

Kind = Literal["cost", "error", "note"]
SAME_COST, SAME_ERROR = 0.05, 0.03  # relative differences that count as none


class Figure(NamedTuple):
    """One measured number of one variant."""

    choice: str
    variant: str
    measure: str
    kind: Kind
    value: Spread
    form: str = ".2f"


class Choice(NamedTuple):
    """A design choice: what is measured, and what the figures say."""

    name: str
    title: str
    ours: str  # variant that the package uses
    method: str  # how it is measured, in a sentence or two
    measure: Callable[[int], list[Figure]]  # of a number of rounds
    argument: Callable[["Table"], str]


class Table:
    """The figures of one choice."""

    def __init__(self, choice: Choice, figures: Iterable[Figure]) -> None:
        self.ours = choice.ours
        self.figures = [f for f in figures if f.choice == choice.name]
        self.variants = list(dict.fromkeys([choice.ours, *(f.variant for f in self.figures)]))
        self.measures = list(dict.fromkeys((f.measure, f.kind) for f in self.figures))

    def at(self, variant: str, measure: str) -> Figure | None:
        """Return a figure, None where it was not measured."""
        found = [f for f in self.figures if (f.variant, f.measure) == (variant, measure)]
        return found[0] if found else None

    def __call__(self, variant: str, measure: str) -> float:
        """Return the median of a figure that must be there."""
        return next(f.value.median for f in self.figures if (f.variant, f.measure) == (variant, measure))

    def span(self, variant: str, kind: Kind) -> tuple[float, float]:
        """Return the least and the largest median of a variant's figures of a kind."""
        values = [f.value.median for f in self.figures if f.variant == variant and f.kind == kind]
        return min(values), max(values)

    def verdict(self, variant: str) -> str:
        """Return how a variant stands to ours. What dominates by cost does so in every round."""
        if variant == self.ours:
            return "**ours**"
        costs = [f.value for f in self.figures if f.variant == variant and f.kind == "cost"]
        cheaper = [c for c in costs if c.median < 1 - SAME_COST]
        dearer = [c for c in costs if c.median > 1 + SAME_COST]
        better, worse = self._errors(variant)
        if (cheaper or better) and (dearer or worse):
            return "trade"
        if better or any(c.most < 1 for c in cheaper):
            return "DOMINATES OURS"
        if worse or any(c.least > 1 for c in dearer):
            return "dominated by ours"
        return "no clear difference"

    def _errors(self, variant: str) -> tuple[bool, bool]:
        """Return whether any error of a variant is smaller than ours, and whether any is larger."""
        mine = {f.measure: f.value.median for f in self.figures if f.variant == self.ours and f.kind == "error"}
        pairs = [(f.value.median, mine[f.measure]) for f in self.figures if f.variant == variant and f.measure in mine]
        better = any(theirs < (1 - SAME_ERROR) * ours for theirs, ours in pairs)
        return better, any(theirs > (1 + SAME_ERROR) * ours for theirs, ours in pairs)


def cost(
    choice: str, workload: str, actions: Mapping[str, Callable[[], object]], ours: str, rounds: int
) -> list[Figure]:
    """Return the CPU time of each variant in that of ours, and ours in milliseconds; all take turns in each round."""
    times = interleaved(actions, rounds)
    figures = [Figure(choice, v, workload, "cost", spread(ratios(times, v, ours))) for v in actions]
    absolute = spread([1e3 * t for t in times[ours]])
    return [*figures, Figure(choice, ours, f"{workload}, ms", "note", absolute, ".3g")]


def error(choice: str, variant: str, measure: str, value: float, form: str = ".3g") -> Figure:
    """Return an error that was determined once."""
    return Figure(choice, variant, measure, "error", Spread(value, value, value), form)


def write_csv(path: Path, figures: list[Figure], taken: dict[str, str]) -> None:
    """Save the figures. taken: date, machine and versions of each choice."""
    text = StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(["choice", "variant", "measure", "kind", *Spread._fields, "form", "taken"])
    for f in figures:
        numbers = [f"{v:.5g}" for v in f.value]
        table.writerow([f.choice, f.variant, f.measure, f.kind, *numbers, f.form, taken[f.choice]])
    write_text(path, text.getvalue())


def read_csv(path: Path) -> tuple[list[Figure], dict[str, str]]:
    """Return the figures of earlier runs, and when they were taken."""
    if not path.exists():
        return [], {}
    kinds: dict[str, Kind] = {"cost": "cost", "error": "error", "note": "note"}
    figures, taken = [], {}
    with path.open(newline="", encoding="utf-8") as file:
        for choice, variant, measure, kind, a, b, c, form, when in list(csv.reader(file))[1:]:
            value = Spread(float(a), float(b), float(c))
            figures.append(Figure(choice, variant, measure, kinds[kind], value, form))
            taken[choice] = when
    return figures, taken
