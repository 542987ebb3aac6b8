"""Light samples: where they point, how far they reach, how often each light is picked."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from jaxrt.lights import Lights, emitted_radiance, light_table, sample_light

N = 40_000
SAMPLE = jax.jit(jax.vmap(sample_light, (None, None, 0)))


def table(position, intensity, radius=None):
    position = jnp.asarray(position, jnp.float32)
    intensity = jnp.asarray(np.multiply.outer(intensity, [1, 2, 3]), jnp.float32)
    return light_table(Lights(position, intensity, None if radius is None else jnp.asarray(radius, jnp.float32)))


def uniform(seed=0):
    u = jax.random.uniform(jax.random.key(seed), (N, 2))
    return u.at[0].set(0).at[1].set(1 - 2.0**-24)


def test_point_light():
    """Inverse square law, one direction; the distance falls short of the light by a few ulp."""
    light = np.array([1.0, -2.0, 2.0])
    sample = SAMPLE(table([light], [4]), jnp.zeros(3), uniform())
    np.testing.assert_allclose(sample.direction, np.tile(light / 3, (N, 1)), rtol=1e-6)
    np.testing.assert_allclose(sample.irradiance, np.tile([4 / 9, 8 / 9, 12 / 9], (N, 1)), rtol=1e-6)
    assert np.all((sample.distance < 3) & (sample.distance > 3 - 1e-4))
    assert np.all(sample.light == 0)


@pytest.mark.parametrize("ratio", [0.9, 0.3, 1e-2, 1e-4])
def test_sphere_light_directions_fill_its_cone_evenly(ratio):
    """Inside the cone to rounding; 1 − cosθ is uniform (Kolmogorov-Smirnov, 1e-4); vector irradiance
    L·Ω·mean.
    """
    d, axis = 3.0, np.array([2, -1, 2]) / 3
    sample = SAMPLE(table([d * axis], [1], [ratio * d]), jnp.zeros(3), uniform(1))
    direction = np.asarray(sample.direction, float)
    sin2 = np.sum(np.cross(axis, direction) ** 2, -1)
    assert sin2.max() < ratio**2 * (1 + 1e-4) + 1e-10
    x = (1 - np.sqrt(1 - np.minimum(sin2, 1))) / (1 - np.sqrt(1 - ratio**2))
    assert stats.kstest(x[2:], "uniform").pvalue > 1e-4
    # E = L Ω with L = 1/(πr²)
    solid_angle = 2 * np.pi * (ratio**2 / (1 + np.sqrt(1 - ratio**2)))
    np.testing.assert_allclose(sample.irradiance[:, 0], solid_angle / (np.pi * (ratio * d) ** 2), rtol=1e-5)


@pytest.mark.parametrize("ratio", [0.9, 0.3, 1e-2])
def test_sphere_light_distance_ends_on_its_surface(ratio):
    """|distance · direction − position| = radius, short by rounding only; at the limb a root doubles the
    digits lost.
    """
    position = np.array([0.0, 3.0, 4.0])
    sample = SAMPLE(table([position], [1], [5 * ratio]), jnp.zeros(3), uniform(2))
    end = np.asarray(sample.distance, float)[:, None] * np.asarray(sample.direction, float)
    away = np.linalg.norm(end - position, axis=-1) / (5 * ratio) - 1
    assert np.all(away > -1e-4 / ratio)
    assert np.median(abs(away)) < 1e-5 / ratio


def test_lights_are_picked_by_power():
    """Shares .99 power + .01/n: chi² at 1e-4. Each sample is divided by its share, so their mean is the sum:
    4σ.
    """
    powers = np.array([1.0, 3.0, 0.0, 6.0])
    places = [[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [0, -1, 0]]
    sample = SAMPLE(table(places, powers), jnp.zeros(3), uniform(3))
    share = 0.99 * powers / 10 + 0.01 / 4
    counts = np.bincount(sample.light, minlength=4)
    assert stats.chisquare(counts, share * N).pvalue > 1e-4
    irradiance = np.asarray(sample.irradiance[:, 0], float)
    np.testing.assert_allclose(irradiance, (powers / share)[sample.light], rtol=1e-5)
    assert abs(irradiance.mean() - 10) < 4 * irradiance.std() / np.sqrt(N)


def test_numbers_are_uniform_again_after_the_pick():
    """Each of four equal sphere lights is filled all round: the azimuth's quadrants, chi² at 1e-4."""
    places = [[0, 0, 5.0], [0, 0, -5.0], [0, 5.0, 0], [0, -5.0, 0]]
    sample = SAMPLE(table(places, np.ones(4), np.ones(4)), jnp.zeros(3), uniform(4))
    direction, light = np.asarray(sample.direction), np.asarray(sample.light)
    for i in range(4):
        across = direction[light == i][:, [0, 1] if i < 2 else [0, 2]]
        quadrant = 2 * (across[:, 0] > 0) + (across[:, 1] > 0)
        assert stats.chisquare(np.bincount(quadrant, minlength=4)).pvalue > 1e-4


def test_pick_of_dark_lights_is_even():
    assert np.allclose(table(np.eye(3), np.zeros(3)).pick, [1 / 3, 2 / 3, 1])
    assert table([[0, 0, 1]], [0]).pick is None


def test_emitted_radiance_is_intensity_over_the_disc():
    """I/(πr²) from outside, nothing from inside, and nothing of a point."""
    lights = table(np.eye(3), [1, 2, 3], [1, 0.5, 0]).lights
    eyes = jnp.zeros(3), jnp.asarray([0.0, 1.4, 0.0])
    seen = [emitted_radiance(lights, jnp.int32(1), eye)[0] for eye in eyes]
    np.testing.assert_allclose(seen, [2 / (np.pi * 0.25), 0], rtol=1e-6)
    np.testing.assert_array_equal(emitted_radiance(lights, jnp.int32(2), eyes[0]), 0)
