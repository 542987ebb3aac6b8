"""What a fit has found, by the user's names."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jaxrt.fit.descent import Found, Progress
from jaxrt.fit.lacks import Missing
from jaxrt.fit.solve import Problem
from jaxrt.fit.targets import parted
from jaxrt.fit.verdict import Verdict
from jaxrt.scene import Scene

Floats = NDArray[np.float64]

DIGITS = 5


@dataclass(frozen=True, repr=False, eq=False)
class Fit:
    """The answer of `jaxrt.fit`; its text lists values with their standard errors, and the verdict."""

    values: Mapping[str, Floats]  # by the names that were given
    errors: Mapping[str, Floats]  # standard errors of these, inf where the picture does not determine them
    verdict: Verdict  # its `word` is "solved", "stalled", "ambiguous" or "noise-limited", its `message` says why
    scene: Scene  # the one that was given, with the values in it
    before: Any  # (height, width, 3) picture of the start, 0 where the weight is; a dict, if the target is one
    after: Any  # that of the answer
    history: tuple[float, ...]  # loss of each step: MSE over the target's mean square, on the fit's own samples
    lacks: Missing  # what derivatives lack, of those unknowns whose derivatives lack something
    interrupted: int  # number of the signal that ended the steps, 0: none
    progress: Progress  # what `resume` takes

    def __repr__(self) -> str:
        lines = [f"{name} = {_with_errors(value, self.errors[name])}" for name, value in self.values.items()]
        return "\n".join([*lines, f"{self.verdict.word}: {self.verdict.message}"])


def answer_of(scene: Scene, problem: Problem, found: Found, missing: Missing, by_name: bool) -> Fit:
    """Return the answer in the user's terms; `scene` is the one that was given, of whatever size."""
    before, after = (parted(picture, problem.outputs) if by_name else picture for picture in found.pictures)
    unknowns, verdict = problem.unknowns, found.verdict
    values, spread = unknowns.values(found.vector), verdict.errors * unknowns.slopes(found.vector)
    return Fit(
        values=values,
        errors={row.text: spread[row.span].reshape(row.shape) for row in unknowns.rows},
        verdict=verdict,
        scene=unknowns.put(scene, list(values.values())),
        before=before,
        after=after,
        history=found.progress.losses,
        lacks=missing,
        interrupted=found.interrupted,
        progress=found.progress,
    )


def numbers(value: Floats) -> str:
    """Return the numbers of a value."""
    return " ".join(f"{number:.{DIGITS}g}" for number in np.ravel(value))


def _with_errors(value: Floats, errors: Floats) -> str:
    pairs = zip(np.ravel(value), np.ravel(errors), strict=True)
    return " ".join(f"{number:.{DIGITS}g} ± {error:.1g}" for number, error in pairs)
