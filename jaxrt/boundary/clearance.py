"""By how much a line clears what it grazes: the only part of the edge term that is differentiated.

A line from A to B grazes an outline at q = A + s (B − A); m is the unit vector at right angles to line and outline. To
first order m does not move the line off the outline when it turns, so the clearance is

    F = m·((1 − s) A + s B − Q),

with Q the point of the occluder that is at q. For a shadow A is a point of the light, c + r ω at constant ω, and B the
point that a fixed image point shows: where the camera's ray o + τ D meets the receiver. With n the receiver's normal
and P its material point there, B moves by o + τ D + D n·(P − o − τ D)/(n·D). For an outline that the camera sees, A is
the camera and q itself lies on o + τ D. So both are

    F = a·(c + r ω) + b·o + e·D + h·P − m·Q,

a sum over points of the scene with constant coefficients: finite for any, linear in each point. Where A or B is where a
path of several events arrives, its surfaces come in by their coefficients too (`trail.py`).
"""

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxrt.cameras import view_of
from jaxrt.core.pytree import dtype_of, pytree
from jaxrt.core.records import Ray
from jaxrt.filters import Filter
from jaxrt.lights import Lights, casters_of
from jaxrt.materials import Materials
from jaxrt.scene import Scene
from jaxrt.shapes.smooth import corner_normals

ONE_HOT_ROWS = 64  # tables up to this long are read by a product, whose transpose is one too


@pytree
class LightPoints:
    """The points c + r ω of lights."""

    light: Array  # (m,) int32
    omega: Array  # (m, 3) unit; 0 for point lights
    factor: Array  # (m, 3) of the point in F


@pytree
class ViewRays:
    """The camera's rays o + τ D(u) through image points u."""

    image: Array  # (m, 2) column and row in pixels
    start: Array  # (m, 3) factor of o in F
    toward: Array  # (m, 3) factor of D
    lens: Array | None = None  # (m, 2) numbers of the place on the camera's lens; None without a lens


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
class Bends:
    """The materials by whose parameters paths turn, and the factors in F of these."""

    row: Array  # (m, k) int32 among the scene's materials
    factors: dict[str, Array]  # (m, k, …) by kind and field, as "glass.ior"; 0 where the material is of another kind


@pytree
class Trail:
    """The surfaces on which paths from the camera turn, and the factors in F of what places each of them."""

    index: Array  # (m, k) int32 primitive
    center: Array | None  # (m, k, 3); None in scenes without spheres
    radius: Array | None  # (m, k)
    corners: Array | None  # (m, k, 3, 3); None in scenes without triangles
    normals: Array | None  # (m, k, 3, 3) of the corners; None in scenes without smooth meshes
    bends: Bends | None  # None in scenes without materials that bend light


@pytree
class Turn:
    """One event of a path: the ray that arrives, what it meets, and the two numbers by which it goes on."""

    ray: Ray
    index: Array  # () int32 primitive
    numbers: tuple[Array, Array]


@pytree
class Path:
    """A path from the camera, by whose last ray, or last point, something is cleared."""

    turns: Turn  # (k,) events
    last: Array  # () int32 number of the event, from 0, that the ray leaves; −1: the camera
    change: Ray  # factors of the ray's origin and direction in F
    image: Array  # (2,) where the path begins
    along: Array | None = None  # (2,) a direction in the picture by whose slope of F the weight is yet to be measured
    lens: Array | None = None  # (2,) as of `ViewRays`


@pytree
class EdgeSamples:
    """Samples of moving edges. Each adds weight · dF to its pixels; what cannot move is None."""

    pixel: Array  # (m, k) int32 row · width + column; beyond the picture where nothing is seen
    weight: Array  # (m, k, c) radiance, or outputs, per unit of clearance
    light: LightPoints | None
    view: ViewRays | None
    anchors: tuple[Anchors, ...]
    trail: Trail | None = None
    path: Path | None = None  # (m,) from which view and trail are yet to be found
    place: Array | None = None  # (m, k, 2) from the pixel's middle, in pixels; None where a pixel is all that counts


def clearance_of(scene: Scene, samples: EdgeSamples) -> Array:
    """Return F (m,) in scene units, up to a constant: differentiable in the scene, finite for any."""
    clearance = jnp.zeros(samples.pixel.shape[0], scene.dtype)
    if samples.light is not None:
        assert scene.lights is not None
        clearance += jnp.sum(samples.light.factor * _light_points(scene.lights, samples.light), -1)
    if samples.view is not None:
        clearance += _view_part(scene, samples.view)
    for anchors in samples.anchors:
        clearance += jnp.sum(anchors.factor * _anchored(scene, anchors), -1)
    if samples.trail is not None:
        clearance += _trail_part(scene, samples.trail)
    return clearance


