"""Derivatives where naive ones are wrong, biased or no numbers: cases A1, A3-A8 and X9. Naive methods are seen to fail.

Seeds are fixed: a test passes always or never. "4σ" of a mean fails for 6e-5 of random seeds.
"""

from functools import cache
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

import jaxrt
from jaxrt.core.maths import FAR, normalize, safe_divide, safe_sqrt
from tests.edge_scenes import quick_jit

ONE = tuple(jax.devices()[:1])
METER = {"width": 8, "height": 8, "fov": 1e-3}


def diffuse(*albedo):
    return {"type": "diffuse", "albedo": list(albedo) if len(albedo) == 3 else [albedo[0]] * 3}


def mean_and_error(x):
    """Return mean and standard error over the first axis."""
    x = np.asarray(x, float)
    return x.mean(0), x.std(0, ddof=1) / np.sqrt(len(x))


# A1: no numbers

ORIGIN = np.zeros(3, np.float32)
CORNERS = {
    "length of 0": (lambda v: jnp.linalg.norm(v), lambda v: safe_sqrt(v @ v), ORIGIN),
    "direction of 0": (lambda v: (v / jnp.linalg.norm(v))[0], lambda v: normalize(v)[0], ORIGIN),
    "masked root": (lambda x: jnp.where(x > 0, jnp.sqrt(x), 0), safe_sqrt, np.float32(-1)),
    "clipped root": (lambda x: jnp.sqrt(jnp.maximum(x, 0)), safe_sqrt, np.float32(-1)),
    "masked quotient": (lambda x: jnp.where(x > 0, x / x, 0), lambda x: safe_divide(x, x), np.float32(0)),
    "ray that hits nothing": (
        lambda x: jnp.where(x > 1, x * jnp.inf, 0),
        lambda x: jnp.where(x > 1, x * FAR, 0),
        np.float32(0.5),
    ),
}


@pytest.mark.parametrize("case", CORNERS)
def test_a1_guards_come_before_the_arithmetic(figures, case):
    naive, ours, x = CORNERS[case]
    bad, wrong = (np.count_nonzero(~np.isfinite(jax.jit(jax.grad(f))(x))) for f in (naive, ours))
    figures(
        "A1", "derivatives not finite at roots, quotients, lengths of 0 and misses", naive=bad, ours=wrong, at_most=0
    )


def test_a1_nothing_is_laundered():
    """Whole scenes of corners are in test_derivatives.py; no module repairs its results."""
    for module in Path("jaxrt").rglob("*.py"):
        assert "nan_to_num" not in module.read_text(), module


# A3: light samples


def irradiance(place, radius, key):
    """Return the meter's pictures of a floor of albedo 1 under a light of intensity π: cosθ/d² in the mean."""
    scene = jaxrt.build(
        {
            "camera": {"position": [0, 300, 30], "target": [0, 0, 0], "up": [0, 0, 1]} | METER,
            "materials": {"floor": diffuse(1)},
            "triangles": [{"vertices": [[-50, -50, 0], [50, -50, 0], [0, 100, 0]], "material": "floor"}],
            "lights": [{"position": [0, 0, 2], "intensity": np.pi, "radius": 0.5}],
        }
    )
    scene = jaxrt.with_parameters(scene, {"lights.position": place, "lights.radius": radius})
    return jaxrt.render(scene, key, spp=256, max_depth=1, devices=ONE)[..., 0]


@jax.jit
def irradiance_forwards(place, radius, key):
    slopes = jax.jacfwd(irradiance, argnums=(0, 1))(place, radius, key)
    return jnp.concatenate([slopes[0].reshape(8, 8, 3), slopes[1]], -1)


