"""Rough metal and plastic: their samplers, furnaces and slopes against quadratures and closed forms."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import chi2

import jaxrt
from jaxrt.core.records import SurfacePoint
from jaxrt.materials import Materials, scatter
from jaxrt.materials.conductor import Conductor
from jaxrt.materials.directional import lost
from jaxrt.materials.glass import fresnel
from jaxrt.materials.plastic import Plastic, mean_fresnel
from jaxrt.materials.principled import Principled
from jaxrt.materials.rough_glass import RoughGlass

N = 100_000
SURFACE = SurfacePoint(jnp.zeros(3), jnp.asarray([0.0, 0.0, 1.0]), jnp.zeros(()), jnp.int32(0))
TINTS = jnp.asarray([0.9, 0.5, 0.1])
DRAWS = jax.random.uniform(jax.random.key(1), (N, 2))


def metal(roughness: float) -> Conductor:
    return Conductor(jnp.ones(3), jnp.asarray(roughness), jnp.ones(()))


def plastic(roughness: float, ior: float = 1.5) -> Plastic:
    return Plastic(jnp.ones(3), jnp.asarray(roughness), jnp.asarray(ior))


def toward(cos: float) -> jax.Array:
    return jnp.asarray([np.sqrt(1 - cos * cos), 0, cos], jnp.float32)


@jax.jit
def drawn(one, wo):
    return jax.vmap(lambda u: one.sample(SURFACE, wo, (u[0], u[1])))(DRAWS)


@jax.jit
def evaluated(one, wo, wi):
    return jax.vmap(lambda wi: one.evaluate(SURFACE, wo, wi))(wi)


COLUMNS, ROWS, FINE = 32, 24, 24  # of equal angles; parts of each, along both axes


def check_density(one, wo, kept=False):
    """χ² over cells of the sphere against quadratures of the density; a false alarm once in 10,000.

    kept: of directions that have a weight.
    """
    wi, weight = (np.asarray(x, float) for x in drawn(one, wo))
    wi = wi[weight[:, 0] > 0] if kept else wi
    angle, turn = np.arccos(np.clip(wi[:, 2], -1, 1)), np.arctan2(wi[:, 1], wi[:, 0]) % (2 * np.pi)
    rows, columns = (angle / np.pi * ROWS).astype(int), (turn / (2 * np.pi) * COLUMNS).astype(int)
    seen = np.zeros((ROWS, COLUMNS))
    np.add.at(seen, (np.minimum(rows, ROWS - 1), np.minimum(columns, COLUMNS - 1)), 1)
    angle = (np.arange(ROWS * FINE) + 0.5) / (ROWS * FINE) * np.pi
    turn = (np.arange(COLUMNS * FINE) + 0.5) / (COLUMNS * FINE) * 2 * np.pi
    angle, turn = np.meshgrid(angle, turn, indexing="ij")
    directions = np.stack([np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle)], -1)
    density = evaluated(one, wo, jnp.asarray(directions.reshape(-1, 3), jnp.float32))[1]
    share = np.asarray(density, float).reshape(angle.shape) * np.sin(angle)
    share = share.reshape(ROWS, FINE, COLUMNS, FINE).mean((1, 3)) * (2 * np.pi**2 / (ROWS * COLUMNS))
    expected, seen = N * share.ravel(), seen.ravel()
    few = expected < 10
    seen, expected = (np.append(x[~few], x[few].sum()) for x in (seen, expected))
    statistic = np.sum((seen - expected) ** 2 / np.maximum(expected, 1))
    assert statistic < chi2.ppf(1 - 1e-4, len(seen) - 1)


@pytest.mark.parametrize("kind", [metal, plastic])
@pytest.mark.parametrize("roughness", [0.2, 0.4, 0.7, 1.0])
@pytest.mark.parametrize("cos", [1.0, 0.7, 0.25])
def test_directions_are_drawn_with_the_density_told(kind, roughness, cos):
    check_density(kind(roughness), toward(cos))


ROUGH = {
    "conductor": metal(0.6),
    "plastic": plastic(0.3),
    "principled": Principled(TINTS, jnp.asarray(0.4), jnp.asarray(0.3), jnp.ones(())),
    "rough_glass": RoughGlass(jnp.asarray(1.5), jnp.asarray(0.4), None),
}


@pytest.mark.parametrize(("kind", "cos"), [*((kind, 0.6) for kind in ROUGH), ("rough_glass", -0.6)])
def test_directions_tell_the_numbers_that_draw_them(kind, cos):
    """The numbers told draw the same direction, and are spread as those that did: so each lobe has its share.

    χ² of the difference over the cells of a square; a false alarm once in 10,000 at most.
    """
    one, wo, draws = ROUGH[kind], toward(cos), DRAWS[: N // 5]

    @jax.jit
    @jax.vmap
    def found(u, coin):
        direction, weight = one.sample(SURFACE, wo, (u[0], u[1]))
        numbers = one.numbers_toward(SURFACE, wo, direction, coin)
        return weight[0] > 0, jnp.stack(numbers), direction, one.sample(SURFACE, wo, numbers)[0]

    kept, *rest = (np.asarray(x) for x in found(draws, jax.random.uniform(jax.random.key(2), draws.shape[:1])))
    numbers, drawn, again = (np.asarray(x[kept], float) for x in rest)
    np.testing.assert_allclose(again, drawn, atol=2e-3)
    first, second = (
        np.histogram2d(*x.T, bins=8, range=[(0, 1), (0, 1)])[0] for x in (numbers, np.asarray(draws)[kept])
    )
    assert np.sum((first - second) ** 2 / np.maximum(first + second, 1)) < chi2.ppf(1 - 1e-4, 64)


@pytest.mark.parametrize("roughness", [0.05, 0.1, 0.3, 0.5, 0.7, 1.0])
@pytest.mark.parametrize("cos", [1.0, 0.6, 0.2])
def test_a_white_metal_returns_all_light(roughness, cos):
    """With the lobe of more than one reflection: at least .97, and no more than 1 within 4σ. Reflection is mutual."""
    one, wo = metal(roughness), toward(cos)
    wi, weight = (np.asarray(x, float) for x in drawn(one, wo))
    assert 0.97 <= weight.mean() <= 1 + 4 * weight[:, 0].std() / np.sqrt(N) + 1e-5
    high = wi[:, 2] > 0.05
    wi = jnp.asarray(wi, jnp.float32)
    there = np.asarray(evaluated(one, wo, wi)[0], float)[:, 0]
    back = np.asarray(jax.vmap(lambda wi: one.evaluate(SURFACE, wi, wo))(wi)[0], float)[:, 0]
    wi = np.asarray(wi, float)
    np.testing.assert_allclose((there / wi[:, 2])[high], (back / cos)[high], rtol=5e-3)


def test_one_reflection_loses_what_it_is_known_to_lose():
    """Means over the hemisphere at α = .25 and .5: .88 and .70 (Kulla & Conty 2017)."""
    cos = jnp.asarray((np.arange(2000) + 0.5) / 2000, jnp.float32)
    for alpha, share in ((0.25, 0.88), (0.5, 0.70)):
        once = jax.vmap(lambda c, alpha=alpha: 1 - lost(jnp.float32(alpha**0.5), c)[0])(cos)
        assert abs(float(jnp.mean(2.0 * cos * once)) - share) < 0.005


@pytest.mark.parametrize("ior", [1.05, 1.3, 1.5, 2.5])
def test_plastic_under_a_smooth_coat_loses_nothing(ior):
    """White beneath: what enters leaves, so that only rough facets lose. Fresnel's mean is that of a quadrature."""
    cos = jnp.asarray((np.arange(20_000) + 0.5) / 20_000, jnp.float32)
    mean = jnp.mean(2 * cos * jax.vmap(lambda c: fresnel(c, jnp.float32(ior))[0])(cos))
    assert abs(float(mean_fresnel(jnp.float32(ior))) - float(mean)) < 2e-5
    weight = np.asarray(drawn(plastic(0.1, ior), toward(0.8))[1], float)[:, 0]
    assert abs(weight.mean() - 1) < 4 * weight.std() / np.sqrt(N) + 1e-3


