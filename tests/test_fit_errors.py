"""Whether a fit's standard errors are those of its answers, where the truth is known: of pictures that are linear.

The last steps end at the answer of two sets of samples, whose noise is half of one's; the target's is whole.
"""

import numpy as np

from jaxrt.fit import Progress, descent
from jaxrt.fit.descent import DONE, JUDGES, STAGES
from jaxrt.fit.solve import Drawing
from jaxrt.fit.verdict import judge

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
