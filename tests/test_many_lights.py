"""Many lights: chosen by power and distance; right in the mean, in derivatives, and quiet."""

from dataclasses import replace
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

import jaxrt
from jaxrt.core.pytree import pytree
from jaxrt.lights import light_table, sample_light, share_at
from jaxrt.lights.near import MANY, neighbours
from tests.edge_scenes import AXES

N = 40_000
WHITE = {"white": {"type": "diffuse", "albedo": [0.8, 0.8, 0.8]}}
FLOOR = {"center": [0, -1000, 0], "radius": 1000, "material": "white"}


def described(places: np.ndarray, powers: np.ndarray, **more: Any) -> dict[str, Any]:
    """Return a scene of a floor, seen from above, under lights."""
    lights = [{"position": p.tolist(), "intensity": float(w)} for p, w in zip(places, powers, strict=True)]
    camera = {"position": [0, 14, 0], "target": [0, 0, 0], "up": [0, 0, -1], "fov": 60, "width": 16, "height": 16}
    return {"camera": camera, "materials": WHITE, "spheres": [FLOOR], "lights": lights} | more


def crowd(n: int, low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
    """Return places and powers of lights all over the floor, between two heights."""
    rng = np.random.default_rng(n)
    places = np.stack([rng.uniform(-10, 10, n), rng.uniform(low, high, n), rng.uniform(-10, 10, n)], -1)
    return places, rng.lognormal(0, 1, n)


@pytest.mark.parametrize("n", [1, 2, 17, 37, 100, 1000])
def test_groups_hold_each_light_once_and_its_neighbours(n: int) -> None:
    places, _ = crowd(n, 0, 8)
    order, size = neighbours(places), round(n**0.5)
    assert sorted(order) == list(range(n)) and order.dtype == np.int32
    chance = np.random.default_rng(0).permutation(n)

    def spread(rows: np.ndarray) -> float:
        return sum(np.ptp(places[rows[i : i + size]], axis=0).sum() for i in range(0, n, size))

    assert n < 100 or spread(order) < 0.6 * spread(chance)


def test_few_lights_are_chosen_by_power_alone() -> None:
    for n, many in ((MANY, False), (MANY + 1, True)):
        scene = jaxrt.build(described(*crowd(n, 1, 5)))
        assert (scene.lights.order is not None) == many
        assert (light_table(scene.lights).groups is not None) == many


@pytree
class Lamp:
    """A light of another kind, far above, of which nothing arrives."""

    strength: jax.Array
    is_delta: ClassVar[bool] = True

    def power(self) -> jax.Array:
        return self.strength

    def sample(self, point: jax.Array, u: Any) -> Any:
        return jnp.asarray([0.0, 1, 0]), jnp.inf, jnp.zeros(3)


@pytest.mark.usefixtures("quick_compilation")
@pytest.mark.parametrize("others", [False, True])
def test_lights_are_picked_as_often_as_is_said(others: bool) -> None:
    """Chi² at 1e-4; the sum of the shares is 1; the mean of the samples is the sum of the lights, 4σ."""
    places, powers = crowd(50, 0.5, 6)
    powers[7] = 0
    scene = jaxrt.build(described(places, powers))
    table = light_table(scene.lights)
    if others:
        table = light_table(replace(scene.lights, others=(Lamp(jnp.full(2, 5.0)),), rows=(2,)))
    point = jnp.asarray([1.0, 0, 2])
    u = jax.random.uniform(jax.random.key(0), (N, 2)).at[0].set(0).at[1].set(1 - 2.0**-24)
    sample = jax.jit(jax.vmap(sample_light, (None, None, 0)))(table, point, u)
    share = np.asarray(jax.vmap(lambda i: share_at(table, i, point))(jnp.arange(table.lights.count)), float)
    assert share.sum() == pytest.approx(1, abs=1e-5) and (share > 0).all()
    counts = np.bincount(sample.light, minlength=len(share))
    assert stats.chisquare(counts, share / share.sum() * N).pvalue > 1e-4
    light = np.asarray(sample.light)
    away = places - np.asarray(point)
    expected = powers / (away**2).sum(-1)
    ours = light < len(powers)
    found = np.where(ours, np.asarray(sample.irradiance)[:, 0], 0)
    np.testing.assert_allclose(found[ours], (expected / share[:50])[light[ours]], rtol=1e-4, atol=1e-9)
    assert abs(found.mean() - expected.sum()) < 4 * found.std() / N**0.5


@pytest.mark.usefixtures("quick_compilation")
def test_a_thousand_lights_are_quiet() -> None:
    """Relative noise at 16 spp: 0.04 where lights hang high, 0.13 where some nearly touch the floor.

    By power alone it is 0.26 and 0.73.
    """
    picture = jax.jit(lambda key: jaxrt.render(scene, key, spp=16, max_depth=1, devices=jax.devices()[:1]))
    for low, high in ((5.0, 5.0), (0.3, 8.0)):
        scene = jaxrt.build(described(*crowd(1000, low, high)))
        first, second = (np.asarray(picture(seed)) for seed in (0, 1))
        noise = np.sqrt(np.mean((first - second) ** 2) / 2) / first.mean()
        assert noise < 0.15, (low, high, noise)
        assert noise > 0.001


BALL = np.array([0.0, 2.0, 0.0]), 1.5


def seen(places: np.ndarray, powers: np.ndarray, across: int = 256) -> float:
    """Return the first moment along x of the picture of the floor and a ball, from a dense grid of rays."""
    x = (np.arange(across) + 0.5) / across * 2 - 1
    side = np.tan(np.radians(30))
    ray = np.stack(np.broadcast_arrays(side * x, -1, side * x[:, None]), -1).reshape(-1, 3)
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    eye = np.array([0, 14.0, 0])
    point, normal = np.empty_like(ray), np.empty_like(ray)
    nearest = np.full(len(ray), np.inf)
    for center, radius in ((np.array([0, -1000.0, 0]), 1000.0), BALL):
        t = -first_hit(eye - center, ray, radius)
        met = t < nearest
        nearest = np.where(met, t, nearest)
        point[met] = (eye + t[:, None] * ray)[met]
        normal[met] = ((point - center) / radius)[met]
    light = 0
    for place, power in zip(places, powers, strict=True):
        away = place - point
        distance = np.linalg.norm(away, axis=-1)
        toward = away / distance[:, None]
        miss = point - BALL[0] + toward * np.maximum((toward * (BALL[0] - point)).sum(-1), 0)[:, None]
        clear = ((miss**2).sum(-1) > BALL[1] ** 2 * (1 - 1e-9)) & ((toward * normal).sum(-1) > 0)
        light = light + np.where(clear, power * (toward * normal).sum(-1) / distance**2, 0)
    return float((np.tile(x, across) * light).mean() * 0.8 / np.pi)


def first_hit(origin: np.ndarray, ray: np.ndarray, radius: float) -> np.ndarray:
    """Return minus the distance to a sphere about 0, −∞ where there is none."""
    b = ray @ origin
    root = b * b - origin @ origin + radius**2
    return np.where(root > 0, b + np.sqrt(np.maximum(root, 0)), -np.inf)


@pytest.mark.usefixtures("quick_compilation")
def test_derivatives_with_edges_are_those_of_the_closed_form() -> None:
    """All lights move along x, and the ball's shadows with them."""
    places, powers = crowd(24, 5, 9)
    ball = {"center": BALL[0].tolist(), "radius": BALL[1], "material": "white"}
    scene = jaxrt.build(described(places, powers, spheres=[FLOOR, ball]))
    weight = jnp.asarray((np.arange(16) + 0.5) / 8 - 1, jnp.float32)

    def moment(step: jax.Array, key: jax.Array, edges: int) -> jax.Array:
        moved = {"lights.position": jaxrt.parameters(scene)["lights.position"] + step * AXES[:1]}
        options = dict(spp=256, max_depth=1, boundary_samples=edges, devices=jax.devices()[:1])
        picture = jaxrt.render(jaxrt.with_parameters(scene, moved), key, **options)
        return jnp.mean(picture[..., 0] * weight[None])

    def slopes(edges: int) -> tuple[np.ndarray, np.ndarray]:
        f = jax.jit(lambda key: jax.jvp(lambda step: moment(step, key, edges), (jnp.zeros(()),), (jnp.ones(()),)))
        return tuple(
            np.asarray(values, float) for values in zip(*(f(jax.random.key(i)) for i in range(8)), strict=True)
        )

    step = 0.05
    expected = (seen(places + step * AXES[0], powers) - seen(places - step * AXES[0], powers)) / (2 * step)
    value, slope = slopes(4096)
    assert abs(value.mean() - seen(places, powers)) < 4 * value.std() / 8**0.5 + 1e-4
    error = slope.std() / 7**0.5
    assert error < 0.05 * abs(expected)
    assert abs(slope.mean() - expected) < 4 * error + 0.01 * abs(expected)