@pytest.mark.parametrize("ratio", [1.1, 1.5, 3, 10, 100])
@pytest.mark.parametrize("place", [(0, 0, 2), (0.4, -0.3, 2)])
def test_a3_sphere_light_above_the_horizon(figures, place, ratio):
    """E = z/d³ whatever the radius, so ∂E is that of the point light, and ∂E/∂r = 0: 4σ + 1e-3.

    Forwards; that backwards is its transpose, test_horrors.py shows."""
    p = np.array(place, float)
    d = np.linalg.norm(p)
    if d / ratio > p[2]:
        ratio = 1.05 * d / p[2]  # above the horizon
    args = jnp.asarray([place], jnp.float32), jnp.asarray([d / ratio], jnp.float32), jnp.uint32(1)
    expected = np.append(np.array([0, 0, 1]) / d**3 - 3 * p[2] * p / d**5, 0)
    found = np.asarray(irradiance_forwards(*args), float).reshape(64, 4)
    mean, error = mean_and_error(found)
    size = np.linalg.norm(expected)
    off = abs(mean - expected) / (4 * error + 1e-3 * size)
    figures(
        "A3", "error of a sphere light's derivatives at d/r of 1.1 to 100, in units of 4σ + 0.1 %", ours=off, at_most=1
    )
    assert np.all(error < 0.03 * size)


@pytest.fixture(scope="module")
def sphere_light_slope():
    """Return dE/dh of a light of radius 1/2 at height 2: −2/h³ of its intensity, π in the picture's scale."""
    args = jnp.asarray([[0, 0, 2]], jnp.float32), jnp.asarray([0.5], jnp.float32), jnp.uint32(1)
    return float(irradiance_forwards(*args)[..., 2].mean())


def test_a3_fixed_directions_have_no_derivative(figures, sphere_light_slope):
    """A light found by directions that do not move shines with constant radiance: derivative 0, and −1/4 in truth."""
    rng = np.random.default_rng(0)
    cosine = np.sqrt(rng.random(100_000)).astype(np.float32)

    def naive(height):
        # The light of radius 1/2 overhead spans sinθ < r/h; density cosθ/π
        hit = 1 - cosine**2 < (0.5 / height) ** 2
        return jnp.mean(jnp.where(hit, 1 / 0.5**2, 0))

    assert naive(2.0) == pytest.approx(1 / 4, rel=0.05)
    assert jax.grad(naive)(2.0) == 0
    assert (naive(2.1) - naive(1.9)) / 0.2 == pytest.approx(-1 / 4, rel=0.1)
    bad, off = (abs(x / (-1 / 4) - 1) for x in (jax.grad(naive)(2.0), sphere_light_slope))
    figures(
        "A3", "relative error of a sphere light's dE/dh; naive: fixed directions", naive=bad, ours=off, at_most=0.01
    )


# A4: choices


def test_a4_choices_have_no_derivative(figures):
    """Roulette by the albedo, and a lobe by its share: attached probabilities cancel what they divide."""
    u = np.random.default_rng(0).random(100_000).astype(np.float32)

    def roulette(a, keep):
        return jnp.mean(jnp.where(u < keep(a), a / keep(a), 0))

    def lobe(share, keep):
        p = keep(share)
        return jnp.mean(jnp.where(u < p, share / p * 1.0, (1 - share) / (1 - p) * 0.25))

    def attached(p):
        return p

    for estimate, slope in ((roulette, 1), (lobe, 0.75)):
        bad, off = (abs(jax.grad(estimate)(0.6, how) - slope) for how in (attached, jax.lax.stop_gradient))
        figures(
            "A4",
            "error of slopes through a random choice; naive: its chance differentiated",
            naive=bad,
            ours=off,
            at_most=0.02,
        )


def test_a4_transmittance_of_a_slab(figures):
    """T = (1−F)/(1+F): dT/dη within 4σ, glass choosing between reflection and refraction at each face."""
    glass = [
        {"vertices": [[-50, -50, z], [50, -50, z], [0, 100, z]][::order], "material": "glass"}
        for z, order in ((0, 1), (-0.3, -1))
    ]
    scene = jaxrt.build(
        {
            "camera": {"position": [0, 0, 1], "target": [0, 0, 0], **METER},
            "environment": {"radiance": [1, 1, 1]},
            "materials": {"black": diffuse(0), "glass": {"type": "glass", "ior": 1.5}},
            "triangles": [
                *glass,
                {"vertices": [[0, 100, 2], [50, -50, 2], [-50, -50, 2]], "material": "black"},
            ],
        }
    )

    @jax.jit
    def slopes(ior):
        def seen(ior):
            changed = jaxrt.with_parameters(scene, {"materials.ior": ior})
            return jaxrt.render(changed, 0, spp=4096, max_depth=6, devices=ONE)[..., 0]

        return jax.jvp(seen, (ior,), (jnp.ones_like(ior),))[1]

    for ior in (1.2, 1.5, 2.0):
        share = ((ior - 1) / (ior + 1)) ** 2
        expected = -2 / (1 + share) ** 2 * 4 * (ior - 1) / (ior + 1) ** 3
        mean, error = mean_and_error(np.asarray(slopes(jnp.asarray([ior], jnp.float32))).ravel())
        off = abs(mean - expected) / (4 * error + 1e-3 * abs(expected))
        what = "error of the slope of a slab's transmittance in its index, in units of 4σ + 0.1 %"
        figures("A4", what, ours=off, at_most=1)
        assert error < 0.05 * abs(expected)


