"""The page of design choices: one table and one paragraph each."""

from pathlib import Path

from benchmarks.choices.figures import SAME_COST, SAME_ERROR, Choice, Figure, Table
from benchmarks.meshes import markdown
from jaxrt.core.writing import write_text

INTRODUCTION = f"""What each choice costs, and what it buys. Cost is CPU time in ours, formed within rounds in which all
variants take turns in one process on one core: median (least–most). Errors are as each section says. Of two variants
one *dominates* when it is cheaper in every round, or has a smaller error, and is worse in nothing; differences of less
than {SAME_COST:.0%} in cost and {SAME_ERROR:.0%} in error count as none. What is not ours lives in
`benchmarks/alternatives/`, or is an argument of `render`.
"""


def cell(table: Table, variant: str, measure: str, kind: str) -> str:
    """Return one figure as text."""
    figure = table.at(variant, measure)
    if figure is None:
        return ""
    if kind == "cost" and variant == table.ours:
        return "1"
    exact = figure.value.least == figure.value.most
    return f"{figure.value.median:{figure.form}}" if exact else figure.value.told(figure.form)


def section(choice: Choice, figures: list[Figure], taken: str) -> str:
    """Return a choice's heading, method, table and argument."""
    table = Table(choice, figures)
    order = {"cost": 0, "error": 1, "note": 2}
    measures = sorted(table.measures, key=lambda m: order[m[1]])
    # Lines are measures, so that tables of many stay narrow
    rows = [[f"{kind}: {m}", *(cell(table, v, m, kind) for v in table.variants)] for m, kind in measures]
    rows.append(["**verdict**", *(table.verdict(v) for v in table.variants)])
    parts = [f"## {choice.title}\n", choice.method + "\n", markdown(["", *table.variants], rows)]
    return "\n".join([*parts, choice.argument(table) + "\n", f"*Taken {taken}.*\n"])


def dominating(choices: list[Choice], figures: list[Figure]) -> list[str]:
    """Return the variants that dominate ours."""
    tables = {c.title: Table(c, figures) for c in choices}
    return [f"{title}: {v}" for title, t in tables.items() for v in t.variants if t.verdict(v).startswith("DOMINATES")]


def write_page(path: Path, choices: list[Choice], figures: list[Figure], taken: dict[str, str]) -> None:
    """Write the page of all choices that have figures."""
    known = [c for c in choices if c.name in taken]
    lost = dominating(known, figures)
    parts = [
        "# Design choices, measured\n",
        f"Written by `python -m benchmarks.choices`; figures in [CSV]({path.stem}.csv).\n",
        INTRODUCTION,
        f"**Where ours is dominated:** {'; '.join(lost) if lost else 'nowhere'}.\n",
        *(section(c, figures, taken[c.name]) for c in known),
    ]
    write_text(path, "\n".join(parts))
