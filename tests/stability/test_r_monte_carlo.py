"""Streams, sums and convergence: cases R1-R6, R8 and X10.

Seeds are fixed: a test passes always or never. The false-alarm rates say how often random seeds would fail.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from scipy import stats

from jaxrt.core.maths import kahan_add
from jaxrt.core.samplers import SAMPLERS, Stream
from jaxrt.kernels.native import map_packets

N = 40_000


def numbers(name, pixel, sample, seed=0, spp=16, block=0):
    """Return (4, …) numbers of the broadcast arguments, from jitted calls of 40 000 rows: one compilation."""
    args = np.broadcast_arrays(*(np.asarray(x).astype(np.uint32) for x in (pixel, sample, seed, spp, block)))
    shape = args[0].shape
    size = args[0].size
    rows = [np.resize(a, -(-size // N) * N).reshape(-1, N) for a in args]
    parts = [np.stack(NUMBERS[name](Stream(*row[:4]), row[4])) for row in zip(*rows, strict=True)]
    return np.concatenate(parts, 1)[:, :size].reshape(4, *shape)


NUMBERS = {name: jax.jit(jax.vmap(f)) for name, f in SAMPLERS.items()}


def sidak(comparisons, alpha=1e-4):
    """Return the two-sided z that random data exceed with probability alpha in any of so many comparisons."""
    return stats.norm.isf((1 - (1 - alpha) ** (1 / comparisons)) / 2)


def max_correlation(x, y):
    """Return the largest |z| of the correlations between any number of x and any of y: (k, n) each."""
    return abs(np.corrcoef(x, y)[: len(x), len(x) :]).max() * np.sqrt(x.shape[1])


NEIGHBOURS = {
    "pixel": ((1, 0, 0, 0), (256, 0, 0, 0), (2**16, 0, 0, 0)),
    "sample": ((0, 1, 0, 0), (0, 2, 0, 0), (0, 8, 0, 0)),
    "seed": ((0, 0, 1, 0), (0, 0, 2**16, 0)),
    "block": ((0, 0, 0, 1), (0, 0, 0, 3)),
    "mixed": ((1, 0, -1, 0), (1, -1, 0, 0), (-1, 0, 0, 1)),
}


@pytest.mark.parametrize("kind", NEIGHBOURS)
@pytest.mark.parametrize("name", SAMPLERS)
def test_r1_neighbours_are_uncorrelated(figures, name, kind):
    """|r| < 4/√n for each of 16 pairs of numbers a shift: 1 % false alarms per shift of a random seed.

    One sample for each of 40 000 pixels: within a pixel the samples of a stratified sampler repel each other.
    """
    pixel = 2 * np.arange(N)
    base = np.array([pixel, np.full(N, 9), np.full(N, 100), np.full(N, 3)])
    x = numbers(name, base[0], base[1], base[2], block=base[3])
    for shift in NEIGHBOURS[kind]:
        if kind == "sample" and name != "independent":
            continue
        p, s, k, b = base + np.array(shift)[:, None]
        z = max_correlation(x, numbers(name, p, s, k, block=b))
        figures("R1", "correlation of neighbouring pixels, samples, seeds, decisions, in σ", ours=z, at_most=4)


@pytest.mark.parametrize("name", SAMPLERS)
def test_r1_each_number_is_uniform(name):
    """chi² of 32 × 32 cells of both pairs, for one sample a pixel; alpha = 1e-4 per pair."""
    x = numbers(name, np.arange(N), 11, seed=1, spp=16, block=2)
    for i, j in ((0, 1), (2, 3), (0, 2), (1, 2), (0, 3), (1, 3)):
        counts = np.histogram2d(x[i], x[j], 32, [[0, 1], [0, 1]])[0]
        assert stats.chi2.sf(((counts - N / 1024) ** 2).sum() / (N / 1024), 1023) > 1e-4


@pytest.mark.parametrize("name", SAMPLERS)
def test_r1_frames_are_not_shifted_copies(figures, name):
    """With seed + pixel as one number, pixel p of frame 1 would be pixel p + 1 of frame 0."""
    naive = [numbers("independent", 0, 0, seed=frame + np.arange(100)) for frame in (0, 1)]
    np.testing.assert_array_equal(naive[1][:, :-1], naive[0][:, 1:])
    first, second = (numbers(name, np.arange(N), 0, seed=frame) for frame in (0, 1))
    z, bad = (max_correlation(b[:, :-1], a[:, 1:]) for a, b in ((first, second), naive))
    figures(
        "R1", "correlation of pixel p with p + 1 a frame later, in σ; naive: seed + pixel", naive=bad, ours=z, at_most=4
    )


@pytest.mark.parametrize("name", SAMPLERS)
def test_r1_r6_product_moments(figures, name):
    """E[u_i u_j] = 1/4 for the 190 pairs among 20 dimensions; Šidák's bound, false alarms < 1e-4.

    2500 pixels of 16 samples. Means over pixels give σ, because samples of a pixel depend on each other. A
    dimension used twice gives 1/3, and this test would see it.
    """
    pixel, sample, block = np.meshgrid(np.arange(2500), np.arange(16), np.arange(5), indexing="ij")
    x = numbers(name, pixel, sample, seed=4, block=block)
    u = np.moveaxis(x, 0, -1).reshape(2500, 16, 20).astype(np.float64)
    moments = np.einsum("psi,psj->pij", u, u) / 16
    z = (moments.mean(0) - 0.25) / (moments.std(0) / 50)
    upper = np.triu_indices(20, 1)
    assert np.diag(moments.mean(0)) == pytest.approx(1 / 3, abs=5e-3)
    found, twice, limit = abs(z[upper]), np.diag(z).min(), sidak(190)
    figures(
        "R1",
        "E[u v] of 190 pairs of dimensions, in σ off 1/4; naive: one used twice",
        naive=twice,
        ours=found,
        at_most=limit,
    )
    figures(
        "R6",
        "E[u v] of dimensions of other decisions, in σ; naive: one used twice",
        naive=twice,
        ours=found,
        at_most=limit,
    )


def test_r6_padded_pairs_are_shuffled_apart(figures):
    """64 samples of dimensions 0 and 2 fill 64(1-1/e) cells of 8 × 8; with one order for both, only 8."""
    pixel, sample = np.divmod(np.arange(64 * 600), 64)
    a, _, c, _ = numbers("sobol", pixel, sample, spp=64)
    cells = (np.floor(8 * a) * 8 + np.floor(8 * c)).reshape(600, 64)
    filled = np.mean([len(set(row)) for row in cells])
    radical = sum(((sample >> k) & 1) / 2.0 ** (k + 1) for k in range(6))
    naive = np.floor(8 * radical[:64]) * 8 + 7 - np.floor(8 * radical[:64])
    assert filled < 43
    figures(
        "R6",
        "of 64 cells, filled by 64 samples of two decisions; naive: one order",
        naive=len(set(naive)),
        ours=filled,
        at_least=38,
    )


TERMS = 100_000_000


def constant_sum(add, initial):
    """Return the sum of 1e8 terms of .5, from a native loop of scalar additions."""

    def packet(x, _):
        return lax.fori_loop(0, TERMS, lambda _, state: add(state, x), initial)

    return jax.jit(lambda x: map_packets(packet, x, jnp.arange(1)))(jnp.float32(0.5))


def test_r2_compensated_sum_of_1e8_constants(figures):
    """Plain float32 stops at 2²³, 17 % of the truth; the compensated sum survives jit and is right."""
    zero = jnp.float32(0)
    plain = constant_sum(lambda total, x: total + x, zero)
    assert plain[0] == 2.0**23
    total, _ = constant_sum(lambda state, x: kahan_add(*state, x), (zero, zero))
    naive, error = (abs(float(x[0]) / (0.5 * TERMS) - 1) for x in (plain, total))
    figures("R2", "relative error of a sum of 1e8 halves", naive=naive, ours=error, at_most=1e-6)


def smooth(x, y):
    return np.exp(-x * x - y * y)


def edge(x, y):
    return np.where(x * x + y * y < 0.7, 1.0, 0.0)


INTEGRANDS = {"smooth": (smooth, 0.5577462853510337), "edge": (edge, np.pi * 0.7 / 4)}
REPEATS = 256
COUNTS = 2 ** np.arange(2, 11)  # 8 octaves


def errors(name, integrand, n):
    """Return REPEATS estimates' errors with n samples each: two pairs for each of 128 pixels."""
    f, truth = INTEGRANDS[integrand]
    pixel, sample = np.meshgrid(np.arange(REPEATS // 2), np.arange(n), indexing="ij")
    a, b, c, d = numbers(name, pixel, sample, seed=n, spp=n, block=1).astype(np.float64)
    return np.concatenate([f(a, b).mean(1), f(c, d).mean(1)]) - truth


@pytest.fixture(scope="module")
def rmse():
    return {
        (name, integrand): np.array([np.sqrt(np.mean(errors(name, integrand, n) ** 2)) for n in COUNTS])
        for name in SAMPLERS
        for integrand in INTEGRANDS
    }


SLOPES = {  # of RMSE against n: (integrand, sampler) -> interval, what it is
    ("smooth", "independent"): (-0.55, -0.45, "error falls with samples to this power: independent"),
    ("edge", "independent"): (-0.55, -0.45, "error falls with samples to this power: independent"),
    ("smooth", "stratified"): (
        -1.1,
        -0.9,
        "error falls with samples to this power: stratified, smooth; naive: independent",
    ),
    ("edge", "stratified"): (
        -0.85,
        -0.65,
        "error falls with samples to this power: stratified, with an edge; naive: independent",
    ),
    ("smooth", "sobol"): (-1.75, -1.3, "error falls with samples to this power: Sobol', smooth; naive: independent"),
    ("edge", "sobol"): (
        -0.85,
        -0.65,
        "error falls with samples to this power: Sobol', with an edge; naive: independent",
    ),
}


@pytest.mark.parametrize(("integrand", "name"), SLOPES)
def test_r3_convergence_slope(figures, rmse, integrand, name):
    """Over 8 octaves, 256 repeats: the RMSE of each n is known to 4.4 %, the slope to .01, so .05 is 5σ.

    Stratified at square counts: its grid has empty cells in between, where the error falls as n^-.75.
    """
    squares = slice(None, None, 2 if name == "stratified" else 1)
    slope, independent = (
        np.polyfit(np.log(COUNTS[squares]), np.log(rmse[sampler, integrand][squares]), 1)[0]
        for sampler in (name, "independent")
    )
    low, high, what = SLOPES[integrand, name]
    assert low < slope
    naive = None if name == "independent" else independent
    figures("R3", what, naive=naive, ours=slope, at_most=high)


@pytest.mark.parametrize("integrand", INTEGRANDS)
@pytest.mark.parametrize("name", ["stratified", "sobol"])
def test_r3_never_above_monte_carlo(figures, rmse, name, integrand):
    """From 4 samples on; the ratio of two RMSE has σ = 6 %, the measured ratios are below .75."""
    share = rmse[name, integrand] / rmse["independent", integrand]
    figures(
        "R3", "error of stratified and Sobol' samples over that of independent ones", naive=1.0, ours=share, at_most=0.9
    )


@pytest.mark.parametrize("integrand", INTEGRANDS)
@pytest.mark.parametrize("name", SAMPLERS)
def test_r3_no_bias(figures, name, integrand):
    """Mean error within 4σ at 1, 7 and 64 samples: 6e-5 false alarms each."""
    for n in (1, 7, 64):
        e = errors(name, integrand, n)
        z = abs(e.mean()) / (e.std() / np.sqrt(REPEATS))
        figures("R3", "mean error at 1, 7 and 64 samples, in σ", ours=z, at_most=4)


def test_r4_sobol_beyond_powers_of_two(figures):
    """1000 points lose most of the gain of 1024 on a smooth integrand, nothing on an edge."""

    def rms(name, integrand, n):
        return np.sqrt(np.mean(errors(name, integrand, n) ** 2))

    loss = rms("sobol", "smooth", 1000) / rms("sobol", "smooth", 1024)
    assert loss > 3
    figures("R4", "error of 1000 Sobol' samples over that of 1024, smooth integrand", ours=loss, at_most=15)
    assert 0.7 < rms("sobol", "edge", 1000) / rms("sobol", "edge", 1024) < 1.4
    for integrand in INTEGRANDS:
        assert rms("sobol", integrand, 1000) < 0.5 * rms("independent", integrand, 1000)


def test_r5_stratified_is_unbiased_for_every_count(figures):
    """n = 1 … 100, with Šidák's bound over 100: false alarms < 1e-4. Naive: ⌊√n⌋² strata, divided by n."""
    n, pixel, sample = np.meshgrid(np.arange(1, 101), np.arange(400), np.arange(100), indexing="ij")
    a, b, _, _ = numbers("stratified", pixel, sample, seed=5, spp=n).astype(np.float64)
    used = sample < n
    f = (a + 2 * b * b) * used
    estimates = f.sum(2) / np.arange(1, 101)[:, None]
    z = (estimates.mean(1) - (0.5 + 2 / 3)) / (estimates.std(1) / 20)
    strata_used = np.floor(np.sqrt(n)) ** 2
    naive = (f * (sample < strata_used)).sum(2) / np.arange(1, 101)[:, None]
    naive_z = (naive.mean(1) - (0.5 + 2 / 3)) / (naive.std(1) / 20)
    assert np.sum(abs(naive_z) > sidak(100)) > 80
    worst, bad, limit = abs(z), abs(naive_z), sidak(100)
    figures(
        "R5",
        "bias of stratified means of 1 to 100 samples, in σ; naive: ⌊√n⌋² strata",
        naive=bad,
        ours=worst,
        at_most=limit,
    )


@pytest.mark.parametrize("integrand", INTEGRANDS)
def test_r8_error_bars_come_from_seeds(figures, integrand):
    """σ/√n of one run of 64 Sobol' samples takes them for independent; 16 seeds tell the error that they have.

    2048 seeds: 64 times 16 report an error each, 18 % uncertain by itself; their RMS, against the scatter of the other
    1024, is known to 3.2 %. So 0.15 is left by chance 3 times in 10⁶.
    """
    f, _ = INTEGRANDS[integrand]
    seed, sample = np.meshgrid(np.arange(2048), np.arange(64), indexing="ij")
    a, b, _, _ = numbers("sobol", 7, sample, seed=seed, spp=64, block=1).astype(np.float64)
    values = f(a, b)
    runs, others = values[:1024], values[1024:].mean(1).std(ddof=1)
    reported = runs.mean(1).reshape(64, 16).std(1, ddof=1)
    within = runs.std(1, ddof=1) / np.sqrt(64)
    bad, off = (abs(np.sqrt(np.mean(x**2)) / others - 1) for x in (within, reported))
    figures(
        "R8",
        "relative error of error bars of 64 Sobol' samples, from 16 seeds; naive: from within a run",
        naive=bad,
        ours=off,
        at_most=0.15,
    )


@pytest.mark.parametrize("name", SAMPLERS)
def test_x10_streams_near_2_to_31_are_distinct(figures, name):
    """Pixel and sample indices around 2³¹ and up to 2³²: no two blocks alike.

    Two random blocks of 4 × 24 bits coincide with probability 2^-96. A linear 32-bit index, with 1024 samples
    each, takes pixel 2²² for pixel 0.
    """
    border = np.array([0, 2**22, 2**31, 2**32 - 100], np.int64)[:, None] + np.arange(-50, 50)
    near = border.ravel() % 2**32
    pixel, sample = np.meshgrid(near, near, indexing="ij")
    x = numbers(name, pixel, sample, spp=2**32 - 1).reshape(4, -1)
    linear = (pixel.astype(np.uint32) * np.uint32(1024) + sample.astype(np.uint32)).ravel()
    naive, same = (1 - n / x.shape[1] for n in (len(np.unique(linear)), len(np.unique(x, axis=1).T)))
    figures("X10", "share of equal streams among indices near 2³¹ and 2³²", naive=naive, ours=same, at_most=0)
