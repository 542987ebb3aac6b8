"""Whether a fit's standard errors are those of its answers, where the truth is known: of pictures that are linear.

The last steps end at the answer of two sets of samples, whose noise is half of one's; the target's is whole.
"""

import numpy as np

from jaxrt.fit import Progress, descent
from jaxrt.fit.descent import DONE, JUDGES, STAGES
from jaxrt.fit.solve import Drawing
from jaxrt.fit.targets import rounding_of
from jaxrt.fit.verdict import REACHES, Verdict, judge, neighbours, structure

TRUTH = np.array([0.7, 0.4])
FITS = 600


class Proportional:
    """Pictures J θ (1 + noise): a derivative has the noise of its picture, the channels of a pixel the same."""

    def __init__(self, target: int) -> None:
        rng = np.random.default_rng(0)
        self.slopes = rng.normal(size=(10, 15, 3, 2))
        self.spread = 0.2 * np.exp(0.5 * rng.normal(size=(10, 15, 1, 1)))
        self.target = self.drawn(target) @ TRUTH

    def drawn(self, seed: int) -> np.ndarray:
        return self.slopes * (1 + self.spread * np.random.default_rng(seed).normal(size=self.spread.shape))

    def evaluate(self, vector: np.ndarray, seed: int, how: Drawing) -> tuple[np.ndarray, np.ndarray]:
        slopes = self.drawn(seed)
        return slopes @ vector - self.target, slopes

    evaluate_all = evaluate  # nothing is to be small besides


def test_errors_are_those_of_answers_that_two_sets_of_samples_give() -> None:
    """Variance over what is told is 1 ± 0.041, whichever seed a target has: 4σ. By one set's noise it were 0.75."""
    off, told = [], []
    for seed in range(0, 10 * FITS, 10):
        machine = Proportional(target=seed + seed // 10 % 4)
        begun = Progress(0, len(STAGES), TRUTH + 0.1, np.inf, ())
        ended = descent._polish(machine, begun, Drawing(1), seed)
        assert ended.stage == DONE
        drawn = descent._sets(machine, ended.vector, Drawing(1), [descent._fresh(seed, 2 + k) for k in range(JUDGES)])
        verdict = judge(*drawn, ["a", "b"], np.zeros(2, bool), sets=2)
        off.append(ended.vector - TRUTH)
        told.append(verdict.errors)
    ratio = np.mean(np.square(off), axis=0) / np.mean(np.square(told), axis=0)
    assert abs(ratio.mean() - 1) < 4 * np.sqrt(2 / np.size(off)), ratio
    z = np.mean(off, axis=0) / np.std(off, axis=0) * np.sqrt(FITS)
    assert np.all(np.abs(z) < 4), z


def test_last_steps_and_verdicts_have_seeds_of_their_own() -> None:
    seeds = {descent._fresh(seed, k) for seed in range(100) for k in range(2 + JUDGES)}
    assert len(seeds) == 100 * (2 + JUDGES) and min(seeds) > 10_000


def noise(rng: np.random.Generator) -> list[np.ndarray]:
    """Return residuals of four sets of samples: heavy-tailed noise that channels share, uneven, and the target's."""
    uneven = np.exp(0.7 * rng.normal(size=(24, 24, 1)))
    target = uneven * rng.normal(size=(24, 24, 1)) / 4
    return [target + uneven * rng.standard_t(4, size=(24, 24, 1)) * np.ones(3) for _ in range(JUDGES)]


def test_noise_has_no_structure_but_by_the_rate_that_is_told() -> None:
    """Of 400 pictures' standardised structure the spread is 1, known to 3.5 %, and the mean 0, to .05: 4σ."""
    rng = np.random.default_rng(1)
    for reach in REACHES:
        pairs = neighbours(reach)
        z = np.array([np.divide(*structure(noise(rng), pairs)) for _ in range(400)])
        assert abs(z.mean()) < 0.2 and abs(z.std() - 1) < 0.14, (reach, z.mean(), z.std())


def verdict_of_a_slope(
    answer: float, spread: float, target: np.ndarray | None = None, rounding: bool = True
) -> Verdict:
    """Return the verdict on an answer whose truth is 1, of a picture that grows from 0.3 to 0.9, by its factor."""
    rng, slope = np.random.default_rng(2), np.linspace(0.3, 0.9, 60)[:, None, None] * np.ones((60, 40, 3))
    target = slope if target is None else target
    slopes = [slope + spread * rng.normal(size=(60, 40, 1)) for _ in range(JUDGES)]
    size = np.linalg.norm(target)
    drawn = [(one * answer - target) / size for one in slopes], [one[..., None] / size for one in slopes]
    added = rounding_of(target, np.ones(1), size) if rounding else 0.0
    return judge(*drawn, ["a"], np.zeros(1, bool), sets=2, rounding=added)


def test_an_answer_off_its_minimum_is_told_by_its_errors() -> None:
    """The error is .0005. An answer 8 of it off says so; one 20 of it off is not where fits end."""
    near, far, beyond = (verdict_of_a_slope(1 + off, 0.02) for off in (5e-4, 4e-3, 1e-2))
    assert near.word == far.word == "solved"
    assert 4e-4 < near.errors[0] < 6e-4 and 4e-3 * 0.75 < far.errors[0] < 4e-3 * 1.25
    assert beyond.word == "stalled" and beyond.structured < 0.011


def test_rounding_to_8_bits_is_explained_and_no_more() -> None:
    slope = np.linspace(0.3, 0.9, 60)[:, None, None] * np.ones((60, 40, 3))
    rounded = (np.round(255 * slope ** (1 / 2.2)) / 255) ** 2.2
    assert verdict_of_a_slope(1.0, 1e-4, rounded).word == "solved"
    assert verdict_of_a_slope(1.0, 1e-4, rounded, rounding=False).word == "stalled"
    assert verdict_of_a_slope(1.0, 1e-4, np.where(slope > 0.5, 1.01, 1) * rounded).word == "stalled"
    assert rounding_of(slope + 1e-4 * np.random.default_rng(3).normal(size=slope.shape), np.ones(1), np.ones(1)) == 0
