"""Figures of precision, unrolling and derivatives for the page of charts."""

from benchmarks.chart.curves import Curves, crossing
from benchmarks.chart.figures import (
    COARSE,
    EDGES,
    TARGET,
    Figures,
    Studies,
    at,
    lengths_table,
    mean_ratio,
    peers_of,
    percent,
    seconds_text,
    table,
    two_digits,
)
from benchmarks.chart.studies import Study


def _largest_gap(curves: Curves, a: str, b: str) -> float:
    """Return the largest relative difference of two curves' errors at equal samples."""
    return max(abs(p.error / q.error - 1) for p in curves[a] for q in curves[b] if p.spp == q.spp and q.error > 0)


def precision_figures(studies: Studies) -> Figures:
    """Return where float32 ends, and what float64 costs."""
    floor, room = studies["precision-floor"].curves, studies["precision-room"].curves
    return {
        "table_precision_floor": table(floor, 1e-4),
        "table_precision_room": table(room, TARGET),
        "narrow_error_4096": percent(at(floor["float32"], 4096).error),
        "wide_error_4096": percent(at(floor["float64"], 4096).error),
        "wide_share_floor": f"{mean_ratio(floor, 'float64', 'float32'):.1f}",
        "wide_share_room": f"{mean_ratio(room, 'float64', 'float32'):.1f}",
        "precision_gap": percent(_largest_gap(room, "float32", "float64")),
    }


def unroll_figures(study: Study) -> Figures:
    """Return what unrolling costs and brings."""
    scan, unrolled = study.curves
    share = mean_ratio(study.curves, unrolled, scan)
    a, b = (study.facts["compile"][name] for name in (scan, unrolled))
    if share < 1:
        pays = two_digits((b - a) / (1 - share))
        verdict = f"it pays where one program draws for more than {pays} CPU seconds"
    else:
        verdict = "it does not pay"
    return {
        "table_unroll": table(study.curves, TARGET),
        "unroll_share": f"{share:.2f}",
        "unroll_compile": two_digits(b),
        "scan_compile": two_digits(a),
        "unroll_verdict": verdict,
    }


def derivative_figures(studies: Studies) -> Figures:
    """Return what derivatives with and without edge samples reach."""
    picture, bumps = studies["derivatives-picture"], studies["derivatives-functionals"].curves
    curves = picture.curves
    interior, edges = curves["interior only"], curves[EDGES]
    return {
        "table_derivatives_picture": lengths_table(curves),
        "table_derivatives_functionals": lengths_table(bumps),
        "interior_error_64": percent(at(interior, 64).error),
        "interior_error_1024": percent(at(interior, 1024).error),
        "edges_error_64": percent(at(edges, 64).error),
        "edges_share": f"{at(edges, 64).seconds / at(interior, 64).seconds:.1f}",
        "edges_seconds_5": seconds_text(crossing(edges, 0.05)),
        "fd_seconds_5": seconds_text(crossing(curves[COARSE], 0.05)),
        "bumps_interior_64": percent(at(bumps["interior only"], 64).error),
        "bumps_edges_64": percent(at(bumps[EDGES], 64).error),
        "peer_derivatives": _peers(picture),
    }


def _peers(study: Study) -> str:
    """Return what Mitsuba's integrators answer."""
    silent, answers = study.facts["peers without an answer"], peers_of(study.curves)
    if not silent and not answers:
        return ""
    errors = ", ".join(f"`{name.split()[-1]}` {percent(at(study.curves[name], 1024).error)}" for name in answers)
    messages = dict.fromkeys(silent.values())
    told = "; ".join(f"{_names([n for n in silent if silent[n] == m])}: “{m}”" for m in messages)
    return (
        f"Of *Mitsuba*'s integrators these answer, with the interior alone: {errors}. Others raise an error ({told})."
    )


def _names(names: list[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)
