"""Frames, warps and the ends of [0, 1): cases F1-F7. Where a naive method exists, its failure is asserted."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrt.core import maths, sampling
from jaxrt.core.samplers import SAMPLERS, Stream, place_in_cell

LAST = np.float32(1 - 2.0**-24)  # the greatest float32 below 1
SAMPLES = {  # (normal, shape parameter, u), and the parameters to try
    "cosine": (lambda n, _, u: sampling.sample_cosine_hemisphere(n, u), [0]),
    "sphere": (lambda n, _, u: sampling.sample_uniform_sphere(u), [0]),
    "cone": (sampling.sample_cone, [0, 0.3, 1]),
    "cap": (sampling.sample_visible_cap, [0, 0.5, 1]),
}


def unit_vectors(n, seed=0):
    v = np.random.default_rng(seed).normal(size=(n, 3))
    return (v / np.linalg.norm(v, axis=1, keepdims=True)).astype(np.float32)


def hard_normals():
    """Return unit vectors at and near poles and equator, and the two bad ones of Duff et al. (2017)."""
    r = np.geomspace(1e-12, 0.5, 500)
    phi = np.linspace(0, 50, 500)
    ring = np.stack([r * np.cos(phi), r * np.sin(phi), -np.sqrt(1 - r * r)], 1)
    bad = [
        [0.00038527316, 0.00038460016, -0.99999988079],
        [-0.00019813581, -0.00008946839, -0.99999988079],
    ]
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    signed_zeros = [[1, 0, -0.0], [1, 0, 0.0], [0.6, 0.8, -0.0]]
    return np.concatenate([ring, ring * [1, 1, -1], bad, axes, signed_zeros]).astype(np.float32)


def frame_error(n, t, b):
    """Return pbrt's metric: the mean square of the six deviations from orthonormality, and the handedness."""
    n, t, b = (np.asarray(v, np.float64) for v in (n, t, b))
    lengths = [np.linalg.norm(v, axis=1) - 1 for v in (n, t, b)]
    dots = [(n * t).sum(1), (t * b).sum(1), (b * n).sum(1)]
    return sum(e**2 for e in lengths + dots) / 6, (np.cross(t, b) * n).sum(1)


def frisvad(n):
    """Frisvad (2012), the method that Duff et al. corrected: 1/(1+z) explodes as z → -1."""
    x, y, z = n
    a = 1 / (1 + z)
    return jnp.stack([1 - x * x * a, -x * y * a, -x]), jnp.stack([-x * y * a, 1 - y * y * a, -y])


@pytest.mark.parametrize("n", [1000, 40_000])
def test_f1_frame_is_orthonormal_everywhere(figures, n):
    normals = np.concatenate([hard_normals(), unit_vectors(n)])[-n:]
    normals = normals if n > 1000 else hard_normals()
    error, handed = frame_error(normals, *jax.jit(jax.vmap(sampling.frame))(normals))
    assert handed.min() > 0.999
    hard = hard_normals()
    with np.errstate(invalid="ignore"):
        bad = frame_error(hard, *jax.jit(jax.vmap(frisvad))(hard))[0]
    figures(
        "F1", "mean square deviation of frames from orthonormal; naive: Frisvad's", naive=bad, ours=error, at_most=1e-10
    )


def test_f1_frame_derivative_is_finite(figures):
    normals = hard_normals()
    slopes = np.abs(jax.jit(jax.vmap(jax.jacfwd(sampling.frame)))(normals)).max()
    bad = np.abs(jax.jit(jax.vmap(jax.jacfwd(frisvad)))(normals)).max()
    figures("F1", "largest derivative of a frame in its normal; naive: Frisvad's", naive=bad, ours=slopes, at_most=10)


def concentric(u):
    """Shirley & Chiu's (1997) disk without a guard."""
    x, y = 2 * u[0] - 1, 2 * u[1] - 1
    wide = abs(x) > abs(y)
    phi = jnp.where(wide, jnp.pi / 4 * (y / x), jnp.pi / 2 - jnp.pi / 4 * (x / y))
    return jnp.where(wide, x, y) * jnp.stack([jnp.cos(phi), jnp.sin(phi)])


@pytest.mark.parametrize("name", SAMPLES)
def test_f2_disk_centre(figures, name):
    """The first 64 points of the unscrambled sequence, the second of which is exactly (.5, .5)."""
    i = np.arange(64)
    radical = sum(((i >> k) & 1) / 2.0 ** (k + 1) for k in range(6))
    u = np.stack(np.meshgrid(radical, radical), -1).reshape(-1, 2).astype(np.float32)
    assert np.all(u[65] == 0.5)
    bad = np.isnan(concentric(jnp.float32([0.5, 0.5]))).sum()
    sample, parameters = SAMPLES[name]
    d = jax.jit(jax.vmap(sample, (None, None, 0)))(jnp.float32([0, 0.6, -0.8]), jnp.float32(parameters[-1]), u)
    wrong = np.count_nonzero(~np.isfinite(d))
    figures(
        "F2", "numbers not finite of the first Sobol' points; naive: concentric disk", naive=bad, ours=wrong, at_most=0
    )
    np.testing.assert_allclose((np.asarray(d) ** 2).sum(1), 1, atol=2e-6)


