"""Glass, Fresnel's equations, long paths and large values: cases M1-M4, M6, M7 and A6.

Meters are cameras 0.001° wide: 64 pixels with random numbers of their own. Seeds are fixed; false-alarm rates
are those of random seeds.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

import jaxrt
from jaxrt.materials.glass import fresnel, sample_glass

METER = {"width": 8, "height": 8, "fov": 1e-3}


def shot(scene, key=0, spp=1, max_depth=1):
    image = jaxrt.render(scene, key, spp=spp, max_depth=max_depth, devices=jax.devices()[:1])
    return np.asarray(image, np.float64)


def exact_fresnel(cos, eta):
    """Return (reflectance, cosine of refraction) in float64, reflectance 1 beyond the critical angle."""
    cos, eta = np.float64(cos), np.float64(eta)
    squared = 1 - (1 - cos * cos) / (eta * eta)
    t = np.sqrt(np.maximum(squared, 0))
    with np.errstate(invalid="ignore"):
        parallel, perpendicular = (eta * cos - t) / (eta * cos + t), (cos - eta * t) / (cos + eta * t)
    return np.where(squared <= 0, 1, (parallel**2 + perpendicular**2) / 2), t


def naive_fresnel(cos, eta):
    """As fresnel, with the root's argument clipped and the result selected: the usual way."""
    t = jnp.sqrt(jnp.maximum(1 - (1 - cos * cos) / (eta * eta), 0))
    parallel, perpendicular = (eta * cos - t) / (eta * cos + t), (cos - eta * t) / (cos + eta * t)
    return jnp.where(t == 0, 1, (parallel**2 + perpendicular**2) / 2)


ETAS = np.array([1 / 2.4, 1 / 1.5, 1 / 1.33, 0.999, 1.0, 1.001, 1.33, 1.5, 2.4], np.float32)


def fresnel_grid():
    """Return (cosines, indices): 4000 cosines for each index, 0 and 1 and the critical angle's neighbours
    included.
    """
    cosines = np.linspace(0, 1, 4000, dtype=np.float32)
    cos, eta = (x.ravel() for x in np.meshgrid(cosines, ETAS))
    critical = np.sqrt(np.maximum(1 - ETAS.astype(float) ** 2, 0)).astype(np.float32)
    near = np.concatenate([np.nextafter(critical, 0), critical, np.nextafter(critical, np.float32(1))])
    return np.concatenate([cos, near]), np.concatenate([eta, np.tile(ETAS, 3)])


FRESNEL = jax.jit(jax.vmap(fresnel))
SLOPES = jax.jit(jax.vmap(jax.value_and_grad(lambda c, e: fresnel(c, e)[0], (0, 1))))


def test_m1_fresnel_is_finite_everywhere(figures):
    """Values in [0, 1], finite derivatives. Naive: NaN for every totally reflected ray, and at grazing for
    eta = 1.
    """
    cos, eta = fresnel_grid()
    value, slopes = SLOPES(cos, eta)
    assert np.all((value >= 0) & (value <= 1))
    naive = np.stack(jax.jit(jax.vmap(jax.grad(naive_fresnel, (0, 1))))(cos, eta))
    wrong, naive = (np.mean(~np.isfinite(x).all(0)) for x in (np.stack(slopes), naive))
    figures(
        "M1",
        "share of 36 000 angles and indices where Fresnel's slope is no number",
        naive=naive,
        ours=wrong,
        at_most=0,
    )
    at_bad = (cos == 0) & (eta == 1)
    assert at_bad.any() and not np.any(np.stack(slopes)[:, at_bad])


