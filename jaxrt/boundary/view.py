"""Where the camera sees a point of the scene."""

import jax.numpy as jnp
from jax import Array

from jaxrt.cameras import CameraFrame
from jaxrt.core.maths import dot, safe_divide, safe_sqrt
from jaxrt.core.pytree import pytree


@pytree
class Projection:
    """A point's image."""

    image: Array  # (2,) column and row in pixels
    pixel: Array  # () int32 row · width + column
    inside: Array  # () bool: in front of the camera and within the picture
    depth: Array  # () along the camera's axis
    density: Array  # () pixels per steradian


def project(camera: CameraFrame, point: Array) -> Projection:
    """Return the image of a point; finite, but meaningless, where it is not `inside`."""
    away = point - camera.position
    depth = dot(away, camera.forward)
    ahead = depth > 0
    area = dot(camera.right, camera.right)  # of a pixel at distance 1
    across = safe_divide(dot(away, camera.right), area * jnp.where(ahead, depth, 1))
    rise = safe_divide(dot(away, camera.up), area * jnp.where(ahead, depth, 1))
    inside = ahead & (jnp.abs(across) < camera.width / 2) & (jnp.abs(rise) < camera.height / 2)
    x, y = jnp.where(inside, across + camera.width / 2, 0), jnp.where(inside, camera.height / 2 - rise, 0)
    column = jnp.minimum(x.astype(jnp.int32), camera.width - 1)
    row = jnp.minimum(y.astype(jnp.int32), camera.height - 1)
    # One pixel spans area · cos³θ steradian
    slant = safe_divide(safe_sqrt(dot(away, away)), jnp.where(ahead, depth, 1))
    density = jnp.where(ahead, safe_divide(slant * slant * slant, area), 0)
    return Projection(jnp.stack([x, y]), row * camera.width + column, inside, depth, density)
