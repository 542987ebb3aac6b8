"""How a path from the camera moves with the surfaces it turns on, its random numbers held fixed.

The clearance of a path's last ray, or last point, is a number; what it changes by with all that the path has met is
found backwards, event by event, without reading more of the scene than the surface of each event.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxrt.boundary.clearance import Bends, EdgeSamples, Path, Trail, Turn, ViewRays
from jaxrt.boundary.guiding import LANES, of_packets
from jaxrt.cameras import Projection, View
from jaxrt.core.maths import dot, face_forward, grad_only, normalize, safe_divide
from jaxrt.core.pytree import pytree, where
from jaxrt.core.records import Hit, Ray, SurfacePoint
from jaxrt.core.samplers import LAST, Stream, independent
from jaxrt.core.sampling import numbers_of_direction
from jaxrt.kernels.few import where_any
from jaxrt.kernels.native import once
from jaxrt.materials import Materials, numbers_toward, scatter, single
from jaxrt.shapes import Geometry, leave, surface_point
from jaxrt.shapes.sphere import SphereTable
from jaxrt.shapes.triangle import corner_table
from jaxrt.transport.path import Tables

LENS = 1 << 30  # block of a sample's random numbers that choose a place on the lens: no event has that number
ONWARD = 1e-4  # of a path's segment, more than the rounding of where it begins


@pytree
class Vertex:
    """A point that a line source's light arrives at."""

    point: SurfacePoint
    index: Array  # () int32 primitive
    view: Projection
    pixel: Array  # () int32, beyond the picture where the camera does not see it
    weight: Array  # (3,)


@pytree
class _Shape:
    """What places one surface."""

    center: Array | None  # (3,)
    radius: Array | None  # ()
    corners: Array | None  # (3, 3)
    normals: Array | None  # (3, 3)


def pull_ray(geometry: Geometry, materials: Materials, turn: Turn, change: Ray) -> tuple[Trail, Ray]:
    """Return the factors of a surface in `change`·r, r being the ray that leaves it, and those of the ray that arrives.

    change: (3,) factors of origin and direction.
    """
    shape = once(_shape)(geometry, turn.index)
    at_point, at_direction, bends = once(_pull_onward)(geometry, materials, shape, turn, change)
    factors, before = once(_pull_point)(geometry, shape, turn, at_point)
    trail = Trail(turn.index, factors.center, factors.radius, factors.corners, factors.normals, bends)
    return trail, Ray(before.origin, before.direction + at_direction)


def _pull_onward(
    geometry: Geometry, materials: Materials, shape: _Shape, turn: Turn, change: Ray
) -> tuple[SurfacePoint, Array, Bends | None]:
    """Return the factors of the point, the direction that arrives and the material in those of the ray that leaves."""
    there = _point(geometry, turn.index, shape, turn.ray)
    own, row = single(materials, there)

    def onward(point: SurfacePoint, arriving: Array, own: Materials) -> Ray:
        return leave(point, scatter(own, replace(point, material=row), -arriving, turn.numbers).direction)

    at_point, at_direction, at_material = jax.vjp(onward, _unmarked(there), turn.ray.direction, own)[1](change)
    if not materials.bends:
        return at_point, at_direction, None
    factors = {f"{kind}.{field}": getattr(getattr(at_material, kind), field)[0] for kind, field in materials.bends}
    return at_point, at_direction, Bends(there.material, factors)


def _pull_point(geometry: Geometry, shape: _Shape, turn: Turn, change: SurfacePoint) -> tuple[_Shape, Ray]:
    """Return the factors of a surface, and of the ray that arrives, in those of the point."""

    def place(shape: _Shape, ray: Ray) -> SurfacePoint:
        return _unmarked(_point(geometry, turn.index, shape, ray))

    factors: tuple[_Shape, Ray] = jax.vjp(place, shape, turn.ray)[1](change)
    return factors


def _unmarked(point: SurfacePoint) -> SurfacePoint:
    """Return the point without its material and vertices: whole numbers have no derivative."""
    return replace(point, material=jnp.zeros_like(point.error), chart=None)


