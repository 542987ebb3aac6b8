"""Figures for the page of charts, read off the curves: name -> text."""

import numpy as np

from benchmarks.chart.curves import Crossing, Curves, Point, crossing, pareto_front
from benchmarks.chart.studies import Study

TARGET = 0.01  # error at which methods are compared
LIMITS = {"independent": 0.5, "best": 0.8}  # of jaxrt's time over Mitsuba's at that error
SCENES = {"sphere": "samplers-sphere-light", "glass": "samplers-mirror-and-glass", "mesh": "samplers-mesh"}
EDGES, COARSE = "with 16,384 edge samples", "finite differences, step 0.1"
Studies = dict[str, Study]
Figures = dict[str, str]


def percent(value: float) -> str:
    """Return a share with two digits, in per cent."""
    return f"{float(f'{100 * value:.2g}'):.10g} %"


def two_digits(value: float) -> str:
    """Return a number with two digits."""
    return f"{float(f'{value:.2g}'):,.10g}"


def at(points: list[Point], spp: int) -> Point:
    """Return the point of so many samples, or the last one."""
    return next((p for p in points if p.spp == spp), points[-1])


def seconds_text(found: Crossing | None) -> str:
    """Return seconds with two digits, ≈ where not measured."""
    return "–" if found is None else f"{'' if found.measured else '≈ '}{two_digits(found.seconds)}"


def markdown(rows: list[list[str]]) -> str:
    """Return a table, the first row its head."""
    return "\n".join(f"| {' | '.join(row)} |" for row in [rows[0], ["---"] * len(rows[0]), *rows[1:]])


def table(curves: Curves, target: float, spp: int = 64) -> str:
    """Return error and time at `spp`, and time and samples at an error, of each method."""
    aim = percent(target)
    rows = [["method", f"error at {spp} spp", "CPU s", f"CPU s for {aim}", f"samples for {aim}"]]
    for name, points in curves.items():
        p, found = at(points, spp), crossing(points, target)
        samples = "–" if found is None else f"{found.spp:,.0f}"
        rows.append([name, percent(p.error), f"{p.seconds:.3f}", seconds_text(found), samples])
    return markdown(rows)


def lengths_table(curves: Curves, lengths: tuple[int, ...] = (4, 64, 1024)) -> str:
    """Return error and time of each method at some numbers of samples."""
    heads = [head for spp in lengths for head in (f"error at {spp:,} spp", "CPU s")]
    rows = [["method", *heads]]
    for name, points in curves.items():
        told = [at(points, spp) for spp in lengths]
        rows.append([name, *(text for p in told for text in (percent(p.error), f"{p.seconds:.4f}"))])
    return markdown(rows)


def ratio(curves: Curves, ours: str, theirs: str, target: float = TARGET) -> float:
    """Return how much of the time of `theirs` `ours` takes to the same error; NaN where one is missing or too bad."""
    a, b = (crossing(curves.get(name, []), target) for name in (ours, theirs))
    return float("nan") if a is None or b is None else a.seconds / b.seconds


def mean_ratio(curves: Curves, a: str, b: str, least: int = 16) -> float:
    """Return the geometric mean of time of a / time of b over points of equal, not too few samples; NaN of none."""
    pairs = [(p, q) for p in curves[a] for q in curves[b] if p.spp == q.spp >= least]
    return float(np.exp(np.mean([np.log(p.seconds / q.seconds) for p, q in pairs]))) if pairs else float("nan")


def slopes(curves: Curves) -> str:
    """Return how fast the errors of jaxrt's samplers fall."""
    found = []
    for name, curve in curves.items():
        points = [p for p in curve if p.error > 0 and p.spp >= 16]
        if name.startswith("Mitsuba") or len(points) < 2:
            continue
        slope = np.polyfit(np.log([p.spp for p in points]), np.log([p.error for p in points]), 1)[0]
        found.append(f"{slope:.2f} (`{name}`)".replace("-", "−"))
    if not found:
        return "Too few samples to tell how fast the error falls."
    return f"From 16 samples on the error falls with the number of samples to the power {', '.join(found)}."


def peers_of(curves: Curves) -> list[str]:
    """Return the names of Mitsuba's curves, its independent sampler first."""
    return [name for name in curves if name.startswith("Mitsuba")]


def equal_error(curves: Curves, target: float = TARGET) -> dict[str, tuple[str, float]]:
    """Return for Mitsuba's independent sampler and its fastest one (name, time of jaxrt's default over its time)."""
    shares = {name: ratio(curves, "sobol", name, target) for name in peers_of(curves)}
    first, best = next(iter(shares)), max(shares, key=shares.__getitem__)
    return {"independent": (first, shares[first]), "best": (best, shares[best])}


