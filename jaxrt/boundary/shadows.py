"""The edges of shadows: direct ones, and what they do to the light that diffuse surfaces pass on.

A sample starts at a point y of a light and grazes an outline at q. Its line meets the scene at x, where a unit of
clearance brings the power of a line source, E · J / D² (E: intensity towards q over the density of y; J: length of
outline per unit of t; D = |q − y|). The receiver's cosine and distance cancel. From x the power is followed along a
random walk, and each diffuse vertex shows it to the camera: the primal light tracing of that line source.
"""

from dataclasses import replace
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxrt.boundary.anchors import occluder_anchors, surface_anchors
from jaxrt.boundary.clearance import Anchors, EdgeSamples, LightPoints, ViewRays, beside
from jaxrt.boundary.guiding import Draw, place, sample_guided
from jaxrt.boundary.silhouettes import Rim, Silhouettes, angular_lengths, bins_for, edge_table, rim_at
from jaxrt.boundary.trail import Vertex, one_of, path_from, through_lens, vertices_along
from jaxrt.cameras import Projection, edges_known, projection
from jaxrt.core.maths import dot, face_forward, normalize, safe_divide, safe_sqrt, unit_roundoff
from jaxrt.core.pytree import pytree
from jaxrt.core.records import Ray, SurfacePoint
from jaxrt.core.samplers import LAST, Stream, independent
from jaxrt.core.sampling import (
    pdf_cosine_hemisphere,
    pdf_uniform_sphere,
    sample_cosine_hemisphere,
    sample_uniform_sphere,
)
from jaxrt.filters import Filter
from jaxrt.kernels.native import in_stages, once
from jaxrt.lights import Lights, LightTable, casters_of, intensity_toward
from jaxrt.materials import Scattering, absorption_of, evaluate, scatter
from jaxrt.scene import Scene
from jaxrt.shapes import find, leave, occluded, surface_point
from jaxrt.transport.medium import around_lights, medium_at
from jaxrt.transport.outputs import Output
from jaxrt.transport.path import Tables, tables_of

NUDGE = 1e-4  # of the distance to the outline: rays pass it at this distance, since grazing ones may go either way
BEYOND = 1e-3  # a receiver is farther than the outline by this share of its distance
LOBE = 0.9  # share of light points drawn by the cosine to the outline; the others are uniform
LIGHTS_ONLY = 2  # soft shadows of lights that alone move get this part of the samples: they are smooth
GRAZING = 1e-4  # smallest cosine between camera ray and receiver