def _shape(geometry: Geometry, index: Array) -> _Shape:
    center = radius = corners = normals = None
    if geometry.spheres is not None:
        row = jnp.minimum(index, geometry.spheres.radius.shape[0] - 1)
        center, radius = geometry.spheres.center[row], geometry.spheres.radius[row]
    if geometry.triangles is not None:
        row = jnp.maximum(index - spheres_count(geometry), 0)
        corners = geometry.triangles.corners[row]
        normals = None if geometry.triangles.normals is None else geometry.triangles.normals[row]
    return _Shape(center, radius, corners, normals)


def spheres_count(geometry: Geometry) -> int:
    """Return the number of primitives that are spheres or sphere lights."""
    return 0 if geometry.spheres is None else geometry.spheres.radius.shape[0]


def _point(geometry: Geometry, index: Array, shape: _Shape, ray: Ray) -> SurfacePoint:
    """Return where a ray meets the surface of primitive `index`, placed as `shape` says."""
    n = spheres_count(geometry)
    spheres = triangles = None
    if geometry.spheres is not None:
        assert shape.center is not None and shape.radius is not None
        spheres = _sphere(geometry.spheres, jnp.minimum(index, n - 1), shape.center, shape.radius)
    if geometry.triangles is not None:
        assert shape.corners is not None
        material = geometry.triangles.material[jnp.maximum(index - n, 0)]
        normals = None if shape.normals is None else shape.normals[None]
        wide = geometry.triangles.wide
        chart = jax.tree.map(lambda x: x[jnp.maximum(index - n, 0)][None], geometry.triangles.chart)
        triangles = corner_table(shape.corners[None], material[None], None, normals, chart, wide)
    among = jnp.where(index < n, 0, 1 if n else 0).astype(jnp.int32)
    return surface_point(Geometry(spheres, triangles), ray, Hit(among, jnp.ones((), bool)))


def _sphere(table: SphereTable, row: Array, center: Array, radius: Array) -> SphereTable:
    """Return one row of a table, with the derivatives in centre and radius that `sphere_table` gives it."""
    squared = dot(center, center)
    huge = radius * radius > squared / 4
    one = jax.tree.map(lambda x: x[row], replace(table, outside=None, tree=None))
    base, shift = grad_only(jnp.where(huge, 0, center)), grad_only(jnp.where(huge, center, 0))
    constant = grad_only(jnp.where(huge, squared, 0) - radius * radius)
    moving = SphereTable(center, radius, one.base + base, one.shift + shift, one.constant + constant, one.material)
    moving = replace(moving, charted=table.charted)
    return jax.tree.map(lambda x: x[None], moving)


def with_trails(
    tables: Tables, groups: Sequence[EdgeSamples], shapes_move: bool, devices: tuple[jax.Device, ...]
) -> list[EdgeSamples]:
    """Return the samples with what their paths move with: of all groups in one kernel, for it is a large one."""
    waiting = [samples.path for samples in groups if samples.path is not None]
    if not waiting:
        return list(groups)
    events = max(path.turns.index.shape[1] for path in waiting)
    paths = jax.tree.map(lambda *x: jnp.concatenate(x), *(_plain(path, events) for path in waiting))
    count = paths.last.shape[0] // LANES

    def one_packet(operands: tuple[Tables, Path], packet: Array) -> tuple[ViewRays, Trail | None]:
        tables, paths = operands
        lanes = jax.tree.map(lambda x: x.reshape(count, LANES, *x.shape[1:])[packet], paths)
        return jax.vmap(partial(trail_of, tables, shapes_move=shapes_move))(lanes)

    found = of_packets(one_packet, (tables, paths), count, devices)
    found = jax.tree.map(lambda x: x.reshape(count * LANES, *x.shape[2:]), found)
    done, start = [], 0
    for samples in groups:
        if samples.path is None:
            done.append(samples)
            continue
        end = start + samples.path.last.shape[0]
        view, trail = jax.tree.map(lambda x, start=start, end=end: x[start:end], found)
        weight = samples.weight
        if samples.path.along is not None:
            weight = weight * jax.vmap(partial(_steepness, tables.camera))(view, samples.path.along)[:, None, None]
        moves = (view, trail) if shapes_move else (None, None)
        done.append(replace(samples, weight=weight, view=moves[0], trail=moves[1], path=None))
        start = end
    return done


