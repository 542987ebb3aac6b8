"""Pictures and derivatives by closed forms and float64 quadrature, for two scenes: NumPy only, none of jaxrt's code.

The floor under a spherical light: where the whole light is above the horizon its irradiance is that of a point of the
same intensity, E = I h/d³. The ball on a floor under a point light: shading at each image point is elementary; what the
moving shadow adds to its derivative is an integral along the shadow's outline, which the cone of rays from the light
that touch the ball draws on the floor.
"""

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.samplers import Reference

FLOOR: dict[str, Any] = {
    "camera": {"position": [0, 3, 0], "target": [0.3, 0, -2], "fov": 50, "width": 64, "height": 64},
    "materials": {"white": {"type": "diffuse", "albedo": [0.8, 0.8, 0.8]}},
    "triangles": [
        {"vertices": [[-90, 0, 90], [90, 0, 90], [90, 0, -90]], "material": "white"},
        {"vertices": [[-90, 0, 90], [90, 0, -90], [-90, 0, -90]], "material": "white"},
    ],
    "lights": [{"position": [0.5, 4, 1], "intensity": [30, 30, 30], "radius": 1}],
}


class Camera(NamedTuple):
    """A pinhole camera."""

    eye: np.ndarray
    right: np.ndarray  # one pixel to the right at distance 1
    up: np.ndarray
    forward: np.ndarray
    size: int

    def directions(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return directions (..., 3), not normalised, through image points in pixels."""
        across, down = x[..., None] - self.size / 2, y[..., None] - self.size / 2
        return across * self.right - down * self.up + self.forward

    def project(self, points: np.ndarray) -> np.ndarray:
        """Return image points (n, 2), column and row, of points (n, 3)."""
        away = points - self.eye
        depth = away @ self.forward
        pixel = self.right @ self.right
        across, up = away @ self.right / (depth * pixel), away @ self.up / (depth * pixel)
        return np.stack([self.size / 2 + across, self.size / 2 - up], axis=-1)


def camera_of(text: dict[str, Any], size: int) -> Camera:
    """Return the camera of a description's table, for a square picture."""
    eye, target = (np.asarray(text[name], float) for name in ("position", "target"))
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0.0, 1, 0])
    right /= np.linalg.norm(right)
    pixel = 2 * np.tan(np.radians(text["fov"]) / 2) / size
    return Camera(eye, pixel * right, pixel * np.cross(right, forward), forward, size)


def floor_picture() -> Reference:
    """Return the picture (64, 64, 3) of FLOOR: smooth, so that 4 × 4 Gauss points a pixel are exact to rounding."""
    size = FLOOR["camera"]["width"]
    camera, light = camera_of(FLOOR["camera"], size), FLOOR["lights"][0]
    nodes, weights = np.polynomial.legendre.leggauss(4)
    places = (np.arange(size)[:, None] + (nodes + 1) / 2).ravel()
    direction = camera.directions(*np.meshgrid(places, places))
    x = camera.eye - camera.eye[1] / direction[..., 1:2] * direction
    toward = np.asarray(light["position"], float) - x
    radiance = 0.8 / np.pi * light["intensity"][0] * toward[..., 1] / np.linalg.norm(toward, axis=-1) ** 3
    return Reference(_pixel_means(radiance, np.outer(weights, weights) / 4), 0.0)


