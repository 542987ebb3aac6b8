"""Kinds that jaxrt does not have, defined here alone: scene files, pictures, derivatives and commands know them."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrt
from jaxrt.gradcheck.coverage import AFAR, SCATTERED, SKY, coverage
from jaxrt.kinds import (
    Angle,
    Direction,
    Place,
    Positive,
    Ray,
    Rgb,
    dot,
    normalize,
    pdf_uniform_sphere,
    sample_uniform_sphere,
)


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


def lamp_over(ball: bool, **camera: Any) -> dict[str, Any]:
    """Return a torch and a ball over a floor, before a fisheye."""
    return {
        "camera": {"type": "fisheye", "position": [0.3, 6, 0.2], "fov": 100, "width": 16, "height": 16, **camera},
        "materials": WHITE,
        "triangles": floor(-9, 9),
        "spheres": [{"center": [0, 1.5, 0], "radius": 0.7, "material": "white"}] if ball else [],
        "lights": [{"type": "torch", "position": [2, 5, 1], "axis": [-1, -5, 0], "intensity": [20, 30, 40]}],
    }


def test_a_torch_before_a_fisheye():
    """The floor under it has the closed form, place by place as the camera's angle says."""
    scene = jaxrt.build(lamp_over(ball=False))
    picture = np.asarray(jaxrt.render(scene, 0, spp=16, max_depth=1))
    j, i = np.meshgrid(np.arange(16) + 0.5, np.arange(16) + 0.5)
    # Where the middles of the pixels look
    radius, turn = np.hypot(j - 8, i - 8), np.arctan2(i - 8, j - 8)
    reach = 6 * np.tan(radius / 16 * np.radians(100))
    places = np.stack([0.3 + reach * np.cos(turn), 0 * reach, 0.2 + reach * np.sin(turn)], -1)
    away, axis = places - [2, 5, 1], np.array([-1, -5, 0]) / np.sqrt(26)
    distance = np.linalg.norm(away, axis=-1)
    cosine = away @ axis / distance
    want = ALBEDO / np.pi * np.array([20, 30, 40]) * (cosine**2 * 5 / distance**3)[..., None]
    middle = radius < 6
    np.testing.assert_allclose(picture[middle], want[middle], rtol=0.03)


@pytest.mark.parametrize(("name", "edges"), [("camera.position", 2), ("lights.position", 1)])
def test_shadows_and_outlines_of_a_torch_and_a_fisheye(name, edges):
    """The light's intensity towards an edge, and the pixels per steradian, follow from `sample` and `project`."""
    scene = jaxrt.build(lamp_over(ball=True))
    report = jaxrt.gradcheck(scene, name, 3, component=0, spp=64, max_depth=1, boundary_samples=2048, seeds=3)
    print(report)
    assert report.ok
    assert len(report.coverage.included) == 1 + edges


def test_a_thin_lens_blurs_what_is_not_in_focus():
    """A far small light is a disk, its size as the lens says: on the lens, the second pair of the first block."""
    lamp = {"position": [0, 0, -20], "intensity": 1, "radius": 0.05}
    camera = {
        "type": "lens",
        "position": [0, 0, 0],
        "aperture": 0.5,
        "focus": 10,
        "scale": 0.005,
        "width": 16,
        "height": 16,
    }
    picture = np.asarray(jaxrt.render(jaxrt.build({"camera": camera, "lights": [lamp]}), 0, spp=256, max_depth=1))[
        ..., 0
    ]
    row, column = np.meshgrid(np.arange(16) - 7.5, np.arange(16) - 7.5)
    # A uniform disk of radius R has variance R²/4 along an axis
    disk = 0.5 * (1 / 10 - 1 / 20) / 0.005
    for axis in (row, column):
        assert np.sum(picture * axis**2) / np.sum(picture) == pytest.approx(disk**2 / 4, rel=0.05)