def test_f3_grazing_cosine_sample(figures):
    """At cosθ = 0 the quotient f·cosθ/pdf is NaN; the direction and its derivative are finite."""
    n, u = jnp.float32([0, 0, 1]), jnp.float32([0.3, 0])
    d = sampling.sample_cosine_hemisphere(n, u)
    cos = d[2]
    assert cos == 0 and sampling.pdf_cosine_hemisphere(cos) == 0
    slopes = jax.jit(jax.jacrev(sampling.sample_cosine_hemisphere, (0, 1)))(n, u)
    bad = int(jnp.isnan(0.5 / jnp.pi * cos / sampling.pdf_cosine_hemisphere(cos)))
    wrong = sum(np.count_nonzero(~np.isfinite(j)) for j in slopes)
    figures("F3", "numbers not finite of a sample at cosθ = 0; naive: f cosθ/pdf", naive=bad, ours=wrong, at_most=0)


def test_f4_last_stratum_stays_below_one(figures):
    """(n-1+u)/n rounds to 1 for many n; a stratum's last number never does, for every n of a grid."""
    n = np.arange(1, 1026, dtype=np.uint32)
    naive = (n.astype(np.float32) - 1 + LAST) / n.astype(np.float32)
    placed = jax.jit(place_in_cell)(n - 1, n, np.full(n.shape, LAST))
    bad, wrong = np.sum(naive == 1), np.sum(np.asarray(placed) > LAST)
    assert bad > 100
    figures("F4", "of 1025 last strata, those that reach 1; naive: (n − 1 + u)/n", naive=bad, ours=wrong, at_most=0)
    assert np.all(np.floor(np.asarray(placed) * n.astype(np.float32)) == n - 1)


NUMBERS = {name: jax.jit(jax.vmap(lambda s, f=f: f(s, 3), (Stream(0, 0, None, None),))) for name, f in SAMPLERS.items()}


@pytest.mark.parametrize("spp", [1, 4, 16, 1000, 1_000_000])
@pytest.mark.parametrize("name", SAMPLERS)
def test_f4_numbers_stay_below_one(name, spp):
    """160 000 numbers; also the index that code makes of one, ⌊n·u⌋, stays below n."""
    i = np.arange(40_000, dtype=np.uint32)
    stream = Stream(i // np.uint32(spp), i % np.uint32(spp), np.uint32(7), np.uint32(spp))
    x = np.stack(NUMBERS[name](stream))
    assert x.dtype == np.float32 and x.min() >= 0 and x.max() < 1
    for n in np.float32([3, 4, 16, 1000, 1e6]):
        assert np.floor(np.append(x, LAST) * n).max() < n


@pytest.mark.parametrize("name", SAMPLES)
def test_f5_ends_of_the_interval(figures, name):
    """u = 0 and the greatest u, in all four corners: finite values and derivatives, for u and the normal."""
    corners = jnp.float32([[a, b] for a in (0, LAST) for b in (0, LAST)])
    sample, parameters = SAMPLES[name]
    normals = jnp.float32([[0, 0, 1], [0, 0, -1], [0.48, -0.6, 0.64]])
    cases = [c.reshape(-1, *c.shape[3:]) for c in _product(normals, jnp.float32(parameters), corners)]
    d, j = jax.jit(jax.vmap(lambda *c: (sample(*c), jax.jacrev(sample, (0, 1, 2))(*c))))(*cases)
    np.testing.assert_allclose((np.asarray(d) ** 2).sum(1), 1, atol=2e-6)
    bad = int(jnp.isinf(jax.grad(jnp.sqrt)(jnp.float32(0))))
    wrong = sum(np.count_nonzero(~np.isfinite(x)) for x in j)
    figures("F5", "derivatives not finite at the ends of [0, 1); naive: √u at 0", naive=bad, ours=wrong, at_most=0)


def _product(a, b, c):
    """Return a, b and c spread over three leading axes."""
    shape = (len(a), len(b), len(c))
    return (
        jnp.broadcast_to(a[:, None, None], (*shape, 3)),
        jnp.broadcast_to(b[None, :, None], shape),
        jnp.broadcast_to(c[None, None], (*shape, 2)),
    )


def test_f6_face_forward_keeps_the_normal(figures):
    """With `sign` a normal seen edge-on becomes 0; with `sign_or_one` it never does."""
    n = unit_vectors(40_000)
    w = np.cross(n, unit_vectors(40_000, seed=1)).astype(np.float32)
    edge_on = np.concatenate([jnp.sum(n * w, 1), jnp.float32([0.0, -0.0])])
    signs = np.asarray(jax.jit(maths.sign_or_one)(edge_on))
    assert signs.dtype == np.float32
    bad, wrong = np.sum(jnp.sign(edge_on) == 0), np.sum(abs(signs) != 1)
    figures("F6", "normals lost of 40 002 seen edge-on; naive: sign(0) = 0", naive=bad, ours=wrong, at_most=0)


NORMALIZE = jax.jit(jax.vmap(maths.normalize))
NAIVE_NORMALIZE = jax.jit(jax.vmap(lambda v: v / jnp.sqrt(jnp.sum(v * v))))


@pytest.mark.parametrize("exponent", [-30, -20, -19, 0, 19, 20, 30])
def test_f7_normalize_at_any_length(figures, exponent):
    """|v|² over- or underflows from 10^±20 on; the direction must not."""
    unit = unit_vectors(40_000)
    v = unit * np.float32(10.0**exponent)
    n = np.asarray(NORMALIZE(v), np.float64)
    error = np.abs(n - unit)
    bad = np.abs(NAIVE_NORMALIZE(v) - unit) if abs(exponent) >= 20 else None
    figures("F7", "error of unit vectors from lengths of 1e-30 to 1e30", naive=bad, ours=error, at_most=1e-6)