def _pixel_means(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return (H, W, 3) from a finer grid of values of k × k points a pixel."""
    k = len(weights)
    h, w = values.shape[0] // k, values.shape[1] // k
    grey = np.einsum("iajb,ab->ij", values.reshape(h, k, w, k), weights)
    return np.repeat(grey[..., None], 3, axis=-1)


class Ball(NamedTuple):
    """A ball on a square floor y = 0 under a point light."""

    camera: Camera
    center: np.ndarray
    radius: float
    half: float  # of the floor's side
    light: np.ndarray
    intensity: float
    albedos: tuple[np.ndarray, np.ndarray]  # floor, ball


def ball_of(path: str, size: int) -> Ball:
    """Return the scene in a file that holds such a scene."""
    text = tomllib.loads(Path(path).read_text())
    (sphere,), (light,) = text["spheres"], text["lights"]
    albedos = tuple(np.asarray(text["materials"][name]["albedo"], float) for name in ("floor", sphere["material"]))
    half = float(np.max(np.abs([t["vertices"] for t in text["triangles"]])))
    camera, center = camera_of(text["camera"], size), np.asarray(sphere["center"], float)
    position, intensity = np.asarray(light["position"], float), float(light["intensity"][0])
    return Ball(camera, center, sphere["radius"], half, position, intensity, (albedos[0], albedos[1]))


def _sphere_distance(ball: Ball, origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Return t of the first meeting of origin + t direction with the ball, ∞ without one."""
    away = origin - ball.center
    a, b = (direction * direction).sum(-1), (direction * away).sum(-1)
    inside = b * b - a * ((away * away).sum(-1) - ball.radius**2)
    t = (-b - np.sqrt(np.maximum(inside, 0))) / a
    return np.where((inside > 0) & (t > 0), t, np.inf)


def shading(ball: Ball, axis: int, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the picture and its derivative inside of edges by light coordinate `axis`, samples² midpoints a pixel."""
    places = (np.arange(ball.camera.size * samples) + 0.5) / samples
    rows = [_shade_rows(ball, axis, samples, places, y) for y in places.reshape(ball.camera.size, samples)]
    return np.concatenate([row[0] for row in rows]), np.concatenate([row[1] for row in rows])


def _shade_rows(ball: Ball, axis: int, samples: int, xs: np.ndarray, ys: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return one row of pixels (1, W, 3) of both."""
    eye, direction = ball.camera.eye, ball.camera.directions(*np.meshgrid(xs, ys))
    t_ball = _sphere_distance(ball, eye, direction)
    t_floor = np.where(direction[..., 1] < 0, -eye[1] / np.minimum(direction[..., 1], -1e-9), np.inf)
    on_floor = np.abs(eye[::2] + np.minimum(t_floor, 1e6)[..., None] * direction[..., ::2]).max(-1) <= ball.half
    floor, sphere = on_floor & (t_floor < t_ball), np.isfinite(t_ball) & ~(on_floor & (t_floor < t_ball))
    x = eye + np.where(floor, t_floor, np.where(sphere, t_ball, 0))[..., None] * direction
    normal = np.where(floor[..., None], [0.0, 1, 0], (x - ball.center) / ball.radius)
    v = ball.light - x
    d2, cosine = (v * v).sum(-1), (v * normal).sum(-1)
    lit = (sphere & (cosine > 0)) | (floor & (_sphere_distance(ball, x, v) > 1))
    value = np.where(lit, ball.intensity / np.pi * cosine * d2**-1.5, 0)
    slope = ball.intensity / np.pi * (normal[..., axis] - 3 * cosine * v[..., axis] / d2) * d2**-1.5
    weights = np.full((samples, samples), samples**-2.0)

    def coloured(values: np.ndarray) -> np.ndarray:
        return sum(
            _pixel_means(np.where(mask, values, 0), weights) * albedo
            for mask, albedo in zip((floor, sphere), ball.albedos, strict=True)
        )

    return coloured(value), coloured(np.where(lit, slope, 0))


def shadow_outline(ball: Ball, angles: np.ndarray) -> np.ndarray:
    """Return the points (n, 3) of the floor where rays from the light that touch the ball arrive."""
    axis = ball.center - ball.light
    distance = np.linalg.norm(axis)
    axis = axis / distance
    sine = ball.radius / distance
    u = np.cross(axis, [1.0, 0, 0])
    u /= np.linalg.norm(u)
    around = np.cos(angles)[:, None] * u + np.sin(angles)[:, None] * np.cross(axis, u)
    direction = np.sqrt(1 - sine**2) * axis + sine * around
    return ball.light - ball.light[1] / direction[:, 1:2] * direction


def moving_shadow(ball: Ball, axis: int, steps: int = 1 << 20) -> np.ndarray:
    """Return what the shadow's outline adds (H, W, 3): −radiance × the area that the shadow gains, pixel by pixel."""
    angles = (np.arange(steps) + 0.5) * 2 * np.pi / steps
    half, h = np.pi / steps, 1e-5 * np.eye(3)[axis]
    points = shadow_outline(ball, angles)
    along = ball.camera.project(shadow_outline(ball, angles + half)) - ball.camera.project(
        shadow_outline(ball, angles - half)
    )
    ahead, behind = (
        ball.camera.project(shadow_outline(ball._replace(light=ball.light + s * h), angles)) for s in (1, -1)
    )
    velocity = (ahead - behind) / 2e-5
    swept = velocity[:, 0] * along[:, 1] - velocity[:, 1] * along[:, 0]
    image = ball.camera.project(points)
    turn = np.sign((image[:, 0] * along[:, 1] - image[:, 1] * along[:, 0]).sum())
    seen = _sphere_distance(ball, ball.camera.eye, points - ball.camera.eye) > 1
    seen &= (np.abs(points[:, ::2]).max(-1) <= ball.half) & (image.min(-1) >= 0) & (image.max(-1) < ball.camera.size)
    v = ball.light - points
    radiance = ball.intensity / np.pi * v[:, 1] / np.linalg.norm(v, axis=-1) ** 3
    grey = np.zeros((ball.camera.size, ball.camera.size))
    column, row = np.floor(image[seen]).astype(int).T
    np.add.at(grey, (row, column), -turn * (swept * radiance)[seen])
    return grey[..., None] * ball.albedos[0]


def light_derivative(
    path: str, size: int, axis: int, samples: int, reduce: Callable[[np.ndarray], np.ndarray] = np.asarray
) -> Reference:
    """Return the derivative of such a scene's picture (H, W, 3) by a light coordinate, reduced; bounded in error.

    The variance is the mean square change from half as many midpoints: what is left is smaller.
    """
    ball = ball_of(path, size)
    coarse, fine = (shading(ball, axis, n)[1] for n in (samples // 2, samples))
    return Reference(reduce(fine + moving_shadow(ball, axis)), float((reduce(fine - coarse) ** 2).mean()))