def _plain(path: Path, events: int) -> Path:
    """Return the paths with so many events: those beyond the last are of no matter."""
    short = events - path.turns.index.shape[1]
    turns = jax.tree.map(lambda x: jnp.pad(x, [(0, 0), (0, short), *[(0, 0)] * (x.ndim - 2)]), path.turns)
    return replace(path, turns=turns, along=None)


def _steepness(camera: View, view: ViewRays, along: Array) -> Array:
    """Return F_j / (F_x² + F_y²) of the clearance F along a direction j of the picture."""
    here = camera.at(view.lens)

    def towards(x: Array, y: Array) -> Array:
        turned = dot(view.toward, here.toward((x, y)))
        return turned if here.heading is None else turned + dot(view.start, here.start((x, y)))

    one, nothing = jnp.ones_like(along[0]), jnp.zeros_like(along[0])
    slopes = [jax.jvp(towards, (view.image[0], view.image[1]), t)[1] for t in ((one, nothing), (nothing, one))]
    return safe_divide(along[0] * slopes[0] + along[1] * slopes[1], slopes[0] * slopes[0] + slopes[1] * slopes[1])


def trail_of(tables: Tables, path: Path, shapes_move: bool = True) -> tuple[ViewRays, Trail | None]:
    """Return what the clearance of a path's last ray depends on; all is 0, whatever the path, where the factors are."""
    wanted = jnp.any(path.change.origin != 0)
    tables = replace(tables, camera=tables.camera.at(path.lens))

    def back(change: Ray, event: tuple[Array, Turn]) -> tuple[Ray, Trail | None]:
        k, turn = event
        trail, before = pull_ray(tables.geometry, tables.materials, turn, change)
        # What comes after is not on the way
        on_way = wanted & (k <= path.last)
        factors = where(on_way, trail, jax.tree.map(jnp.zeros_like, trail)) if shapes_move else None
        return where(on_way, before, change), factors

    events = path.turns.index.shape[0]
    if events == 0:
        return view_rays(tables, path.image, path.change), None
    numbers = jnp.arange(events, dtype=jnp.int32)
    change, trail = lax.scan(back, path.change, (numbers, path.turns), reverse=True)
    return view_rays(tables, path.image, change), trail


def through_lens(tables: Tables, stream: Stream) -> Tables:
    """Return the tables with a camera that sees through one place of its lens, if it has one."""
    if tables.camera.lens is None:
        return tables
    u = independent(stream, LENS)[2:]
    return replace(tables, camera=tables.camera.through((u[0].astype(tables.dtype), u[1].astype(tables.dtype))))


def _coins(tables: Tables, stream: Stream, events: int) -> Array:
    """Return numbers (events,) in [0, 1) that light on its way to the camera has no use for."""
    return jax.vmap(lambda k: independent(stream, k + 1)[0].astype(tables.dtype))(jnp.arange(events))


def path_through(
    tables: Tables, points: Array, index: Array, coins: Array | None, last: tuple[Array, Array] | None = None
) -> Turn:
    """Return the events (k,) of a path from the camera that meets primitives (k,) at points (k, 3), in this order.

    coins: (k,) in [0, 1), which pick the lobes of glossy surfaces; None where there are none. last: the number () of
    its last event, and the place (3,) to which it goes from there.
    """
    source = jnp.concatenate([tables.camera.eye(points[0])[None], points[:-1]])
    beyond = jnp.concatenate([points[1:], points[-1:]])
    if last is not None:
        beyond = jnp.where((jnp.arange(index.shape[0]) == last[0])[:, None], last[1][None], beyond)
    return jax.vmap(once(partial(_turn, tables)))(source, points, index, beyond, coins)


