"""docs/charts.md: the template beside this file, with figures read off the curves."""

import re
import textwrap
from pathlib import Path

from benchmarks.chart.drawing import Chart
from benchmarks.chart.figures import (
    EDGES,
    Figures,
    Studies,
    depth_figures,
    light_figures,
    peer_figures,
    picture_figures,
)
from benchmarks.chart.figures_edges import edge_figures
from benchmarks.chart.figures_more import derivative_figures, precision_figures, unroll_figures
from benchmarks.chart.studies import Study

WIDTH = 120
TEMPLATE = Path(__file__).with_name("page.template.md")
CHARTS = {
    "samplers-point-light": Chart("Samplers: room with a point light, direct light only"),
    "samplers-sphere-light": Chart("Samplers: room with a spherical light, max_depth 5"),
    "samplers-mirror-and-glass": Chart("Samplers: room with mirror and glass, max_depth 4"),
    "samplers-mesh": Chart("Samplers: room with a mesh of 26,000 faces, max_depth 5"),
    "light-sampling": Chart("Light sampling: room with a spherical light"),
    "depth": Chart("max_depth: room with a spherical light", samples="max_depth 1", ordered="max_depth"),
    "precision-floor": Chart("float32 and float64: floor under a spherical light, closed form"),
    "precision-room": Chart("float32 and float64: room with a spherical light, max_depth 5"),
    "unroll": Chart("Events in a scan or unrolled: room with a spherical light, max_depth 5"),
    "derivatives-picture": Chart("Derivative picture by a point light's x", "relative L2 error", EDGES, "with"),
    "derivatives-functionals": Chart("Derivative of 16 smooth functionals", "relative L2 error", EDGES, "with"),
    "edges": Chart("Derivatives of what moves edges", "relative L2 error", ordered="with ", panels=True),
}
Found = dict[str, tuple[Study, dict[str, str]]]  # name -> data, and when and on what they were measured


def page_of(found: Found) -> str:
    """Return the page: the template's sections, but those of whose figures one is missing."""
    figures = _figures({name: study for name, (study, _) in found.items()}) | {"circumstances": _circumstances(found)}
    sections = re.split(r"\n(?=## )", TEMPLATE.read_text(encoding="utf-8"))
    told = (section.format_map(figures) for section in sections if _fields(section) <= set(figures))
    return "\n\n".join(_wrap(paragraph) for section in told for paragraph in section.strip().split("\n\n")) + "\n"


def _wrap(paragraph: str) -> str:
    """Return a paragraph or list in lines of at most WIDTH characters; tables, headings and pictures as they are."""
    if paragraph.startswith(("|", "#", "!")):
        return paragraph
    items = re.split(r"\n(?=\* )", paragraph)
    indents = ["  " if item.startswith("* ") else "" for item in items]
    wrapped = [
        textwrap.fill(
            " ".join(item.split()), WIDTH, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
        )
        for item, indent in zip(items, indents, strict=True)
    ]
    return "\n".join(wrapped)


def _fields(section: str) -> set[str]:
    return set(re.findall(r"\{(\w+)\}", section))


def _figures(studies: Studies) -> Figures:
    """Return all figures that the charts found can tell."""
    groups = {
        picture_figures: [
            "samplers-point-light",
            "samplers-sphere-light",
            "samplers-mirror-and-glass",
            "samplers-mesh",
        ],
        peer_figures: ["samplers-sphere-light", "samplers-mirror-and-glass", "samplers-mesh"],
        precision_figures: ["precision-floor", "precision-room"],
        derivative_figures: ["derivatives-picture", "derivatives-functionals"],
    }
    singles = {light_figures: "light-sampling", depth_figures: "depth", unroll_figures: "unroll", edge_figures: "edges"}
    figures: Figures = {}
    for tell, needed in groups.items():
        if set(needed) <= set(studies):
            figures |= tell(studies)
    for tell_one, name in singles.items():
        if name in studies:
            figures |= tell_one(studies[name])
    return figures


def _circumstances(found: Found) -> str:
    """Return when and on what the charts were measured, each set of circumstances once."""
    runs = [run for _, run in found.values()]
    told = {f"Measured {r['date']} on {r['cpu']}; {r['versions']}; {r['settings']} run." for r in runs}
    load = max((float(run["load"]) for run in runs if "load" in run), default=0.0)
    busy = f"Other programs ran as well: the load average came to {load:.1f}." if load > 1.5 else ""
    return "\n".join([*sorted(told), busy]).rstrip()