def picture_figures(studies: Studies) -> Figures:
    """Return the figures of the charts of samplers."""
    figures: Figures = {}
    for key, name in {"point": "samplers-point-light", **SCENES}.items():
        curves, target = studies[name].curves, 1e-3 if key == "point" else TARGET
        figures[f"table_{name.replace('-', '_')}"] = table(curves, target)
        figures[f"slopes_{key}"] = slopes(curves)
        for other in ("independent", "stratified"):
            figures[f"{key}_over_{other}"] = f"{ratio(curves, 'sobol', other, target):.2f}"
        for spp in (64, 1024):
            figures[f"{key}_error_{spp}"] = percent(at(curves["sobol"], spp).error)
    sphere, glass = (studies[SCENES[key]].curves["sobol"] for key in ("sphere", "glass"))
    found = crossing(sphere, TARGET)
    figures["sphere_spp_1"] = "–" if found is None else f"about {two_digits(found.spp)}"
    figures["glass_over_sphere_error"] = two_digits(at(glass, 64).error / at(sphere, 64).error)
    return figures


def peer_figures(studies: Studies) -> Figures:
    """Return jaxrt's default beside Mitsuba at equal error."""
    rows = [["room with", "jaxrt", "Mitsuba independent", "share", "Mitsuba's best", "share"]]
    figures: Figures = {}
    for key, name in SCENES.items():
        curves = studies[name].curves
        if not peers_of(curves):
            return {}
        told = equal_error(curves)
        row = [name.removeprefix("samplers-").replace("-", " "), seconds_text(crossing(curves["sobol"], TARGET))]
        for which, (peer, share) in told.items():
            also = f" ({peer.removeprefix('Mitsuba ')})" if which == "best" else ""
            row += [seconds_text(crossing(curves[peer], TARGET)) + also, f"{share:.2f}"]
            if key == "sphere":
                outcome = "met" if share <= LIMITS[which] else "missed"
                figures[f"peer_{which}_error_64"] = percent(at(curves[peer], 64).error)
                figures[f"verdict_{which}"] = f"{share:.2f} for a goal of {LIMITS[which]}: {outcome}"
        rows.append(row)
        if key == "mesh":
            figures["mesh_verdict"] = _mesh_verdict(told["best"][1])
    return figures | {"peer_table": markdown(rows)}


def _mesh_verdict(share: float) -> str:
    """Return who is ahead with a mesh."""
    behind = "takes {:.2f} times as long as Mitsuba's best: Embree searches meshes faster than jaxrt's tree"
    told = behind if share > 1 else "takes {:.2f} of the time of Mitsuba's best"
    return f"With a mesh of 26,000 faces jaxrt {told.format(share)}."


def light_figures(study: Study) -> Figures:
    """Return what light sampling is worth."""
    sampled, chance = study.curves
    on, off = at(study.curves[sampled], 64), at(study.curves[chance], 64)
    work = (off.error / on.error) ** 2 * off.seconds / on.seconds
    return {
        "table_light_sampling": table(study.curves, TARGET),
        "chance_share": f"{mean_ratio(study.curves, chance, sampled):.2f}",
        "chance_error": two_digits(off.error / on.error),
        "chance_work": two_digits(work),
    }


def depth_figures(study: Study) -> Figures:
    """Return what each depth leaves out."""
    floors = study.facts["floors"]
    rows = [["", "light cut off, RMS / mean", "error at 64 spp", "CPU s", "error at 1,024 spp", "CPU s"]]
    for name, points in study.curves.items():
        told = [text for p in (at(points, 64), at(points, 1024)) for text in (percent(p.error), f"{p.seconds:.3f}")]
        rows.append([name, percent(floors[name]), *told])
    depths = {int(name.split()[-1]): floor for name, floor in floors.items()}
    shares = [depths[d + 1] / depths[d] for d in depths if d >= 3 and d + 1 in depths]
    front = pareto_front(study.curves)
    names = {p: name.split()[-1] for name, points in study.curves.items() for p in points}
    walk = [f"depth {names[p]} at {percent(p.error)}" for p in front]
    return {
        "table_depth": markdown(rows),
        "deep": str(study.facts["deep"]),
        "floor_ratio": f"{min(shares):.2f} to {max(shares):.2f}",
        "floor_5": percent(floors["max_depth 5"]),
        "floor_8": percent(floors["max_depth 8"]),
        "depths_on_front": ", ".join(walk),
    }
