"""Charts on disk: numbers as CSV and JSON, pictures, and the page."""

import json
from pathlib import Path

from benchmarks.chart.curves import read_csv, write_csv
from benchmarks.chart.drawing import draw_chart
from benchmarks.chart.page import CHARTS, Found, page_of
from benchmarks.chart.panels import draw_panels
from benchmarks.chart.studies import Study
from jaxrt.core.writing import write_text


def save(folder: Path, name: str, study: Study, told: dict[str, str]) -> None:
    """Save a study as CSV, and what else there is to say of it as JSON. told: when and on what it was measured."""
    folder.mkdir(parents=True, exist_ok=True)
    write_csv(folder / f"{name}.csv", study.curves)
    facts = json.dumps({"band": float(study.band), "facts": study.facts, "run": told}, indent=1, ensure_ascii=False)
    write_text(folder / f"{name}.json", facts + "\n")


def load(folder: Path) -> Found:
    """Return all charts whose numbers are in the folder, in the page's order."""
    found: Found = {}
    for name in CHARTS:
        if (folder / f"{name}.csv").exists():
            kept = json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
            found[name] = Study(read_csv(folder / f"{name}.csv"), kept["band"], kept["facts"]), kept["run"]
    return found


def draw_all(output: Path) -> None:
    """Draw all charts whose numbers are in output/charts, and write the page output/charts.md."""
    found = load(output / "charts")
    for name, (study, _) in found.items():
        draw = draw_panels if CHARTS[name].panels else draw_chart
        draw(output / "charts" / name, CHARTS[name], study)
    write_text(output / "charts.md", page_of(found))
