"""Which of a fit's derivatives lack terms, and how that is told."""

from collections.abc import Mapping

from jaxrt.fit.unknowns import Unknowns
from jaxrt.gradcheck.coverage import SCATTERED, coverage
from jaxrt.scene import Scene

Missing = Mapping[str, tuple[str, ...]]  # what derivatives lack, by the unknown's name


def missing_terms(scene: Scene, unknowns: Unknowns, max_depth: int, light: bool = True) -> Missing:
    """Return for each unknown what its derivative lacks in this scene; those that lack nothing are left out.

    light: whether light is compared, or what the camera's rays meet first alone.
    """
    selectors = ((row.text, row.selector) for row in unknowns.rows)
    found = {text: coverage(scene, name, max_depth, 1, row).missing for text, (name, row) in selectors}
    if not light:
        found = {text: tuple(term for term in missing if term == SCATTERED) for text, missing in found.items()}
    return {text: missing for text, missing in found.items() if missing}


def warning_of(missing: Missing) -> str:
    """Return in one line which unknowns lack which terms."""
    alike: dict[tuple[str, ...], list[str]] = {}
    for text, terms in missing.items():
        alike.setdefault(terms, []).append(text)
    lacks = "; ".join(f"{', '.join(texts)}: {', '.join(terms)}" for terms, texts in alike.items())
    return (
        f"derivatives lack, for {lacks}. The fit may stall or be off: gradcheck of {next(iter(missing))} tells by how "
        "much; another view or start may not need them"
    )
