"""What the camera's rays meet first, besides the light that comes from there: depth, normals, masks and so on.

Each is 0 where a ray meets nothing. So the mean over a pixel is the mean of what is met, times the share of the pixel
that shows anything, `alpha`: differentiable where outlines move, and to be divided by it by who wants the former.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxrt.core.maths import dot, face_forward
from jaxrt.core.records import Hit, Ray, SurfacePoint
from jaxrt.kernels.native import once
from jaxrt.lights import shines_from_afar, sky_radiance
from jaxrt.materials import albedo_of
from jaxrt.shapes import find, place_of, surface_point
from jaxrt.shapes.uv import uv_of
from jaxrt.transport.path import Tables


class Mask(NamedTuple):
    """The share of a pixel that shows some of the primitives, or some of the materials."""

    primitives: tuple[tuple[int, int], ...]  # first and end of each range
    materials: tuple[int, ...] = ()  # rows


Output = str | Mask


def _depth(tables: Tables, ray: Ray, hit: Hit, point: SurfacePoint) -> Array:
    return dot(place_of(point) - ray.origin, ray.direction)[None]


def _normal(tables: Tables, ray: Ray, hit: Hit, point: SurfacePoint) -> Array:
    return face_forward(point.shading, -ray.direction)


KINDS: dict[str, tuple[str, Callable[[Tables, Ray, Hit, SurfacePoint], Array]]] = {
    "alpha": ("A", lambda tables, ray, hit, point: jnp.ones_like(ray.origin[:1])),
    "depth": ("Z", _depth),
    "position": ("XYZ", lambda tables, ray, hit, point: place_of(point)),
    "normal": ("XYZ", _normal),
    "albedo": ("RGB", lambda tables, ray, hit, point: albedo_of(tables.materials, point)),
    "uv": ("UV", lambda tables, ray, hit, point: uv_of(tables.geometry, hit.index, place_of(point))),
}
SKY = "sky"  # the radiance that a ray which meets nothing sees


def channels(outputs: tuple[Output, ...]) -> int:
    """Return how many numbers the outputs are of; the picture's radiance, of none, has three."""
    return sum(map(_channels, outputs)) if outputs else 3


def _channels(output: Output) -> int:
    return 1 if isinstance(output, Mask) else 3 if output == SKY else len(KINDS[output][0])


def parts_of(picture: Array, outputs: tuple[Output, ...]) -> list[Array]:
    """Return each of the outputs (…, c), or (…) of one number, that a picture (…, channels) of them holds."""
    parts, first = [], 0
    for output in outputs:
        end = first + _channels(output)
        parts.append(picture[..., first] if end == first + 1 else picture[..., first:end])
        first = end
    return parts


def first_met(outputs: tuple[Output, ...], tables: Tables, ray: Ray) -> Array:
    """Return the outputs (channels,) of what a camera's ray meets first."""
    if tables.geometry.spheres is None and tables.geometry.triangles is None:
        nothing = [jnp.zeros(_channels(o), tables.dtype) if o != SKY else _sky(tables, ray) for o in outputs]
        return jnp.concatenate(nothing)
    hit = once(find)(tables.geometry, ray)
    return what_is_met(outputs, tables, ray, hit, once(surface_point)(tables.geometry, ray, hit))


def what_is_met(outputs: tuple[Output, ...], tables: Tables, ray: Ray, hit: Hit, point: SurfacePoint) -> Array:
    """Return the outputs (channels,) of what a camera's ray meets, if that is known."""
    parts = []
    for output in outputs:
        if output == SKY:
            parts.append(jnp.where(hit.valid, 0, _sky(tables, ray)))
        elif isinstance(output, Mask):
            parts.append(jnp.where(hit.valid & _shows(output, hit, point), 1, 0).astype(tables.dtype)[None])
        else:
            parts.append(jnp.where(hit.valid, KINDS[output][1](tables, ray, hit, point), 0))
    return jnp.concatenate(parts)


def numbers_met(tables: Tables, ray: Ray) -> Array:
    """Return primitive and row of its material (2,) that a camera's ray meets first; −1 for nothing."""
    if tables.geometry.spheres is None and tables.geometry.triangles is None:
        return jnp.full(2, -1, jnp.int32)
    hit = once(find)(tables.geometry, ray)
    material = once(surface_point)(tables.geometry, ray, hit).material
    return jnp.where(hit.valid, jnp.stack([hit.index, material]), -1)


def _sky(tables: Tables, ray: Ray) -> Array:
    sky = jnp.zeros_like(ray.direction) if tables.environment is None else tables.environment
    return sky + sky_radiance(tables.lights, ray.direction) if shines_from_afar(tables.lights) else sky


def _shows(mask: Mask, hit: Hit, point: SurfacePoint) -> Array:
    shows = jnp.zeros((), bool)
    for first, end in mask.primitives:
        shows = shows | ((hit.index >= first) & (hit.index < end))
    for row in mask.materials:
        shows = shows | (point.material == row)
    return shows
