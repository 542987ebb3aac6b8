"""Pinhole camera."""

import jax.numpy as jnp
from jax import Array

from jaxrt.core.maths import cross, normalize
from jaxrt.core.pytree import pytree, static
from jaxrt.core.records import Ray


@pytree
class Camera:
    """A pinhole camera and the size of its picture."""

    position: Array  # (3,) scene units
    target: Array  # (3,) the point at the picture's centre
    up: Array  # (3,) any length, not parallel to the view
    fov: Array  # () vertical, degrees
    width: int = static()
    height: int = static()


@pytree
class CameraFrame:
    """The camera as the path reads it: its ray through image point (x, y) is right·x + up·y + forward."""

    position: Array  # (3,)
    right: Array  # (3,) one pixel to the right, at distance 1
    up: Array  # (3,) one pixel up
    forward: Array  # (3,) unit vector
    width: int = static()
    height: int = static()


def camera_frame(camera: Camera) -> CameraFrame:
    """Return the axes of the picture; row 0 is the top, fov is the vertical angle in degrees."""
    forward = normalize(camera.target - camera.position)
    right = normalize(cross(forward, normalize(camera.up)))
    up = cross(right, forward)
    pixel = 2 * jnp.tan(jnp.radians(camera.fov) / 2) / camera.height
    return CameraFrame(camera.position, pixel * right, pixel * up, forward, camera.width, camera.height)


def camera_ray(frame: CameraFrame, x: Array, y: Array) -> Ray:
    """Return the ray through image point (x, y) in pixels, (0, 0) the upper left corner of the picture."""
    across, down = x - frame.width / 2, y - frame.height / 2
    return Ray(frame.position, normalize(across * frame.right - down * frame.up + frame.forward))
