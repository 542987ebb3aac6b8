"""The way down: coarse to fine in stages, without the bias of one set of samples, judged on fresh seeds."""

import math
import signal
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jaxrt.fit.lacks import Missing
from jaxrt.fit.solve import Drawing, Look, Machine
from jaxrt.fit.targets import RADIANCE, rounding_of
from jaxrt.fit.verdict import Verdict, instrumental, judge

Vector = NDArray[np.floating]
Floats = NDArray[np.float64]


class Stage(NamedTuple):
    """How a stage is drawn, and when it ends."""

    share: int  # one in so many of the samples
    enough: float  # relative gain of a step that ends the stage
    patience: int  # steps without gain that end it: a finer stage looks better than a shorter step
    blur: float  # of the pictures, where outlines move: standard deviation as a share of the shorter side
    turning: bool = True  # whether things turn whose places are sought: much blurred, all of them look alike


STAGES = (Stage(16, 3e-2, 2, 0.1, False), Stage(4, 1e-2, 2, 0.03), Stage(1, 1e-3, 4, 0.0))
DONE = len(STAGES) + 1  # number of stages, with the last steps of `_polish`
SLOW = 2  # steps of little gain that end a stage
POLISH = 4  # steps at the end that take the bias of one set of samples away
LARGEST_MOVE = 1.0  # component of such a step
JUDGES = 4  # sets of samples that tell the errors; of two, 2 errors hold 93 % where few pixels tell
FRESH = 0x85EBCA6B  # from the user's seeds to those of the last steps and of the verdict
TINY = 1e-7  # singular value of JᵀJ, of the largest, that is taken for zero
TRIAL_BOX = 0.5  # other starts lie within so many scene sizes of the given one
TRIAL_SHAPES = 0.1  # where outlines move, which must overlap, within such a share of that
TRIAL_TURN = 0.7  # radians, about each axis
FINALISTS = 4  # of the starts
TRIAL_STEPS = 6  # that they take before one is chosen
USUAL = 5  # steps of a stage, to tell the time left
FIXED = 4  # what a step costs besides its samples and edge samples, in samples a pixel


class Progress(NamedTuple):
    """Where a fit stands after a step: what is needed to go on from there as if it had not ended."""

    step: int
    stage: int  # index into STAGES; their number: before the last steps, DONE: after one or more of them
    vector: Vector  # (k,) the best so far
    loss: float  # relative MSE there, on the fit's own seed
    losses: tuple[float, ...]  # of all steps so far
    step_size: float | None = None  # of the next step; None where a stage begins
    waiting: int = 0  # steps without gain, the last ones
    rounds: int = 1  # of edge samples in this stage


class Step(NamedTuple):
    """What is told after a step."""

    number: int  # from 1
    stage: int  # of 3, from 1
    spp: int
    loss: float  # relative MSE of the best so far, on the fit's own samples
    accepted: bool  # whether the best so far is of this step
    values: Mapping[str, Floats]  # the best so far
    seconds_left: float | None  # about
    progress: Progress
    lacks: Missing = {}  # what derivatives lack, of those unknowns whose derivatives lack something


class Found(NamedTuple):
    """Where the descent has ended."""

    vector: Vector  # (k,)
    verdict: Verdict
    progress: Progress
    interrupted: int  # number of the signal, 0: none
    pictures: tuple[Floats, Floats]  # at the start and at the answer, masked pixels 0


def descend(
    machine: Machine,
    spp: int = 64,
    seed: int = 0,
    max_steps: int = 60,
    starts: int = 1,
    resume: Progress | None = None,
    report: Callable[[Step], None] | None = None,
) -> Found:
    """Return the parameters that bring the picture nearest to the target, with a verdict from fresh seeds.

    The arguments are those of `jaxrt.fit`. Raises FitError where a picture or a derivative is not finite.
    """
    start = machine.start
    now = resume or _begin(machine, starts, spp, seed)
    clock, interrupted = _Clock(machine, spp, max_steps), 0
    try:
        for look, after in _steps(machine, now, spp, seed, max_steps):
            before, now = now, after
            samples, left = _samples(spp, before.stage), clock.left(before.stage, now)
            if report is not None:
                values = machine.problem.unknowns.values(now.vector)
                report(Step(now.step, before.stage + 1, samples, now.loss, look.accepted, values, left, now))
        if now.stage == len(STAGES):
            now = _polish(machine, now, Drawing(spp, rounds=now.rounds), seed)
    except KeyboardInterrupt as stop:
        interrupted = getattr(stop, "number", signal.SIGINT)
    return _judged(machine, start, now, spp, seed, interrupted)


