"""Find the parameters that make a scene look like a picture: bounds, coarse to fine, and a verdict.

What a program of a few lines does with optimistix itself (see examples/), for those who do not write one.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jaxrt.fit.solve import FitError, Machine, Problem
from jaxrt.fit.unknowns import Unknowns, all_rows, unknowns_of
from jaxrt.fit.verdict import Verdict, judge, standard_errors

__all__ = [
    "Fit",
    "FitError",
    "Machine",
    "Problem",
    "Progress",
    "Unknowns",
    "Verdict",
    "all_rows",
    "fit",
    "judge",
    "standard_errors",
    "unknowns_of",
]

Vector = NDArray[np.floating]
Floats = NDArray[np.float64]

STAGES = ((16, 3e-2), (4, 1e-2), (1, 1e-3))  # share of the samples, and relative gain of a step that ends the stage
PATIENCE = 8  # steps without gain that end a stage
POLISH = 4  # steps at the end that take the bias of one set of samples away
LARGEST_MOVE = 1.0  # component of such a step
TINY = 1e-7  # singular value of JᵀJ, of the largest, that is taken for zero
TRIAL_BOX = 0.5  # other starts lie within so many scene sizes of the given one


class Progress(NamedTuple):
    """Where a fit stands after a step: what is needed to go on from there."""

    step: int
    stage: int  # index into STAGES
    vector: Vector  # (k,) the best so far
    loss: float  # relative MSE there, on the fit's own seed
    losses: tuple[float, ...]  # of all steps so far


class Fit(NamedTuple):
    """An answer."""

    vector: Vector  # (k,)
    verdict: Verdict
    progress: Progress
    interrupted: bool
    pictures: tuple[Floats, Floats]  # at the start and at the answer, masked pixels 0


def fit(
    machine: Machine,
    spp: int = 64,
    seed: int = 0,
    max_steps: int = 60,
    starts: int = 1,
    resume: Progress | None = None,
    report: Callable[[Progress], None] = lambda progress: None,
) -> Fit:
    """Return the parameters that bring the picture nearest to the target, with a verdict from fresh seeds.

    max_steps: of all stages together. starts: how many starts to choose from, see `choose_start`. resume: go on from
    there. report: called after each step. Ctrl-C ends the steps, and judges the best so far. The answer is never worse
    on a fresh seed than the start. Raises FitError where a picture or a derivative is not finite.
    """
    start = machine.start
    now = resume or Progress(0, 0, choose_start(machine, starts, spp, seed), math.inf, ())
    done, interrupted = now.stage == len(STAGES), False
    try:
        while now.stage < len(STAGES) and now.step < max_steps:
            now = _stage(machine, now, spp, seed, max_steps, report)
        if now.stage == len(STAGES) and not done:
            now = now._replace(vector=_polish(machine, now.vector, spp, seed))
    except _Interrupted as stop:
        now, interrupted = stop.progress, True
    except KeyboardInterrupt:
        interrupted = True
    return _judged(machine, start, now, spp, seed, interrupted)


class _Interrupted(Exception):
    """Ctrl-C, with the best so far."""

    def __init__(self, progress: Progress) -> None:
        super().__init__()
        self.progress = progress


def _stage(
    machine: Machine, now: Progress, spp: int, seed: int, max_steps: int, report: Callable[[Progress], None]
) -> Progress:
    """Return the progress after one stage, ready for the next."""
    share, enough = STAGES[now.stage]
    best, waiting = math.inf, 0
    try:
        for vector, loss, gained in machine.steps(now.vector, seed, max(1, spp // share)):
            now = Progress(now.step + 1, now.stage, vector, loss, (*now.losses, loss))
            report(now)
            slow = gained and loss > (1 - enough) * best
            waiting = 0 if gained and not slow else waiting + 1
            best = min(best, loss)
            if now.step >= max_steps or waiting >= (2 if slow else PATIENCE):
                break
    except KeyboardInterrupt:
        raise _Interrupted(now) from None
    return now._replace(stage=now.stage + 1)


def _polish(machine: Machine, vector: Vector, spp: int, seed: int) -> Vector:
    """Return the vector without the bias of one set of samples.

    Noise is in the residual and in its Jacobian alike: the least sum of squares is where both are small, which favours
    what is dark and direct. Here the Jacobian of other samples, an instrument, meets the residual: J₂ᵀ r₁ = 0 has no
    such bias. A step counts if the product of two residuals, a loss without bias, falls.
    """
    seeds = [(seed + k) % 2**32 for k in (0, 3)]
    best, (residuals, jacobians) = vector, _pair(machine, vector, spp, seeds)
    loss = float(np.sum(residuals[0] * residuals[1]))
    for _ in range(POLISH):
        moves = [_instrumental(jacobians[i], jacobians[1 - i]) @ residuals[i].ravel() for i in (0, 1)]
        trial = (best - np.mean(moves, axis=0)).astype(vector.dtype)
        if not np.abs(trial - best).max() < LARGEST_MOVE:
            break
        residuals, jacobians = _pair(machine, trial, spp, seeds)
        gained = float(np.sum(residuals[0] * residuals[1]))
        if not gained < loss:
            break
        best, loss = trial, gained
    return best


def _pair(machine: Machine, vector: Vector, spp: int, seeds: list[int]) -> tuple[list[Floats], list[Floats]]:
    """Return residuals and Jacobians of two seeds."""
    a, b = (machine.evaluate(vector, seed, spp) for seed in seeds)
    return [a[0], b[0]], [a[1], b[1]]


def _instrumental(jacobian: Floats, instrument: Floats) -> Floats:
    """Return (J₂ᵀJ₁)⁻¹J₂ᵀ (k, n), which turns a residual of the samples of J₁ into a step."""
    k = jacobian.shape[-1]
    here, other = jacobian.reshape(-1, k), instrument.reshape(-1, k)
    return np.linalg.pinv(other.T @ here, rcond=TINY) @ other.T


def choose_start(machine: Machine, starts: int, spp: int, seed: int) -> Vector:
    """Return the vector of the least loss among the scene's own and `starts` − 1 with places drawn around it."""
    start = machine.start
    if starts == 1:
        return start
    labels = machine.problem.unknowns
    places = np.concatenate([np.full(row.size, row.kind == "place") for row in labels.rows])
    rng = np.random.default_rng(seed)
    moves = rng.uniform(-TRIAL_BOX, TRIAL_BOX, (starts, len(places))) * places
    moves[0] = 0
    trials = [start + move.astype(start.dtype) for move in moves]
    losses = [np.sum(machine.evaluate(trial, seed, max(1, spp // STAGES[0][0]))[0] ** 2) for trial in trials]
    return trials[int(np.argmin(losses))]


def _judged(machine: Machine, start: Vector, now: Progress, spp: int, seed: int, interrupted: bool) -> Fit:
    """Return the fit with its verdict, or the start if that is better on fresh seeds."""
    problem, first, second = machine.problem, (seed + 1) % 2**32, (seed + 2) % 2**32
    before, now_there = _pair(machine, start, spp, [first, second]), _pair(machine, now.vector, spp, [first, second])
    # The product of two residuals: a sum of squares would favour what is less noisy
    if np.sum(before[0][0] * before[0][1]) < np.sum(now_there[0][0] * now_there[0][1]):
        now, now_there = now._replace(vector=start), before
    (residual, again), (jacobian, _) = now_there
    places = np.concatenate([np.full(row.size, row.kind == "place") for row in problem.unknowns.rows])
    verdict = judge((residual, again), jacobian, problem.unknowns.labels(), places)
    target = np.asarray(problem.target * problem.weight, float)
    pictures = before[0][0] * problem.scale + target, residual * problem.scale + target
    return Fit(now.vector, verdict, now, interrupted, pictures)
