"""The pixel convention: which ray goes through which point of the picture."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrt
from jaxrt.cameras import view_of
from jaxrt.cameras.pinhole import Pinhole


def camera(position=(0, 0, 0), target=(0, 0, -1), up=(0, 1, 0), fov=60.0, width=6, height=4):
    vectors = (jnp.asarray(v, jnp.float32) for v in (position, target, up))
    return Pinhole(*vectors, jnp.float32(fov), width, height)


def rays(camera, x, y):
    """Return origins and directions (n, 3) in float64 through points (x, y)."""
    x, y = (jnp.asarray(v, jnp.float32) for v in (x, y))
    ray = jax.vmap(lambda x, y: view_of(camera).ray((x, y), (x, y)))(x, y)
    return np.asarray(ray.origin, float), np.asarray(ray.direction, float)


def test_every_pixel_of_a_picture_that_is_not_square():
    """Along (x − W/2, H/2 − y, −H/(2 tan(fov/2))): row 0 is the top, column 0 the left, fov the vertical
    angle.
    """
    width, height, fov = 6, 4, 75.0
    j, i = (v.ravel() for v in np.meshgrid(np.arange(width), np.arange(height)))
    for du, dv in ((0, 0), (0.5, 0.5), (0.25, 0.75)):
        _, direction = rays(camera(fov=fov, width=width, height=height), j + du, i + dv)
        depth = height / (2 * np.tan(np.radians(fov / 2)))
        want = np.stack([j + du - width / 2, height / 2 - (i + dv), np.full(j.shape, -depth)], -1)
        want /= np.linalg.norm(want, axis=-1, keepdims=True)
        np.testing.assert_allclose(direction, want, atol=3e-7)


@pytest.mark.parametrize("fov", [1e-3, 30.0, 90.0, 179.0])
def test_fov_is_the_vertical_angle_for_any_width(fov):
    for width in (2, 4, 16):
        _, (top, bottom) = rays(camera(fov=fov, width=width), [width / 2] * 2, [0, 4])
        angle = np.arctan2(np.linalg.norm(np.cross(top, bottom)), top @ bottom)
        assert np.degrees(angle) == pytest.approx(fov, rel=1e-4)
        assert top[1] > 0 > bottom[1]


def test_any_position_target_and_up():
    """The centre looks at the target; the picture's up is `up` less its part along the view, any length."""
    position, target = np.array([3.0, -2.0, 5.0]), np.array([-1.0, 4.0, 2.0])
    for up in ([0, 1, 0], [0, 1e-6, 0], [1e6, 2e6, -1e6], [0.3, -1, 0.2]):
        origin, direction = rays(camera(position, target, up), [3, 3, 3, 0, 6], [2, 0, 4, 2, 2])
        np.testing.assert_array_equal(origin, np.tile(position, (5, 1)))
        centre, top, bottom, left, right = direction
        forward = (target - position) / np.linalg.norm(target - position)
        np.testing.assert_allclose(centre, forward, atol=3e-7)
        unit_up = np.array(up) / np.linalg.norm(up)
        unit_up -= forward * (forward @ unit_up)
        unit_up /= np.linalg.norm(unit_up)
        assert (top - bottom) @ unit_up == pytest.approx(np.linalg.norm(top - bottom), rel=1e-6)
        side = np.cross(forward, unit_up)
        assert (right - left) @ side == pytest.approx(np.linalg.norm(right - left), rel=1e-6)


def test_target_distance_does_not_matter():
    near, far = (rays(camera(target=(0.3 * s, 0.2 * s, -s)), [1.5], [0.5])[1] for s in (1e-3, 1e3))
    np.testing.assert_allclose(near, far, atol=3e-7)


def test_rows_and_columns_of_a_render():
    """A light far up and to the left is bright in row 0, column 1 of a 6 × 4 picture, and nowhere else."""
    scene = jaxrt.build(
        {
            "camera": {"position": [0, 0, 0], "fov": 60, "width": 6, "height": 4},
            "lights": [{"position": [-1.5, 1.5, -2 * np.sqrt(3)], "intensity": np.pi * 0.09, "radius": 0.3}],
        }
    )
    image = np.asarray(jaxrt.render(scene, 0, spp=1024, max_depth=1, devices=jax.devices()[:1]))
    assert image.shape == (4, 6, 3)
    lit = np.argwhere(image[..., 0] > 0)
    np.testing.assert_array_equal(lit, [[0, 1]])
    # The light's solid angle πr²/d², and f²/cos³θ pixels to the steradian
    cos3 = (12 / 16.5) ** 1.5
    assert image[0, 1, 0] == pytest.approx(np.pi * 0.09 / 16.5 * 12 / cos3, rel=0.05)