# A5: two seeds


def lit_ball():
    return jaxrt.build(
        {
            "camera": {"position": [0.3, 0.1, 0.2], "target": [1, 0.4, -0.2], "width": 8, "height": 8, "fov": 100},
            "materials": {"wall": diffuse(0.7)},
            "spheres": [{"center": [0, 0, 0], "radius": 1, "material": "wall"}],
            "lights": [{"position": [0.5, 0.2, -0.3], "intensity": 3}],
        }
    )


@cache
def noiseless_ball():
    return jaxrt.render(lit_ball(), 10**6, spp=2**16, max_depth=3, devices=ONE)


@cache
def loss_gradient(spp, devices):
    """Return the compiled function (key, gradient_key) -> slope (3,) of a loss in the light's position."""
    scene, target = lit_ball(), noiseless_ball()
    truth = jaxrt.parameters(scene)["lights.position"]

    @quick_jit
    def gradient(key, gradient_key):
        def loss(place):
            moved = jaxrt.with_parameters(scene, {"lights.position": place})
            options = {"spp": spp, "max_depth": 3, "sampler": "independent", "devices": devices}
            image = jaxrt.render(moved, key, gradient_key=gradient_key, **options)
            return jnp.sum((image - target) ** 2)

        return jax.grad(loss)(truth)[0]

    return gradient


@pytest.mark.parametrize("spp", [1, 4])
def test_a5_loss_gradients_at_the_true_parameters(figures, spp):
    """With a seed of their own 0 ± 4σ of 256 seeds; with the picture's own, biased by the picture's variance."""
    gradient = loss_gradient(spp, ONE)
    seeds = np.arange(256, dtype=np.uint32)
    apart, error = mean_and_error([gradient(k, k + np.uint32(10**4)) for k in seeds])
    off = abs(apart) / error
    same, error = mean_and_error([gradient(k, k) for k in seeds])
    bad = abs(same) / error
    figures(
        "A5",
        "slope of an L2 loss at its minimum, in σ; naive: the picture's own samples",
        naive=bad,
        ours=off,
        at_most=4,
    )


def test_x9_gradients_are_the_same_every_time(figures):
    """Backwards, bit by bit, on one CPU device and on two, 16 times. There is no GPU here to see what one does.

    Naive: the terms of a sum as they happen to come, here a million in two orders.
    """
    terms = np.random.default_rng(9).random(10**6, np.float32)
    backwards = terms[::-1].copy()
    total = jax.jit(lambda x: lax.scan(lambda s, x: (s + x, None), jnp.float32(0), x)[0])
    changed = []
    for devices in (ONE, tuple(jax.devices())):
        gradient = loss_gradient(4, devices)
        first, *more = (np.asarray(gradient(np.uint32(5), np.uint32(6))) for _ in range(16))
        assert first.any()
        changed += [np.count_nonzero(x.view(np.int32) != first.view(np.int32)) for x in more]
    bad = int(total(terms) != total(backwards))
    what = "numbers of a gradient that another run changes; naive: a sum in another order"
    figures("X9", what, naive=bad, ours=changed, at_most=0)
    one, two = (
        np.asarray(loss_gradient(4, devices)(np.uint32(5), np.uint32(6))) for devices in (ONE, tuple(jax.devices()))
    )
    off = np.abs(one - two).max() / np.abs(one).max()
    figures("X9", "relative difference of a gradient between one device and two", ours=off, at_most=1e-5)


# A6: truncated paths, A8: bounds