def beside(image: Array, filter: Filter | None) -> Array | None:
    """Return how far (…, 2) image points are from the middles of their pixels; None without a filter."""
    return None if filter is None else image - jnp.floor(image) - 0.5


def splat(samples: EdgeSamples, change: Array, size: tuple[int, int], filter: Filter | None = None) -> Array:
    """Return the picture (height, width, c) that changes (m,) of the clearances make. size: width, height.

    filter: by which each counts in the pixels around; the samples' own pixels are then those of a picture with the
    filter's margin.
    """
    (width, height), channels = size, samples.weight.shape[-1]
    light = (samples.weight * change[:, None, None]).reshape(-1, channels)
    picture = jnp.zeros((height * width, channels), light.dtype)
    if filter is None:
        picture = picture.at[samples.pixel.ravel()].add(light, mode="drop")
    else:
        picture = _spread(samples, light, picture, size, filter)
    return picture.reshape(height, width, channels)


def _spread(samples: EdgeSamples, light: Array, picture: Array, size: tuple[int, int], filter: Filter) -> Array:
    """Return the picture (pixels, c) with light (n, c) added, shared among all pixels around by a filter."""
    assert samples.place is not None
    (width, height), margin, place = size, filter.margin, samples.place.reshape(-1, 2)
    pixel, across, side = samples.pixel.ravel(), width + 2 * margin, 2 * margin + 1
    column, row = pixel % across - margin, pixel // across - margin

    def add(picture: Array, number: Array) -> tuple[Array, None]:
        right, down = number % side - margin, number // side - margin
        share = filter.weight(place[:, 0] - right.astype(place.dtype))
        share *= filter.weight(place[:, 1] - down.astype(place.dtype))
        x, y = column + right, row + down
        inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        chosen = jnp.where(inside, y * width + x, width * height)
        return picture.at[chosen].add(share[:, None] * light, mode="drop"), None

    return lax.scan(add, picture, jnp.arange(side * side, dtype=pixel.dtype))[0]


def _light_points(lights: Lights, points: LightPoints) -> Array:
    places, radii, _ = casters_of(lights)
    center = _rows(places, points.light)
    return center if radii is None else center + _rows(radii[:, None], points.light) * points.omega


def _view_part(scene: Scene, rays: ViewRays) -> Array:
    view = view_of(scene.camera)

    def ray(image: Array, lens: Array | None) -> tuple[Array, Array]:
        here = view.at(lens)
        return here.start((image[0], image[1])), here.toward((image[0], image[1]))

    start, toward = jax.vmap(ray)(rays.image, rays.lens)
    return jnp.sum(rays.start * start + rays.toward * toward, -1)


def _trail_part(scene: Scene, trail: Trail) -> Array:
    total = jnp.zeros(trail.index.shape, scene.dtype)
    index = trail.index.ravel()
    # Paths end on the spheres that are lights
    if trail.center is not None and scene.spheres is not None:
        assert trail.radius is not None
        row = jnp.clip(index, 0, scene.spheres.radius.shape[0] - 1)
        table = jnp.concatenate([scene.spheres.center, scene.spheres.radius[:, None]], -1)
        factors = jnp.concatenate([trail.center, trail.radius[..., None]], -1)
        total += jnp.sum(factors * _rows(table, row).reshape(factors.shape), -1)
    if trail.corners is not None:
        assert scene.triangles is not None
        row = jnp.maximum(index - _spheres_count(scene), 0)
        corners = scene.triangles.vertices[scene.triangles.faces]
        total += jnp.sum(trail.corners * corners[row].reshape(trail.corners.shape), (-2, -1))
        if trail.normals is not None:
            assert scene.triangles.smooth is not None
            normals = corner_normals(corners, scene.triangles.smooth)
            total += jnp.sum(trail.normals * normals[row].reshape(trail.normals.shape), (-2, -1))
    return jnp.sum(total if trail.bends is None else total + _bent_part(scene.materials, trail.bends), -1)


def _bent_part(materials: Materials, bends: Bends) -> Array:
    """Return what each event's material contributes."""
    total, first = jnp.zeros(bends.row.shape, dtype_of(bends)), 0
    for kind, n in zip(materials.kinds, materials.counts, strict=True):
        for field in kind.kind.parameters:
            factor = bends.factors.get(f"{kind.kind.name}.{field}")
            if factor is not None:
                values = _rows(getattr(kind, field).reshape(n, -1), jnp.clip(bends.row.ravel() - first, 0, n - 1))
                total += jnp.sum(factor * values.reshape(factor.shape), tuple(range(2, factor.ndim)))
        first += n
    return total


def _spheres_count(scene: Scene) -> int:
    """Return the number of primitives that are spheres or sphere lights."""
    spheres = 0 if scene.spheres is None else scene.spheres.radius.shape[0]
    radii = None if scene.lights is None else scene.lights.radius
    return spheres + (0 if radii is None else radii.shape[0])


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