@pytest.mark.parametrize("name", ["conductor", "plastic"])
def test_slopes_in_roughness_and_colour(name):
    """Directions held as paths do, and moved with the roughness: two estimates of one slope, within 4σ."""
    wo, step = toward(0.6), 0.01

    def rows(roughness, tint):
        rest = jnp.full(1, 1.5) if name == "plastic" else jnp.ones(1)  # ior, or compensation
        kind = Plastic if name == "plastic" else Conductor
        return Materials.of(**{name: kind(tint[None], roughness[None], rest)})

    def light(roughness, tint, u):
        # From a sky that brightens to one side
        out = scatter(rows(roughness, tint), SURFACE, wo, (u[0], u[1]))
        return out.weight * (1 - out.direction[0])

    def moved(roughness, tint, u):
        one = jax.tree.map(lambda leaf: leaf[0], rows(roughness, tint).kinds[0])
        wi, weight = one.sample(SURFACE, wo, (u[0], u[1]))
        return weight * (1 - wi[0])

    at = jnp.asarray(0.5), TINTS
    held = jax.jit(jax.vmap(lambda u: jax.jvp(lambda *x: light(*x, u), at, (jnp.ones(()), -TINTS))[1]))(DRAWS)
    ends = [
        jax.jit(jax.vmap(lambda u, h=h: moved(at[0] + h, at[1] * (1 - h), u)))(DRAWS).astype(float)
        for h in (step, -step)
    ]
    other = np.asarray(ends[0] - ends[1], float) / (2 * step)
    held = np.asarray(held, float)
    error = np.hypot(held.std(0), other.std(0)) / np.sqrt(N)
    assert np.all(np.abs(held.mean(0) - other.mean(0)) < 4 * error + 1e-3)