class Plan(NamedTuple):
    """What is compiled, besides the scene's structure."""

    n: int  # samples
    max_depth: int
    geometry_moves: bool
    lights_move: bool
    devices: tuple[jax.Device, ...]
    outputs: tuple[Output, ...] = ()  # whose edges are wanted, instead of those of radiance
    filter: Filter | None = None  # by which film counts in pixels; None: a box

    def part(self, share: int, of_lights: int) -> int:
        """Return the number of samples of which one in so many is taken, or where lights alone move in so many."""
        return -(-self.n // (share if self.geometry_moves else of_lights))


@pytree
class ShadowTables:
    """What shadow samples are drawn from."""

    tables: Tables
    outlines: Silhouettes
    faces: Array | None  # (n, 3) int32
    around: Array | None  # (lights, 3) absorption of what each light is in; None where nothing absorbs


@pytree
class LightPoint:
    """A point on a light."""

    position: Array  # (3,)
    omega: Array  # (3,) unit; 0 for a point light
    start: Array  # (3,) the position moved off the light's surface by its rounding
    shine: Array  # (3,) intensity over the density of ω; for a sphere to be multiplied by cosine/π


@pytree
class Carrier:
    """A line source's light under way."""

    probe: Ray  # finds the next surface
    ray: Ray  # tells where on it the light arrives
    least: Array  # () distance that it has to travel
    flux: Array  # (3,)
    aside: Array  # (3,) towards the shadow, as a share of the distance to where the camera is to see it; 0: on its edge
    absorption: Array | None = None  # (3,) of what it goes through, as far as is known; None where nothing absorbs


def shadow_edges(scene: Scene, seed: Array, plan: Plan) -> tuple[EdgeSamples, ...]:
    """Return samples of the edges of shadows; none where nothing can cast or show one.

    Nor where they are not known: of lights that have no place, and before a camera that has neither eye nor heading.
    """
    if not edges_known(scene.camera) or scene.lights is None or casters_of(scene.lights)[0].shape[0] == 0:
        return ()
    tables = tables_of(scene)
    # A scene's only light cannot block itself
    spheres = tables.occluders.spheres
    edges = None if scene.triangles is None else edge_table(scene.triangles)
    outlines = Silhouettes(spheres, edges)
    if tables.lights is None or outlines.rows == 0 or not tables.materials.are_lit:
        return ()
    bins = bins_for(outlines.rows)
    faces = scene.triangles.faces if scene.triangles is not None and plan.geometry_moves else None
    around = around_lights(tables.geometry, tables.materials, tables.lights.lights)
    operands = ShadowTables(tables, outlines, faces, around)
    weights = shadow_weights(tables, outlines, bins)
    n = plan.part(1, LIGHTS_ONLY if tables.lights.lights.have_size else 1)
    return sample_guided(partial(_sample, plan, bins), operands, weights, n, seed, plan.devices)


def shadow_weights(tables: Tables, outlines: Silhouettes, bins: int) -> Array:
    """Return weights (lights · rows · bins,): the angle that each bin spans times the light's power."""
    assert tables.lights is not None
    places, radii, powers = casters_of(tables.lights.lights)
    reach = jnp.zeros_like(places[:, 0]) if radii is None else radii
    own = tables.first_light + jnp.arange(places.shape[0])

    def of_light(light: tuple[Array, Array, Array, Array]) -> Array:
        place, reach, power, own = light
        angles = angular_lengths(outlines, place, reach, False, bins)
        # A light casts no shadow of itself
        other = (jnp.arange(outlines.rows) != own) | (own >= outlines.spheres_count)
        return jnp.where(jnp.repeat(other, bins), angles, 0) * power

    return lax.map(of_light, (places, reach, powers, own)).ravel()


def _sample(plan: Plan, bins: int, operands: ShadowTables, draw: Draw) -> tuple[tuple[EdgeSamples, ...], Array]:
    """Return one sample, and what it brings."""
    operands = replace(operands, tables=through_lens(operands.tables, draw.stream))
    tables, outlines = operands.tables, operands.outlines
    assert tables.lights is not None
    # Draw a line from a light past an outline
    placed = once(place)(draw)
    light, rest = placed.bin // (outlines.rows * bins), placed.bin % (outlines.rows * bins)
    row = rest // bins
    t = ((rest % bins).astype(placed.t.dtype) + placed.t) / bins
    source = once(light_point)(tables.lights, outlines, light, row, t, draw.spread)
    rim = once(partial(rim_at, creases=False))(outlines, row, t, source.position)
    source = _shone(tables.lights.lights, light, source, rim)
    density = placed.density * bins * draw.total
    carrier = setting_out(once(carrier_past)(source, rim, density), operands.around, light)
    # Follow its light
    vertices = vertices_along(partial(vertex, False), tables, draw.stream, carrier, plan.max_depth)
    receiver = jax.tree.map(lambda x: x[0], vertices)
    samples = once(partial(_edge_samples, plan))(operands, light, source, row, t, rim, receiver, vertices, draw.stream)
    along = _along(rim, source, receiver)
    measure = jnp.sum(vertices.weight) * (1 if plan.geometry_moves else 1 - along)
    return samples, measure


def light_point(
    table: LightTable,
    outlines: Silhouettes,
    light: Array,
    row: Array,
    t: Array,
    u: tuple[Array, Array],
) -> LightPoint:
    """Return a point of a light, likelier on the side that faces an outline."""
    lights = table.lights
    places, radii, _ = casters_of(lights)
    center = places[light]
    intensity = jnp.zeros_like(center) if lights.position is None else lights.intensity[light]
    if radii is None:
        return LightPoint(center, jnp.zeros_like(center), center, intensity)
    omega, pdf = towards(_middle(outlines, row, t) - center, u)
    radius = radii[light]
    position = center + radius * omega
    rounding = 32 * unit_roundoff(center) * (jnp.sum(jnp.abs(center)) + radius)
    return LightPoint(position, omega, position + rounding * omega, intensity / pdf)


def towards(away: Array, u: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return a unit direction, likelier the nearer it is to that of a vector, and its density per steradian."""
    axis = normalize(away)
    axis = jnp.where(dot(axis, axis) > 0, axis, jnp.zeros_like(axis).at[2].set(1))
    u0 = u[0] / LOBE, (u[0] - LOBE) / (1 - LOBE)
    lobe = u[0] < LOBE
    omega = jnp.where(
        lobe,
        sample_cosine_hemisphere(axis, (jnp.where(lobe, u0[0], 0), u[1])),
        sample_uniform_sphere((jnp.where(lobe, 0, jnp.minimum(u0[1], 1)), u[1])),
    )
    return omega, LOBE * pdf_cosine_hemisphere(dot(omega, axis)) + (1 - LOBE) * pdf_uniform_sphere()


def _shone(lights: Lights, light: Array, source: LightPoint, rim: Rim) -> LightPoint:
    """Return the point of a light with what shines past an outline, where that depends on where it is."""
    if not lights.others:
        return source
    sphere = light < (0 if lights.position is None else lights.position.shape[0])
    shine = jnp.where(sphere, source.shine, intensity_toward(lights, light, rim.point))
    return replace(source, omega=jnp.where(sphere, source.omega, 0), shine=shine)


def _middle(outlines: Silhouettes, row: Array, t: Array) -> Array:
    """Return a point near all of a row's bin."""
    n = outlines.spheres_count
    points = []
    if outlines.spheres is not None:
        points.append(outlines.spheres.center[jnp.minimum(row, n - 1)])
    if outlines.edges is not None:
        corners = outlines.edges.corners[jnp.maximum(row - n, 0)]
        points.append(corners[0] + t * (corners[1] - corners[0]))
    return points[0] if len(points) == 1 else jnp.where(row < n, points[0], points[1])


def carrier_past(source: LightPoint, rim: Rim, density: Array) -> Carrier:
    """Return the light that sets out past an outline, per unit of clearance and of the samples' density."""
    line = normalize(rim.point - source.position)
    shine = source.shine
    sphere = dot(source.omega, source.omega) > 0
    shine = shine * jnp.where(sphere, jnp.maximum(dot(source.omega, line), 0) / jnp.pi, 1)
    ok = rim.valid & (density > 0) & (rim.distance > 0)
    spread = safe_divide(rim.jacobian, rim.distance * rim.distance * density)
    flux = jnp.where(ok, shine * spread, 0)
    probe = normalize(rim.point + NUDGE * rim.distance * rim.normal - source.start)
    rays = Ray(source.start, probe), Ray(source.start, line)
    return Carrier(*rays, rim.distance * (1 + BEYOND), flux, -NUDGE * rim.normal)


def setting_out(carrier: Carrier, around: Array | None, light: Array) -> Carrier:
    """Return light that sets out within what is around its lamp."""
    return carrier if around is None else replace(carrier, absorption=around[light])


def vertex(bent: bool, tables: Tables, stream: Stream, carrier: Carrier, k: Array) -> tuple[Carrier, Vertex]:
    """Return the light one surface on, and the vertex there. k: () its number, from 0.

    bent: whether the first surface must be a mirror or glass; else it must not, for light samples do not light these.
    """
    hit = once(find)(tables.geometry, carrier.probe)
    point = once(surface_point)(tables.geometry, carrier.ray, hit)
    travelled = dot(point.position - carrier.ray.origin, carrier.ray.direction)
    arrived = hit.valid & (travelled > carrier.least)
    wo, medium = -carrier.ray.direction, None
    arriving = carrier.flux * _tilt(point, wo)
    if carrier.absorption is not None:
        medium = medium_at(tables.materials, carrier.absorption, point, wo)
        arriving = arriving * jnp.exp(-medium.here * jnp.where(arrived, travelled, 0))
        # Materials would count what the way to the camera loses
        point = replace(point, travelled=None)
    _, _, *u = (x.astype(wo.dtype) for x in independent(stream, k + 1))
    scattering = in_stages(scatter)(tables.materials, point, wo, (u[0], u[1]))
    passes = arrived & ((scattering.specular if bent else scattering.lit) | (k > 0))
    # Show it to the camera
    faced = face_forward(point.shading, wo)
    if tables.materials.are_translucent:
        # What lets light pass shows it on both sides
        away = tables.camera.eye(point.position) - point.position
        clear = absorption_of(tables.materials, point)[1] if medium is None else medium.clear
        faced = jnp.where(clear, face_forward(point.shading, away), faced)
    view, share = once(_connect)(tables, point, faced, travelled * carrier.aside)
    shown = passes & scattering.lit & (share > 0)
    weight = jnp.where(shown, _toward_camera(tables, point, wo, scattering, arriving, share), 0)
    pixel = jnp.where(shown, view.pixel, tables.camera.width * tables.camera.height)
    leaving = safe_divide(jnp.ones_like(arriving), _tilt(point, scattering.direction) * jnp.ones_like(arriving))
    flux = jnp.where(passes, arriving * leaving * _power_kept(tables, point, wo, scattering), 0)
    ray = once(leave)(point, scattering.direction)
    beyond = None if medium is None else medium.beyond(scattering.direction)
    onward = Carrier(ray, ray, jnp.zeros_like(carrier.least), flux, jnp.zeros_like(flux), beyond)
    return onward, Vertex(point, hit.index, view, pixel, weight)


def _toward_camera(
    tables: Tables, point: SurfacePoint, wo: Array, scattering: Scattering, arriving: Array, share: Array
) -> Array:
    """Return the light (3,) that a surface sends to the camera of what arrives from `wo`."""
    sent = jnp.zeros_like(arriving)
    if scattering.albedo is not None:
        sent = arriving * scattering.albedo * (share / jnp.pi)
    if scattering.glossy is None:
        return sent
    away = tables.camera.eye(point.position) - point.position
    if tables.materials.absorb:
        point = replace(point, travelled=safe_sqrt(dot(away, away)))
    value = in_stages(evaluate)(tables.materials, point, normalize(away), wo)[0]
    cosine = jnp.abs(dot(point.shading, wo)) * jnp.ones_like(value)
    return jnp.where(scattering.glossy, arriving * safe_divide(value, cosine) * share, sent)


def _power_kept(tables: Tables, point: SurfacePoint, wo: Array, scattering: Scattering) -> Array:
    """Return the share (3,) of the light from `wo` that goes on, over the density of its direction.

    Radiance changes by the square of the index, power does not. Of single directions, the weights of both ways, of
    which one brings what the other takes, have its square for a product; else what is scattered the other way tells it
    (Veach 1997, §5.2).
    """
    weight, direction = scattering.weight, scattering.direction
    if tables.materials.are_translucent:
        assert scattering.glossy is not None
        there, back = (
            in_stages(evaluate)(tables.materials, point, *ways)[0] for ways in ((wo, direction), (direction, wo))
        )
        turned = safe_divide(jnp.abs(dot(point.shading, direction)), jnp.abs(dot(point.shading, wo)))
        weight = jnp.where(scattering.glossy, weight * turned * safe_divide(back, there), weight)
    if not any(kind.transmits and kind.is_delta for kind in tables.materials.kinds):
        return weight
    through = dot(point.shading, wo) * dot(point.shading, direction) < 0
    # Of all that glass may do it lets light through for the largest numbers
    lobe = jnp.where(through, LAST, 0).astype(wo.dtype)
    squared = scattering.weight * in_stages(scatter)(tables.materials, point, direction, (lobe, lobe)).weight
    return jnp.where(scattering.specular, safe_sqrt(jnp.where(scattering.specular, squared, 1)), weight)


def _tilt(point: SurfacePoint, direction: Array) -> Array:
    """Return the cosine to the shading normal over that to the geometric one: 1 unless the mesh is smooth.

    Light is scattered by the former and spread over the surface by the latter (Veach 1997, §5.3).
    """
    if point.smooth is None:
        return jnp.ones_like(point.error)
    return jnp.abs(safe_divide(dot(point.shading, direction), dot(point.normal, direction)))


def _connect(tables: Tables, point: SurfacePoint, facing: Array, aside: Array) -> tuple[Projection, Array]:
    """Return a point's image and pixels per area at right angles to the surface; 0 where the camera does not see it.

    aside: (3,) step, along the surface, to where the camera must see it. What an edge sweeps is on its dark side: a
    camera beside the lamp sees the edge along the outline of what casts it, which hides all of the shadow.
    """
    view = projection(tables.camera, point.position)
    eye = tables.camera.eye(point.position)
    away = eye - point.position
    squared = dot(away, away)
    direction = normalize(away)
    # What the camera sees of the surface, on the side that shows light
    cosine = jnp.where(dot(facing, direction) > 0, jnp.abs(dot(point.normal, direction)), 0)
    faced = view.inside & (cosine > GRAZING)
    # A ray of no length finds nothing, in no time
    beside = leave(point, direction).origin + aside - dot(point.normal, aside) * point.normal
    line = eye - beside
    reach = jnp.where(faced, safe_sqrt(dot(line, line)) - point.error, 0)
    blocked = occluded(tables.geometry, Ray(beside, normalize(line)), reach)
    return view, jnp.where(faced & ~blocked, safe_divide(cosine * view.density, squared), 0)


def _along(rim: Rim, source: LightPoint, receiver: Vertex) -> Array:
    """Return where on the line from light to receiver the outline lies: s in [0, 1]."""
    whole = receiver.point.position - source.position
    return jnp.clip(safe_divide(rim.distance, safe_sqrt(dot(whole, whole))), 0, 1)


def _edge_samples(
    plan: Plan,
    operands: ShadowTables,
    light: Array,
    source: LightPoint,
    row: Array,
    t: Array,
    rim: Rim,
    receiver: Vertex,
    vertices: Vertex,
    stream: Stream,
) -> tuple[EdgeSamples, ...]:
    """Return the weights of a line and the constants of its clearance."""
    s, places = _along(rim, source, receiver), beside(vertices.view.image, plan.filter)
    points = LightPoints(light, source.omega, (1 - s) * rim.normal)
    occluder = occluder_anchors(operands.outlines, operands.faces is not None, row, t, rim)
    if not plan.geometry_moves:
        # Lights move, which among several may cast shadows too
        crowd = operands.outlines.spheres_count > operands.tables.first_light
        casters = (occluder,) if crowd else ()
        return (EdgeSamples(vertices.pixel, vertices.weight, points, None, casters, place=places),)
    view, anchors = _attached(operands, receiver, s * rim.normal)
    moving = points if plan.lights_move else None
    place = None if places is None else places[:1]
    first = EdgeSamples(vertices.pixel[:1], vertices.weight[:1], moving, view, (anchors, occluder), place=place)
    if plan.max_depth == 1:
        return (first,)
    shown, chosen = one_of(vertices, independent(stream, 0)[0].astype(t.dtype))
    factor = s * rim.normal
    path = path_from(operands.tables, stream, vertices, shown, chosen, Ray(factor, jnp.zeros_like(factor)), None)
    place = beside(shown.view.image[None], plan.filter)
    return first, EdgeSamples(shown.pixel[None], shown.weight[None], moving, None, (occluder,), path=path, place=place)


def _attached(operands: ShadowTables, receiver: Vertex, factor: Array) -> tuple[ViewRays, Anchors]:
    """Return what the receiver's point depends on, seen at a fixed image point, times a factor (3,)."""
    camera, n = operands.tables.camera, receiver.point.normal
    toward = camera.toward((receiver.view.image[0], receiver.view.image[1]))
    slope = dot(n, toward)
    shown = jnp.sum(receiver.weight) > 0
    on_surface = jnp.where(shown, n * safe_divide(dot(factor, toward), slope), 0)
    on_ray = jnp.where(shown, factor, 0) - on_surface
    view = ViewRays(receiver.view.image, on_ray, jnp.where(shown, receiver.view.depth, 0) * on_ray, camera.lens)
    point = receiver.point.position, receiver.point.normal
    return view, surface_anchors(operands.tables.geometry, operands.faces, receiver.index, point, on_surface)