def test_a6_depth_cuts_gradients_more_than_pictures(figures):
    """ρ = .9, eight events: 43 % of the light are missing, and 77 % of its derivative; what is there is exact.

    A8: nothing is clipped, so that derivatives at albedo 0 and 1 are not halved as that of `jnp.clip` is.
    """
    rho, depth = np.array([0, 0.9, 1.0]), 8
    scene = jaxrt.with_parameters(lit_ball(), {"lights.position": np.zeros((1, 3))})

    @jax.jit
    def both(albedo):
        def seen(albedo):
            changed = jaxrt.with_parameters(scene, {"materials.albedo": albedo})
            return jaxrt.render(changed, 0, spp=1, max_depth=depth, devices=ONE)

        return jax.jvp(seen, (albedo,), (jnp.ones_like(albedo),))

    image, slope = (np.asarray(x, float)[0, 0] for x in both(jnp.asarray(rho[None], jnp.float32)))
    k = np.arange(1, depth + 1)[:, None]
    unit = 3 / np.pi
    np.testing.assert_allclose(image, unit * np.sum(rho**k, 0), rtol=1e-4)
    want = unit * np.sum(k * rho ** (k - 1), 0)
    figures("A6", "error of the derivative that a limit of depth leaves", ours=abs(slope / want - 1), at_most=1e-4)
    clipped = abs(jax.grad(lambda x: jnp.clip(x, 0, 1))(1.0) - 1)
    figures(
        "A8",
        "error of the slope in an albedo of 0 and 1; naive: clip",
        naive=clipped,
        ours=abs(slope / want - 1)[[0, 2]],
        at_most=1e-4,
    )
    missing = 1 - image[1] / (unit * 0.9 / 0.1)
    missing_slope = 1 - slope[1] / (unit / 0.1**2)
    assert missing == pytest.approx(0.9**8, rel=1e-3) and missing_slope == pytest.approx(0.775, abs=0.002)
    told = 0.9**8 * (1 + 8 * 0.1)
    what = "error of the missing share, 78 % at albedo 0.9 and depth 8, told as ρᴰ(1 + D(1 − ρ)); naive: ρᴰ"
    bad, off = (abs(x / missing_slope - 1) for x in (0.9**8, told))
    figures("A6", what, naive=bad, ours=off, at_most=1e-3)


# A7: paths that carry nothing


def test_a7_black_surfaces_have_a_derivative(figures):
    """d/dρ of a black ball in a room holds the light that bounces to it, which a walk that stops at black loses."""
    scene = jaxrt.build(
        {
            "camera": {"position": [0, 0, 0.9], "target": [0, 0, 0], "fov": 20, "width": 8, "height": 8},
            "materials": {"ball": diffuse(0), "room": diffuse(0.5)},
            "spheres": [
                {"center": [0, 0, 0], "radius": 0.3, "material": "ball"},
                {"center": [0, 0, 0], "radius": 1, "material": "room"},
            ],
            "lights": [{"position": [0.3, 0.5, 0.6], "intensity": 3}],
        }
    )

    def seen(ball, room):
        albedo = jnp.stack([jnp.full(3, ball), jnp.full(3, room)])
        changed = jaxrt.with_parameters(scene, {"materials.albedo": albedo})
        return jaxrt.render(changed, 0, spp=64, max_depth=4, devices=ONE).mean()

    one = jnp.float32(1)
    slope = quick_jit(lambda ball, room: jax.jvp(lambda ball: seen(ball, room), (ball,), (one,))[1])
    found = float(slope(0 * one, 0.5 * one))
    # A polynomial in ρ without a kink at 0
    draw = quick_jit(seen)
    slope_of_picture = float(draw(0.02 * one, 0.5 * one) - draw(-0.02 * one, 0.5 * one)) / 0.04
    assert draw(0 * one, 0.5 * one) == 0
    # In a black room nothing bounces: what a walk would find that stops at the ball
    early = float(slope(0 * one, 0 * one))
    bad, off = (abs(x / slope_of_picture - 1) for x in (early, found))
    figures(
        "A7",
        "error of the slope in a black ball's albedo; naive: paths end at black",
        naive=bad,
        ours=off,
        at_most=1e-3,
    )