def _samples(spp: int, stage: int) -> int:
    return max(1, spp // STAGES[stage].share)


def _drawing(spp: int, stage: int, rounds: int = 1) -> Drawing:
    """Return how the pictures of a stage are drawn."""
    return Drawing(_samples(spp, stage), STAGES[stage].blur, rounds, STAGES[stage].turning)


def _steps(machine: Machine, now: Progress, spp: int, seed: int, max_steps: int) -> Iterator[tuple[Look, Progress]]:
    """Yield each step of all stages, and where the fit stands after it."""
    while now.stage < len(STAGES) and now.step < max_steps:
        drawing = _drawing(spp, now.stage, now.rounds)
        if now.step_size is None:
            now = now._replace(rounds=machine.rounds_at(now.vector, seed, drawing))
            drawing = drawing._replace(rounds=now.rounds)
        looks = machine.steps(now.vector, seed, drawing, now.step_size)
        if now.step_size is not None:
            next(looks)  # where the fit stood already
        for look in looks:
            now = _after(now, look)
            yield look, now
            if now.step_size is None or now.step >= max_steps:
                break


def _after(now: Progress, look: Look) -> Progress:
    """Return where the fit stands after a step: in the next stage, where steps gain no more."""
    stage, first = STAGES[now.stage], now.step_size is None
    slow = look.accepted and not first and look.loss > (1 - stage.enough) * now.loss
    waiting = 0 if look.accepted and not slow else now.waiting + 1
    ended = look.promise < stage.enough or waiting >= (SLOW if slow else stage.patience)
    losses = (*now.losses, look.loss)
    stands = Progress(now.step + 1, now.stage, look.vector, look.loss, losses, rounds=now.rounds)
    if ended:
        return stands._replace(stage=now.stage + 1)
    return stands._replace(step_size=look.step_size, waiting=waiting)


class _Clock:
    """How long the rest takes, from the steps that were taken: about, since nobody knows how many are to come."""

    def __init__(self, machine: Machine, spp: int, max_steps: int) -> None:
        height, width, _ = machine.problem.target.shape
        self._samples = [_samples(spp, stage) for stage in range(len(STAGES))]
        self._edges = 4 * machine.problem.edges / (height * width)
        self._max_steps = max_steps
        self._taken = [0] * len(STAGES)
        self._begun: float | None = None
        self._paid = 0.0

    def left(self, stage: int, now: Progress) -> float | None:
        """Return the seconds that are left after a step of the stage, None after the first, which compiles."""
        self._taken[stage] += 1
        if self._begun is None:
            self._begun = time.perf_counter()
            return None
        costs = [samples + FIXED + self._edges * now.rounds for samples in self._samples]
        self._paid += costs[stage]
        steps = [max(1, USUAL - taken) if i >= now.stage else 0 for i, taken in enumerate(self._taken)]
        share = min(1.0, (self._max_steps - now.step) / max(1, sum(steps)))
        ahead = share * sum(n * cost for n, cost in zip(steps, costs, strict=True))
        # Two pictures for each of the last steps, two of the start, and those that judge
        ahead += (2 * POLISH + 2 + JUDGES) * costs[-1]
        return (time.perf_counter() - self._begun) * ahead / self._paid


def _polish(machine: Machine, now: Progress, how: Drawing, seed: int) -> Progress:
    """Return where the fit stands without the bias of one set of samples: DONE, if a step took it away.

    Noise is in the residual and in its Jacobian alike: the least sum of squares is where both are small, which favours
    what is dark and direct. Here the Jacobian of other samples, an instrument, meets the residual: J₂ᵀ r₁ = 0 has no
    such bias. A step counts if the product of two residuals, a loss without bias, falls.
    """
    seeds = _fresh(seed, 0), _fresh(seed, 1)
    residuals, jacobians = _all_sets(machine, now.vector, how, seeds)
    loss = float(np.sum(residuals[0] * residuals[1]))
    for _ in range(POLISH):
        moves = [instrumental(jacobians[i], jacobians[1 - i], TINY) @ residuals[i].ravel() for i in (0, 1)]
        trial = (now.vector - np.mean(moves, axis=0)).astype(now.vector.dtype)
        if not np.abs(trial - now.vector).max() < LARGEST_MOVE:
            break
        residuals, jacobians = _all_sets(machine, trial, how, seeds)
        gained = float(np.sum(residuals[0] * residuals[1]))
        if not gained < loss:
            break
        now, loss = now._replace(vector=trial, stage=DONE), gained
    return now


def _fresh(seed: int, number: int) -> int:
    """Return a seed of the last steps (0, 1) or of the verdict (2 to 5): none that a target or another fit is drawn by.

    A target of the same samples has the same noise, and what is left of the two says nothing of either.
    """
    return (FRESH + 8 * seed + number) % 2**32


def _sets(machine: Machine, vector: Vector, how: Drawing, seeds: Sequence[int]) -> tuple[list[Floats], list[Floats]]:
    """Return residuals and Jacobians of some seeds."""
    found = [machine.evaluate(vector, seed, how) for seed in seeds]
    return [residual for residual, _ in found], [jacobian for _, jacobian in found]


def _all_sets(
    machine: Machine, vector: Vector, how: Drawing, seeds: Sequence[int]
) -> tuple[list[Floats], list[Floats]]:
    """Return residuals and Jacobians of some seeds, with what is to be small besides."""
    found = [machine.evaluate_all(vector, seed, how) for seed in seeds]
    return [residual for residual, _ in found], [jacobian for _, jacobian in found]


def _begin(machine: Machine, starts: int, spp: int, seed: int) -> Progress:
    """Return where the first step is taken from: the scene's own start, or the best of `starts`."""
    begun = Progress(0, 0, machine.start, math.inf, ())
    if starts == 1:
        return begun
    if machine.problem.blurs:
        return begun._replace(stage=1, vector=_nearest_outlines(machine, starts, spp, seed))
    trials = machine.start + _moves(machine, starts, seed)
    losses = [np.sum(machine.evaluate(trial, seed, _drawing(spp, 0))[0] ** 2) for trial in trials]
    return begun._replace(vector=trials[int(np.argmin(losses))])


def _nearest_outlines(machine: Machine, starts: int, spp: int, seed: int) -> Vector:
    """Return the start whose outlines are the nearest, some steps down.

    Places are found by the blurred pictures of the first stage, whichever way things are turned. There they are turned
    in other ways, and of those that look best in the pictures of the second stage, the best few go some steps down:
    what is turned the wrong way may look nearest at first.
    """
    start, turns = machine.start, _are(machine, "turn")
    blurred = machine.steps(start, seed, _drawing(spp, 0))
    there = next(islice(blurred, TRIAL_STEPS - 1, None)).vector
    base = np.where(turns, start, there) if turns.any() else start
    trials = [there, *(base + _moves(machine, starts, seed))[1:]]
    looks = [machine.steps(trial, seed, _drawing(spp, 1)) for trial in trials]
    order = np.argsort([next(look).loss for look in looks], kind="stable")
    ends = [next(islice(looks[i], TRIAL_STEPS - 1, None)) for i in order[:FINALISTS]]
    return min(ends, key=lambda look: look.loss).vector


def _moves(machine: Machine, starts: int, seed: int) -> Vector:
    """Return by how much other starts (starts, k) are moved and turned, the first not at all."""
    widths = TRIAL_BOX * _are(machine, "place", "shift")
    if machine.problem.blurs:
        turns = _are(machine, "turn")
        widths = TRIAL_TURN * turns if turns.any() else TRIAL_SHAPES * widths
    moves = np.random.default_rng(seed).uniform(-1, 1, (starts, len(widths))) * widths
    moves[0] = 0
    return moves.astype(machine.start.dtype)


def _are(machine: Machine, *kinds: str) -> NDArray[np.bool_]:
    """Return which components (k,) are of unknowns of these kinds."""
    return np.concatenate([np.full(row.size, row.kind in kinds) for row in machine.problem.unknowns.rows])


def _judged(machine: Machine, start: Vector, now: Progress, spp: int, seed: int, interrupted: int) -> Found:
    """Return what was found with its verdict, or the start if that is better on fresh seeds."""
    problem, seeds = machine.problem, [_fresh(seed, 2 + k) for k in range(JUDGES)]
    how, sets = Drawing(spp, rounds=now.rounds), 2 if now.stage == DONE else 1
    before = [machine.evaluate(start, each, how)[0] for each in seeds[:2]]
    residuals, jacobians = _sets(machine, now.vector, how, seeds)
    # The product of two residuals: a sum of squares would favour what is less noisy
    losses = np.sum(before[0] * before[1]), np.sum(residuals[0] * residuals[1])
    if losses[0] + problem.roughness(start) < losses[1] + problem.roughness(now.vector):
        now = now._replace(vector=start)
        residuals, jacobians = _sets(machine, start, how, seeds)
    labels, places = problem.unknowns.labels(), _are(machine, "place", "shift")
    smooth = None if problem.smooth is None else (problem.smooth, problem.smooth @ now.vector)
    rounding = rounding_of(problem.target, problem.weight, problem.scale) if problem.outputs == RADIANCE else 0.0
    verdict = judge(residuals, jacobians, labels, places, sets, smooth, rounding)
    target = np.asarray(problem.target * problem.weight, float)
    pictures = before[0] * problem.scale + target, residuals[0] * problem.scale + target
    return Found(now.vector, verdict, now, interrupted, pictures)
