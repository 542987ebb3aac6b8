"""Every `sample_x` draws what its `pdf_x` says: chi² of binned draws, and the exact Jacobian."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from jaxrt.core import sampling

AXES = {
    "up": (0.0, 0.0, 1.0),
    "down": (0.0, 0.0, -1.0),
    "tilted": (0.48, -0.6, 0.64),
}
SAMPLES = {
    "cosine": lambda axis, _, u: sampling.sample_cosine_hemisphere(axis, u),
    "sphere": lambda axis, _, u: sampling.sample_uniform_sphere(u),
    "cone": sampling.sample_cone,
    "cap": sampling.sample_visible_cap,
}
DENSITIES = {  # of x = 1 - cosθ
    "cosine": lambda x, _: sampling.pdf_cosine_hemisphere(1 - x),
    "sphere": lambda x, _: jnp.full_like(x, sampling.pdf_uniform_sphere()),
    "cone": lambda x, width: jnp.full_like(x, sampling.pdf_cone(width)),
    "cap": lambda x, s: sampling.pdf_visible_cap(1 - x, jnp.full_like(x, s)),
}
# (kind, its parameter, greatest 1 - cosθ): cones and caps from wide to narrow
CASES = [
    ("cosine", 0.0, 1.0),
    ("sphere", 0.0, 2.0),
    ("cone", 1.0, 1.0),
    ("cone", 0.3, 0.3),
    ("cone", 1e-6, 1e-6),
    ("cap", 0.0, 1.0),
    ("cap", 0.5, 0.5),
    ("cap", 0.95, 0.05),
]
DRAW = {kind: jax.jit(jax.vmap(f, (None, None, 0))) for kind, f in SAMPLES.items()}


def _area(sample):
    """Return a function for |∂ω/∂u₀ × ∂ω/∂u₁|: solid angle per unit of the square."""

    def area(axis, parameter, u):
        j = jax.jacfwd(lambda u: sample(axis, parameter, u))(u)
        return jnp.sqrt(jnp.sum(jnp.cross(j[:, 0], j[:, 1]) ** 2))

    return jax.jit(jax.vmap(area, (None, None, 0)))


AREA = {kind: _area(f) for kind, f in SAMPLES.items()}


def angles(directions, axis):
    """Return x = 1 - cosθ, without cancellation, and the azimuth, in float64, in a frame of its own."""
    d, n = np.asarray(directions, np.float64), np.asarray(axis, np.float64)
    n = n / np.linalg.norm(n)
    t = np.cross(n, np.eye(3)[np.argmin(abs(n))])
    t /= np.linalg.norm(t)
    b = np.cross(n, t)
    sin2, cos = (d @ t) ** 2 + (d @ b) ** 2, d @ n
    return np.where(cos > 0, sin2 / (1 + np.maximum(cos, 0)), 1 - cos), np.arctan2(d @ b, d @ t)


def chi2_p_value(directions, axis, kind, parameter, extent, rows=21, columns=16):
    """Return the p-value of directions against the density of `kind`, cells below 5 pooled."""
    x, phi = angles(directions, axis)
    assert np.all(x <= extent * (1 + 1e-4)), "a direction fell where the density is 0"
    edges = np.linspace(0, extent, rows + 1)
    bins = [edges, np.linspace(-math.pi, math.pi, columns + 1)]
    counts = np.histogram2d(np.clip(x, 0, extent), phi, bins)[0].ravel()

    # Integrate the density over each row by Gauss-Legendre; it does not depend on azimuth
    nodes, weights = np.polynomial.legendre.leggauss(8)
    points = (edges[:-1, None] + edges[1:, None]) / 2 + nodes * extent / rows / 2
    density = DENSITIES[kind](jnp.float32(points), jnp.float32(parameter))
    row = (np.asarray(density, np.float64) * weights).sum(1) * extent / rows / 2
    expected = np.repeat(row * 2 * math.pi / columns, columns) * len(x)
    assert expected.sum() == pytest.approx(len(x), rel=1e-4), "the density does not integrate to 1"

    small = expected < 5
    counts = np.append(counts[~small], counts[small].sum())
    expected = np.append(expected[~small], expected[small].sum())
    used = expected > 0
    statistic = ((counts[used] - expected[used]) ** 2 / expected[used]).sum()
    return stats.chi2.sf(statistic, used.sum() - 1)


def draw(kind, parameter, axis, n=100_000):
    u = jnp.asarray(np.random.default_rng(1).random((n, 2), np.float32))
    return DRAW[kind](jnp.float32(axis), jnp.float32(parameter), u)


def axis_of(kind, axis):
    return AXES["up"] if kind == "sphere" else AXES[axis]


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize(("kind", "parameter", "extent"), CASES)
def test_chi2(kind, parameter, extent, axis):
    """alpha = .01 over all cases with Šidák's correction: one false alarm in 100 seeds; the seed is fixed."""
    directions = draw(kind, parameter, AXES[axis])
    p = chi2_p_value(directions, axis_of(kind, axis), kind, parameter, extent)
    assert p > 1 - (1 - 0.01) ** (1 / (len(CASES) * len(AXES)))
    np.testing.assert_allclose((np.asarray(directions, np.float64) ** 2).sum(1), 1, atol=2e-6)