def vertices_along(
    vertex: Callable[[Tables, Stream, Any, Array], tuple[Any, Vertex]],
    tables: Tables,
    stream: Stream,
    carrier: Any,
    events: int,
) -> Vertex:
    """Return the vertices (events,) that light comes to, each by vertex(tables, stream, carrier, number).

    carrier: light under way, with its flux (3,). A packet of which none is left looks for nothing.
    """

    def dark(tables: Tables, stream: Stream, carrier: Any, k: Array) -> tuple[Any, Vertex]:
        shapes = jax.eval_shape(vertex, tables, stream, carrier, k)[1]
        nothing: Vertex = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), shapes)
        return carrier, replace(nothing, pixel=jnp.int32(tables.camera.width * tables.camera.height))

    def step(carrier: Any, k: Array) -> tuple[Any, Vertex]:
        found: tuple[Any, Vertex] = where_any(jnp.any(carrier.flux != 0), vertex, dark, tables, stream, carrier, k)
        return found

    vertices: Vertex = lax.scan(step, carrier, jnp.arange(events, dtype=jnp.int32))[1]
    return vertices


def one_of(vertices: Vertex, choice: Array) -> tuple[Vertex, Array]:
    """Return one of the vertices after the first, and its number: taken by what it brings, it stands for all.

    choice: () in [0, 1).
    """
    sums = jnp.cumsum(jnp.sum(vertices.weight[1:], -1))
    number = 1 + jnp.minimum(jnp.sum(sums <= choice * sums[-1]), sums.shape[0] - 1).astype(jnp.int32)
    one = jax.tree.map(lambda x: x[number], vertices)
    return replace(one, weight=one.weight * safe_divide(sums[-1], jnp.sum(one.weight))), number


def path_from(
    tables: Tables,
    stream: Stream,
    vertices: Vertex,
    shown: Vertex,
    number: Array,
    change: Ray,
    end: Array | None,
) -> Path:
    """Return the path that the camera sees begin at vertex `number`, which is `shown`, and that ends at the first one.

    change: factors of the ray from there to `end`, (3,), of no matter where only the ray's origin counts.
    """
    order = jnp.maximum(number - jnp.arange(vertices.index.shape[0]), 0)
    last = None if end is None else (number, end)
    coins = _coins(tables, stream, order.shape[0]) if tables.materials.are_glossy else None
    turns = path_through(tables, vertices.point.position[order], vertices.index[order], coins, last)
    brings = jnp.sum(shown.weight) > 0
    change = jax.tree.map(lambda x: jnp.where(brings, x, 0), change)
    return Path(turns, number, change, shown.view.image, lens=tables.camera.lens)


def _turn(tables: Tables, source: Array, place: Array, index: Array, beyond: Array, coin: Array | None) -> Turn:
    """Return the event at a place on a path from somewhere to somewhere."""
    # A little on the way: from inside a ball to its other side, not to where it is
    ray, onward = Ray(source + ONWARD * (place - source), normalize(place - source)), normalize(beyond - place)
    point = surface_point(tables.geometry, ray, Hit(index, jnp.ones((), bool)))
    u0, u1 = numbers_of_direction(face_forward(point.shading, -ray.direction), onward)
    # Glass reflects for small numbers
    diffuse = point.material < tables.materials.ends[0]
    back = dot(point.shading, ray.direction) * dot(point.shading, onward) < 0
    numbers = jnp.where(diffuse, u0, jnp.where(back, 0, LAST)), u1
    if coin is not None:
        numbers = numbers_toward(tables.materials, point, -ray.direction, onward, coin, numbers)
    return Turn(ray, index, numbers)


def view_rays(tables: Tables, image: Array, change: Ray) -> ViewRays:
    """Return the factors of the camera's position and direction from those of its ray through an image point."""
    camera = tables.camera
    place = image[0], image[1]

    def pull(start: Array, toward: Array, change: Ray) -> tuple[Array, Array]:
        return jax.vjp(lambda o, d: Ray(o, normalize(d)), start, toward)[1](change)

    return ViewRays(image, *once(pull)(camera.start(place), camera.toward(place), change), camera.lens)


def central_ray(camera: View, x: Array, y: Array) -> Ray:
    """Return the ray of a camera through an image point and one place of its lens."""
    return Ray(camera.start((x, y)), normalize(camera.toward((x, y))))
