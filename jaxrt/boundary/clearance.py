"""By how much a line clears what it grazes: the only part of the edge term that is differentiated.

A line from A to B grazes an outline at q = A + s (B − A); m is the unit vector at right angles to line and outline. To
first order m does not move the line off the outline when it turns, so the clearance is

    F = m·((1 − s) A + s B − Q),

with Q the point of the occluder that is at q. For a shadow A is a point of the light, c + r ω at constant ω, and B the
point that a fixed image point shows: where the camera's ray o + τ D meets the receiver. With n the receiver's normal
and P its material point there, B moves by o + τ D + D n·(P − o − τ D)/(n·D). For an outline that the camera sees, A is
the camera and q itself lies on o + τ D. So both are

    F = a·(c + r ω) + b·(o + τ D) + h·P − m·Q,

a sum over points of the scene with constant coefficients: finite for any, linear in each point.
"""

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxrt.cameras import view_of
from jaxrt.core.pytree import pytree
from jaxrt.lights import Lights, casters_of
from jaxrt.scene import Scene

ONE_HOT_ROWS = 64  # tables up to this long are read by a product, whose transpose is one too


@pytree
class LightPoints:
    """The points c + r ω of lights."""

    light: Array  # (m,) int32
    omega: Array  # (m, 3) unit; 0 for point lights
    factor: Array  # (m, 3) of the point in F


@pytree
class ViewPoints:
    """The points o + τ D(u) that image points u see."""

    image: Array  # (m, 2) column and row in pixels
    tau: Array  # (m,)
    factor: Array  # (m, 3)


@pytree
class Anchors:
    """Points that stay where they are on a sphere or triangle."""

    sphere: Array | None  # (m,) int32 row among spheres, then sphere lights; None in scenes without
    normal: Array | None  # (m, 3) outward unit normal
    on_sphere: Array | None  # (m,) 1 or 0
    vertices: Array | None  # (m, 3) int32; None in scenes without triangles
    weights: Array | None  # (m, 3) barycentric; 0 for points on spheres
    factor: Array  # (m, 3) of the point in F


@pytree
class EdgeSamples:
    """Samples of moving edges. Each adds weight · dF to its pixels; what cannot move is None."""

    pixel: Array  # (m, k) int32 row · width + column; beyond the picture where nothing is seen
    weight: Array  # (m, k, 3) radiance per unit of clearance
    light: LightPoints | None
    view: ViewPoints | None
    anchors: tuple[Anchors, ...]


def clearance_of(scene: Scene, samples: EdgeSamples) -> Array:
    """Return F (m,) in scene units, up to a constant: differentiable in the scene, finite for any."""
    clearance = jnp.zeros(samples.pixel.shape[0], scene.dtype)
    if samples.light is not None:
        assert scene.lights is not None
        clearance += jnp.sum(samples.light.factor * _light_points(scene.lights, samples.light), -1)
    if samples.view is not None:
        clearance += jnp.sum(samples.view.factor * _view_points(scene, samples.view), -1)
    for anchors in samples.anchors:
        clearance += jnp.sum(anchors.factor * _anchored(scene, anchors), -1)
    return clearance


def splat(samples: EdgeSamples, change: Array, size: tuple[int, int]) -> Array:
    """Return the picture (height, width, 3) that changes (m,) of the clearances make. size: width, height."""
    width, height = size
    light = (samples.weight * change[:, None, None]).reshape(-1, 3)
    picture = jnp.zeros((height * width, 3), light.dtype).at[samples.pixel.ravel()].add(light, mode="drop")
    return picture.reshape(height, width, 3)


def _light_points(lights: Lights, points: LightPoints) -> Array:
    places, radii, _ = casters_of(lights)
    center = _rows(places, points.light)
    return center if radii is None else center + _rows(radii[:, None], points.light) * points.omega


def _view_points(scene: Scene, points: ViewPoints) -> Array:
    view = view_of(scene.camera)
    toward = jax.vmap(lambda image: view.toward((image[0], image[1])))(points.image)
    return view.position[None] + points.tau[:, None] * toward


def _anchored(scene: Scene, anchors: Anchors) -> Array:
    points = jnp.zeros_like(anchors.factor)
    if anchors.sphere is not None:
        assert anchors.normal is not None and anchors.on_sphere is not None
        center, radius = spheres_of(scene)
        place = _rows(center, anchors.sphere) + _rows(radius[:, None], anchors.sphere) * anchors.normal
        points += anchors.on_sphere[:, None] * place
    if anchors.vertices is not None:
        assert anchors.weights is not None and scene.triangles is not None
        for i in range(3):
            points += anchors.weights[:, i : i + 1] * _rows(scene.triangles.vertices, anchors.vertices[:, i])
    return points


def spheres_of(scene: Scene) -> tuple[Array, Array]:
    """Return centres (n, 3) and radii (n,) of the spheres, then the sphere lights, of a scene that has one."""
    centers, radii = [], []
    if scene.spheres is not None:
        centers, radii = [scene.spheres.center], [scene.spheres.radius]
    if scene.lights is not None and scene.lights.radius is not None:
        centers, radii = [*centers, scene.lights.position], [*radii, scene.lights.radius]
    return jnp.concatenate(centers), jnp.concatenate(radii)


def _rows(table: Array, index: Array) -> Array:
    """Return table[index] (m, d). Short tables are read by a product, so that the transpose is no scatter."""
    n = table.shape[0]
    if n == 1:
        return jnp.broadcast_to(table, (index.shape[0], table.shape[1]))
    if n > ONE_HOT_ROWS:
        return table[index]
    chosen = (index[:, None] == jnp.arange(n, dtype=index.dtype)[None]).astype(table.dtype)
    return jnp.matmul(chosen, table, precision=lax.Precision.HIGHEST)