@pytest.mark.parametrize("kind", [metal(0.5), plastic(0.5)], ids=["conductor", "plastic"])
def test_slopes_in_the_surface_know_the_lobe_that_was_chosen(kind):
    """A turning surface, whose chance of either lobe changes: differences of a quadrature, within 4σ."""
    wo, step, rows = toward(0.6), 0.02, Materials.of(**{kind.kind.name: jax.tree.map(lambda leaf: leaf[None], kind)})

    def turned(t):
        return replace(SURFACE, normal=jnp.stack([jnp.sin(t), jnp.zeros_like(t), jnp.cos(t)]))

    def drawn(u, t):
        out = scatter(rows, turned(t), wo, (u[0], u[1]))
        return out.weight * (1 + 0.9 * out.direction[0])

    zero, one = jnp.zeros(()), jnp.ones(())
    slope = jax.jit(jax.vmap(lambda u: jax.jvp(lambda t: drawn(u, t), (zero,), (one,))[1]))(DRAWS)
    slope = np.asarray(slope, float)[:, 0]
    turn, angle = np.meshgrid(*((np.arange(n) + 0.5) / n * np.pi * k for n, k in ((800, 2), (400, 1))), indexing="ij")
    ways = np.stack([np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle)], -1).reshape(-1, 3)
    sent = jax.jit(jax.vmap(lambda wi, t: kind.evaluate(turned(t), wo, wi)[0][0], (0, None)))
    ends = [np.asarray(sent(jnp.asarray(ways, jnp.float32), jnp.float32(t)), float) for t in (step, -step)]
    around = np.sin(angle).ravel() * (1 + 0.9 * ways[:, 0]) * (2 * np.pi**2 / angle.size)
    wanted = ((ends[0] - ends[1]) * around).sum() / (2 * step)
    assert abs(slope.mean() - wanted) < 4 * slope.std() / np.sqrt(N) + 1e-3, (slope.mean(), wanted)


@pytest.mark.parametrize("kind", ["conductor", "plastic"])
def test_a_rough_ball_is_drawn_and_has_a_roughness(kind):
    table = {"type": kind, "albedo": [0.9, 0.6, 0.3], "roughness": 0.4}
    scene = jaxrt.build(
        {
            "camera": {"position": [0, 0, 4], "width": 8, "height": 8},
            "materials": {"ball": table},
            "spheres": [{"center": [0, 0, 0], "radius": 1, "material": "ball"}],
            "lights": [{"position": [2, 3, 4], "intensity": 50, "radius": 0.5}],
            "environment": {"radiance": [0.5, 0.5, 0.5]},
        }
    )
    image, slope = jax.jvp(
        lambda r: jaxrt.render(jaxrt.with_parameters(scene, {"materials.roughness": r}), 0, spp=16, max_depth=1),
        (jnp.full(1, 0.4),),
        (jnp.ones(1),),
    )
    assert np.isfinite(image).all() and np.isfinite(slope).all() and float(jnp.abs(slope).max()) > 0
    with pytest.raises(jaxrt.SceneError, match=r"roughness: 0.01 is below 0.05: use 0.05 or more"):
        jaxrt.build({"camera": {"position": [0, 0, 4]}, "materials": {"a": table | {"roughness": 0.01}}})