def test_chi2_rejects_a_wrong_density():
    """The test above bites: neither a uniform hemisphere nor a uniform cone passes for its neighbour."""
    assert chi2_p_value(draw("cone", 1.0, AXES["up"]), AXES["up"], "cosine", 0.0, 1.0) < 1e-10
    assert chi2_p_value(draw("cap", 0.5, AXES["up"]), AXES["up"], "cone", 0.5, 0.5) < 1e-10


@pytest.mark.parametrize(("kind", "parameter", "extent"), CASES)
def test_density_is_inverse_jacobian(kind, parameter, extent):
    """|∂ω/∂u₀ × ∂ω/∂u₁| · pdf = 1 at 40 000 random places; rounding of float32 derivatives allows 3e-4."""
    u = jnp.asarray(np.random.default_rng(2).uniform(0.02, 0.98, (40_000, 2)).astype(np.float32))
    arguments = jnp.float32(AXES["tilted"]), jnp.float32(parameter), u
    x, _ = angles(DRAW[kind](*arguments), axis_of(kind, "tilted"))
    density = DENSITIES[kind](jnp.float32(x), jnp.float32(parameter))
    np.testing.assert_allclose(AREA[kind](*arguments) * density, 1, atol=3e-4)


def test_sincos_2pi():
    """Against float64, on the numbers that samplers make and on tiny ones; the derivative too."""
    u = np.concatenate(
        [np.arange(2**18) * 2.0**-18, 1 - np.arange(1, 999) * 2.0**-24, np.geomspace(1e-12, 1e-2, 999)]
    ).astype(np.float32)
    turn = 2 * np.pi * u.astype(np.float64)
    cos, sin = jax.jit(sampling.sincos_2pi)(u)
    np.testing.assert_allclose(cos, np.cos(turn), atol=3e-7, rtol=0)
    np.testing.assert_allclose(sin, np.sin(turn), atol=3e-7, rtol=0)
    dcos, dsin = jax.jit(jax.vmap(jax.jacfwd(sampling.sincos_2pi)))(u)
    np.testing.assert_allclose(dcos, -2 * np.pi * np.sin(turn), atol=5e-6, rtol=0)
    np.testing.assert_allclose(dsin, 2 * np.pi * np.cos(turn), atol=5e-6, rtol=0)


def test_float64_in_float64_out():
    with jax.enable_x64(True):
        u, axis = jnp.array([0.3, 0.6]), jnp.array(AXES["tilted"])
        s = jnp.array(0.4)
        for d in (
            sampling.sample_cosine_hemisphere(axis, u),
            sampling.sample_uniform_sphere(u),
            sampling.sample_cone(axis, sampling.cone_of_sphere(s * s), u),
            sampling.sample_visible_cap(axis, s, u),
        ):
            assert d.dtype == jnp.float64
            assert abs(float(jnp.sum(d * d)) - 1) < 1e-14
        assert sampling.pdf_cone(s).dtype == sampling.pdf_visible_cap(s, s).dtype == jnp.float64


def test_l1_cone_of_small_spheres():
    """1 - cosθmax of spheres down to r/d = 1e-6 against float64; the textbook form loses every digit."""
    s = np.concatenate([np.geomspace(1e-6, 0.999, 400), [0.03, 3e-3, 1e-3, 2e-4]]).astype(np.float32)
    exact = 2 * np.sin(np.arcsin(s.astype(np.float64)) / 2) ** 2
    np.testing.assert_allclose(jax.jit(sampling.cone_of_sphere)(s * s), exact, rtol=3e-6)

    naive = np.asarray(1 - jnp.sqrt(1 - s * s))
    error = abs(naive / exact - 1)
    assert error[np.searchsorted(s[:400], 2e-4)] > 0.5
    assert error[np.searchsorted(s[:400], 1e-3)] > 1e-2


def test_l2_cone_is_finite_on_and_inside_a_sphere():
    """At d/r = 0 … 2 through the surface, value and derivative are finite; the textbook root is not."""
    s2 = jnp.float32([np.finfo(np.float32).max, 4, 1 / (1 - 1e-6) ** 2, 1, 1 / (1 + 1e-6) ** 2, 0.25, 0])
    value, slope = jax.vmap(jax.value_and_grad(sampling.cone_of_sphere))(s2)
    assert np.all(np.isfinite(value)) and np.all(np.isfinite(slope))
    np.testing.assert_array_equal(value[:4], 1)
    np.testing.assert_allclose(slope[-1], 0.5, rtol=1e-6)

    naive = jax.vmap(jax.grad(lambda x: 1 - jnp.sqrt(jnp.maximum(1 - x, 0))))(s2)
    assert not np.all(np.isfinite(naive))


def test_densities_vanish_off_their_support():
    zero = jnp.float32(0)
    assert sampling.pdf_cosine_hemisphere(jnp.float32(-0.1)) == 0
    assert sampling.pdf_cone(zero) == 0
    assert sampling.pdf_visible_cap(jnp.float32(0.4), jnp.float32(0.5)) == 0
    for s in (1.0, 1.5):
        assert sampling.pdf_visible_cap(jnp.float32(1), jnp.float32(s)) == 0