def test_m1_fresnel_values_and_derivatives(figures):
    """Values to 1e-6 and derivatives to 1e-3 of central differences in float64, off the critical angle. At
    normal incidence ((eta − 1)/(eta + 1))².
    """
    cos, eta = fresnel_grid()
    exact, t = exact_fresnel(cos, eta)
    off = (t > 0.1) & (cos > 0.01) & (cos < 0.999)
    value, slopes = (np.asarray(x, float) for x in (lambda r: (r[0], jnp.stack(r[1])))(SLOPES(cos, eta)))
    figures("M1", "error of Fresnel's reflectance", ours=abs(value - exact)[off], at_most=1e-6)
    h = 1e-5
    c, e = cos[off].astype(float), eta[off].astype(float)
    by_cos = (exact_fresnel(c + h, e)[0] - exact_fresnel(c - h, e)[0]) / (2 * h)
    by_eta = (exact_fresnel(c, e + h)[0] - exact_fresnel(c, e - h)[0]) / (2 * h)
    np.testing.assert_allclose(slopes[0][off], by_cos, rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(slopes[1][off], by_eta, rtol=1e-3, atol=1e-3)
    normal = np.asarray(jax.jit(fresnel)(jnp.ones(ETAS.shape), ETAS)[0])
    np.testing.assert_allclose(normal, ((ETAS - 1) / (ETAS + 1)) ** 2, atol=1e-7)


def test_m1_fresnel_is_reciprocal(figures):
    """F(cosθi, eta) = F(cosθt, 1/eta) to 1e-6, where the cosines are not small: their rounding moves F by
    1/cosθ.
    """
    cos, eta = fresnel_grid()
    forward, t = FRESNEL(cos, eta)
    backward, back = FRESNEL(t, 1 / eta)
    off = (np.asarray(t) > 0.3) & (cos > 0.3)
    figures("M1", "difference of the reflectance from the other side", ours=abs(backward - forward)[off], at_most=1e-6)
    np.testing.assert_allclose(back[off], cos[off], atol=2e-6)


def test_m2_glass_of_index_one_lets_light_pass_straight(figures):
    """Direction to 1e-6, weight 1, no reflection: for 40 000 directions from both sides, grazing ones
    included.
    """
    rng = np.random.default_rng(0)
    wo = rng.normal(size=(40_000, 3))
    wo[:1000, 2] *= 1e-4
    wo = (wo / np.linalg.norm(wo, axis=1, keepdims=True)).astype(np.float32)
    normal = np.float32([0, 0, 1])
    u = rng.uniform(1e-7, 1, 40_000).astype(np.float32)
    go = jax.jit(jax.vmap(sample_glass, (None, 0, None, 0)))
    direction, weight = go(jnp.float32(1), wo, normal, u)
    error = abs(direction + wo)
    figures("M2", "how much glass of index 1 bends 40 000 directions", ours=error, at_most=1e-6)
    np.testing.assert_array_equal(weight, 1)
    bent, _ = go(jnp.float32(1.01), wo, normal, u)
    assert abs(bent + wo).max() > 1e-3


def glass_before_light(center, inner, inner_ior=1.0, radius=1.0, intensity=np.pi):
    """A meter on the axis of a glass ball of index 1.5, with another inside or away, and a sphere light
    behind.
    """
    return jaxrt.build(
        {
            "camera": {"position": [0, 0, 10], **METER},
            "materials": {
                "outer": {"type": "glass", "ior": 1.5},
                "inner": {"type": "glass", "ior": inner_ior},
            },
            "spheres": [
                {"center": center, "radius": 1, "material": "outer"},
                {"center": inner, "radius": 0.5, "material": "inner"},
            ],
            "lights": [{"position": [0, 0, -5], "intensity": intensity, "radius": radius}],
        }
    )


AWAY, BETWEEN = [0, 30, 0], [0, 0, 3]


def test_m3_nested_glass(figures):
    """`ior` is inside over outside: a glass core in glass of equal index has 1 and vanishes, with 1.5 it does
    not.

    At normal incidence with four events, within 4σ (6e-5 false alarms each): solid (1−F)²(1+F²), core of 1
    (1−F)², core of 1.5 over glass (1−F)⁴.
    """
    share = 0.04
    solid, core = (1 - share) ** 2 * (1 + share**2), (1 - share) ** 2
    cases = ((AWAY, 1.0, solid), (BETWEEN, 1.0, core), (BETWEEN, 1.5, core**2))
    for inner, ior, want in cases:
        image = shot(glass_before_light(BETWEEN, inner, ior), spp=1024, max_depth=4)[..., 0]
        off = abs(image.mean() - want) / np.sqrt(want * (1 - want) / (64 * 1024))
        figures("M3", "error of light through nested glass, in σ", ours=off, at_most=4)


def test_m3_overlapping_glass_is_warned_of(figures):
    with pytest.warns(jaxrt.SceneWarning, match="glass and overlap") as told:
        glass_before_light(BETWEEN, [0, 0, 4])
    figures("M3", "warnings of overlapping glass; naive: silence", naive=0, ours=len(told), at_least=1)


@pytest.mark.parametrize("ior", [1.5, 3.0, 0.7])
@pytest.mark.parametrize("offset", [0.0, 0.4])
def test_m4_glass_ball_in_a_white_furnace(figures, ior, offset):
    """Radiance 1 less the share (1−F) F^(D−1) of paths that are still inside after D events: binomial 4σ.

    Each path brings 1 or 0: what refraction into the ball takes by 1/eta², refraction out gives back.
    """
    scene = jaxrt.build(
        {
            "camera": {"position": [offset, 0, 3], "target": [offset, 0, 0], **METER},
            "environment": {"radiance": [1, 1, 1]},
            "materials": {"glass": {"type": "glass", "ior": ior}},
            "spheres": [{"center": [0, 0, 0], "radius": 1, "material": "glass"}],
        }
    )
    reflected = float(exact_fresnel(np.sqrt(1 - offset**2), ior)[0])
    lost = (1 - reflected) * reflected
    samples = np.stack([shot(scene, key, max_depth=2)[..., 0] for key in range(200)])
    assert np.all(np.isclose(samples, 1, atol=1e-5) | (samples == 0))
    off, limit = abs(samples.mean() - (1 - lost)), 4 * np.sqrt(lost * (1 - lost) / samples.size) + 1e-5
    figures("M4", "error of the light lost in glass to a limit of depth, in units of 4σ", ours=off / limit, at_most=1)
    assert abs(1 - samples.mean()) > 4 * np.sqrt(lost / samples.size) or lost < 2e-3


def test_m6_nothing_is_clamped(figures, tmp_path):
    """A light of radiance 2.5e7 seen directly is that in picture and EXR file; so is one of 1e-7."""
    for intensity in (np.pi * 2.5e7, np.pi * 1e-7):
        scene = glass_before_light(AWAY, [0, -30, 0], intensity=intensity)
        image = shot(scene, spp=4, max_depth=4)
        off, clamped = (abs(x * np.pi / intensity - 1) for x in (image, np.minimum(image, 10)))
        bad = clamped if intensity > 1 else None
        figures("M6", "error of radiances of 2.5e7 and 1e-7; naive: clamped at 10", naive=bad, ours=off, at_most=1e-6)
        jaxrt.save_image(tmp_path / "bright.exr", image)
        np.testing.assert_array_equal(jaxrt.load_image(tmp_path / "bright.exr"), np.float32(image))


def test_m6_clamping_would_be_biased():
    """A toy of heavy tails: Pareto of exponent 1.2 has mean 6; clamped at 10, a third of that."""
    x = stats.pareto(1.2).rvs(1_000_000, random_state=1)
    assert np.minimum(x, 10).mean() < 3


def closed_ball(albedo):
    return jaxrt.build(
        {
            "camera": {
                "position": [0.3, 0.1, 0.2],
                "target": [1, 0.4, -0.2],
                "width": 8,
                "height": 8,
                "fov": 100,
            },
            "materials": {"wall": {"type": "diffuse", "albedo": albedo}},
            "spheres": [{"center": [0, 0, 0], "radius": 1, "material": "wall"}],
            "lights": [{"position": [0, 0, 0], "intensity": np.pi}],
        }
    )


def test_m7_albedo_of_one_is_the_limit(figures):
    """Albedo 1 is legal, and with D events in a closed ball gives D; beyond 1 the series would diverge:
    refused.
    """
    off = abs(shot(closed_ball([1, 1, 0]), max_depth=8) / 8 - [1, 1, 0])
    figures("M7", "error of eight events at albedo 1, beyond which scenes are refused", ours=off, at_most=1e-5)
    for albedo in (1.001, -0.001):
        with pytest.raises(jaxrt.SceneError, match=r"albedo.*outside \[0, 1\]"):
            closed_ball([0.5, albedo, 0.5])


@pytest.mark.parametrize(("albedo", "depth", "missing"), [(0.5, 4, 0.0625), (0.8, 8, 0.168), (0.9, 8, 0.430)])
def test_a6_missing_light_of_a_depth(figures, albedo, depth, missing):
    """D events give Σ ρ^k for k <= D, to 1e-4; the share ρ^D of the whole ρ/(1−ρ) is missing."""
    image = shot(closed_ball([albedo] * 3), max_depth=depth)
    error = abs(image / sum(albedo**k for k in range(1, depth + 1)) - 1)
    figures("A6", "error of the light that a limit of depth leaves", ours=error, at_most=1e-4)
    assert 1 - image.mean() * (1 - albedo) / albedo == pytest.approx(missing, abs=1e-3)
