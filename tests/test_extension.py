"""Kinds that jaxrt does not have, defined here alone: scene files, pictures, derivatives and commands know them."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrt
from jaxrt.core.maths import dot, normalize
from jaxrt.core.records import Ray
from jaxrt.core.sampling import pdf_uniform_sphere, sample_uniform_sphere
from jaxrt.description.fields import Angle, Direction, Place, Positive, Rgb
from jaxrt.gradcheck.coverage import AFAR, SCATTERED, SKY, coverage


@jaxrt.light
class Torch:
    """A lamp that shines to one side: its intensity times the squared cosine to its axis."""

    position: Place
    axis: Direction
    intensity: Rgb
    is_delta = True

    def sample(self, point, u):
        away = point - self.position
        squared = dot(away, away)
        direction = away / jnp.sqrt(squared)
        cosine = jnp.maximum(dot(direction, normalize(self.axis)), 0)
        return -direction, jnp.sqrt(squared), self.intensity * cosine**2 / squared

    def power(self):
        return jnp.sum(self.intensity)


@jaxrt.light
class Sun:
    """Parallel light."""

    toward: Direction
    irradiance: Rgb
    is_delta = True

    def sample(self, point, u):
        return normalize(self.toward), jnp.inf, self.irradiance


@jaxrt.light
class Dome:
    """A sky from one colour below to another above."""

    ground: Rgb
    zenith: Rgb

    def sample(self, point, u):
        return sample_uniform_sphere(u)

    def pdf(self, direction):
        return pdf_uniform_sphere()

    def emitted(self, direction):
        return self.ground + (self.zenith - self.ground) * (1 + direction[1]) / 2


@jaxrt.camera
class Drawing:
    """Parallel rays down, `scale` scene units a pixel."""

    position: Place
    scale: Positive = 1.0

    def ray(self, image, u):
        across, down = (image[0] - self.width / 2) * self.scale, (image[1] - self.height / 2) * self.scale
        below = jnp.zeros_like(self.position).at[1].set(-1)
        return Ray(self.position + jnp.stack([across, jnp.zeros_like(across), down]), below)


@jaxrt.camera
class Fisheye:
    """Looks down; the angle to its axis grows with the distance to the picture's centre: `fov` from edge to edge."""

    position: Place
    fov: Angle = 120.0
    is_central = True

    def ray(self, image, u):
        x, y = image[0] - self.width / 2, image[1] - self.height / 2
        radius = jnp.sqrt(x * x + y * y + 1e-12)
        angle = radius / self.height * jnp.radians(self.fov)
        return Ray(
            self.position, jnp.stack([jnp.sin(angle) * x / radius, -jnp.cos(angle), jnp.sin(angle) * y / radius])
        )

    def project(self, point):
        x, y, z = point - self.position
        side = jnp.sqrt(x * x + z * z + 1e-12)
        radius = jnp.arctan2(side, -y) * self.height / jnp.radians(self.fov)
        return (self.width / 2 + radius * x / side, self.height / 2 + radius * z / side), y < 0


@jaxrt.camera
class Lens:
    """A thin lens that looks along -z and is sharp at a distance."""

    position: Place
    aperture: Positive = 1.0
    focus: Positive = 10.0
    scale: Positive = 0.1  # of a pixel at distance 1

    def ray(self, image, u):
        x, y = (image[0] - self.width / 2) * self.scale, (self.height / 2 - image[1]) * self.scale
        radius, turn = self.aperture * jnp.sqrt(u[0]), 2 * jnp.pi * u[1]
        start = jnp.stack([radius * jnp.cos(turn), radius * jnp.sin(turn), jnp.zeros_like(x)])
        sharp = self.focus * jnp.stack([x, y, -jnp.ones_like(x)])
        return Ray(self.position + start, normalize(sharp - start))


WHITE = {"white": {"type": "diffuse", "albedo": [0.5, 0.6, 0.7]}}
ALBEDO = np.array([0.5, 0.6, 0.7])


def floor(low: float, high: float, height: float = 0.0) -> list[dict[str, Any]]:
    a, b, c, d = ([x, height, z] for x, z in ((low, -9), (high, -9), (high, 9), (low, 9)))
    return [{"vertices": [a, c, b], "material": "white"}, {"vertices": [a, d, c], "material": "white"}]


OUTDOORS = {
    "camera": {"type": "drawing", "position": [0, 5, 0], "width": 8, "height": 8},
    "materials": WHITE,
    "triangles": floor(-9, 0),
    "lights": [
        {"type": "dome", "ground": 0.2, "zenith": [0.4, 0.7, 1.0]},
        {"type": "sun", "toward": [3, 4, 0], "irradiance": 2},
    ],
}


def on_floor(ground, zenith, toward, irradiance):
    """Return the radiance (3,) of a floor under a dome and a sun, in closed form."""
    sky = jnp.pi * (ground + (zenith - ground) * 5 / 6)
    return ALBEDO / jnp.pi * (sky + irradiance * toward[1] / jnp.linalg.norm(toward))


def test_a_sky_and_a_sun_before_a_camera_of_parallel_rays():
    """Light samples find both on the floor, rays that miss see the sky; derivatives are those of the closed form."""
    scene = jaxrt.build(OUTDOORS)
    p = jaxrt.parameters(scene)
    names = ["lights.ground", "lights.zenith", "lights.toward", "lights.irradiance"]
    assert {*names, "camera.position", "camera.scale"} <= p.keys()
    assert p["lights.zenith"].shape == (1, 3) and p["camera.scale"].shape == ()

    def left(values):
        picture = jaxrt.render(
            jaxrt.with_parameters(scene, dict(zip(names, values, strict=True))), 0, spp=256, max_depth=1
        )
        return jnp.mean(picture[:, :4], (0, 1)), picture

    values = [p[name] for name in names]
    (mean, picture), slopes = jax.jvp(left, (values,), (values,))
    np.testing.assert_allclose(picture[:, 4:], np.broadcast_to(0.2, (8, 4, 3)), rtol=1e-6)
    wanted, change = jax.jvp(lambda *v: on_floor(*(x[0] for x in v)), tuple(values), tuple(values))
    np.testing.assert_allclose(mean, wanted, rtol=0.01)
    np.testing.assert_allclose(slopes[0], change, rtol=0.01)
