"""The edges of light that mirrors and glass bring: what a surface sees of a light of some size by scattered rays.

Such a ray finds the light, or not, by chance: what it brings ends abruptly at the light's own rim, and where something
stands between the light and the last mirror. Samples start there, at the light, and must meet a mirror or glass before
the first surface that scatters; from there on all is as for shadows. What the ray's clearance depends on is the path
from the camera at fixed random numbers, as inside of edges: so it moves with all that the path turns on.
"""

from dataclasses import replace
from functools import partial

import jax.numpy as jnp
from jax import Array, lax

from jaxrt.boundary.anchors import occluder_anchors
from jaxrt.boundary.clearance import EdgeSamples, beside
from jaxrt.boundary.guiding import Draw, Placed, place, sample_guided
from jaxrt.boundary.shadows import (
    BEYOND,
    Carrier,
    Plan,
    carrier_past,
    light_point,
    setting_out,
    shadow_weights,
    vertex,
)
from jaxrt.boundary.silhouettes import Rim, Silhouettes, bins_for, edge_table, rim_at
from jaxrt.boundary.trail import one_of, path_from, spheres_count, through_lens, vertices_along
from jaxrt.cameras import edges_known
from jaxrt.core.maths import cross, dot, normalize, safe_divide, safe_sqrt, unit_roundoff
from jaxrt.core.pytree import pytree, where
from jaxrt.core.records import Hit, Ray, SurfacePoint
from jaxrt.core.samplers import independent
from jaxrt.core.sampling import cone_of_sphere, pdf_cone, sample_cone, sample_uniform_sphere
from jaxrt.kernels.native import once
from jaxrt.materials import scatter
from jaxrt.scene import Scene
from jaxrt.shapes import Geometry, surface_point
from jaxrt.shapes.sphere import sphere_chart
from jaxrt.transport.medium import around_lights
from jaxrt.transport.path import Tables, tables_of

CELLS = 4  # parts of a light's rim, and of a mirror each way, among which a pilot shares the samples
LIGHTS_ONLY = 4  # where lights alone move they get this part of the samples: about as noisy then as all else
SEEN = 0.9  # share of places on a ball that are drawn by how it looks from a light
FEW = 32  # surfaces up to which it does
ASKANCE = 0.1  # of the size of a triangle, which it has at least as it looks from a light


@pytree
class CausticTables:
    """What the samples are drawn from."""

    tables: Tables
    outlines: Silhouettes
    around: Array | None  # as of `ShadowTables`


@pytree
class Grazing:
    """Light that sets out past a point of an outline."""

    carrier: Carrier
    row: Array  # () int32 of the outlines
    t: Array  # () place along it
    rim: Rim
    skimming: Array  # (3,) share of the light that goes the same way just inside, with one event more
    sign: Array  # () 1 where light passes outside of the outline, −1 where it does inside


def caustic_edges(scene: Scene, seed: Array, plan: Plan) -> tuple[EdgeSamples, ...]:
    """Return samples of the moving edges of light from spheres that comes by mirrors and glass.

    None where no surface can show such light, nor before a camera of unknown edges.
    """
    lights, materials = scene.lights, scene.materials
    if not edges_known(scene.camera) or lights is None or not lights.have_size:
        return ()
    if plan.max_depth == 1 or not (materials.are_delta and materials.are_lit):
        return ()
    tables = tables_of(scene)
    edges = edge_table(scene.triangles) if scene.triangles is not None and plan.geometry_moves else None
    outlines = Silhouettes(tables.geometry.spheres, edges)
    weights, blocked = _weights(tables, outlines, plan)
    operands = CausticTables(tables, outlines, around_lights(tables.geometry, tables.materials, lights))
    sample = partial(_sample, plan, blocked)
    n = plan.part(1, LIGHTS_ONLY)
    return (sample_guided(sample, operands, weights, n, seed ^ jnp.uint32(4), plan.devices),)


def _weights(tables: Tables, outlines: Silhouettes, plan: Plan) -> tuple[Array, bool]:
    """Return weights of all bins, those of the lights' own rims first, and whether those of other outlines follow."""
    assert tables.lights is not None
    lights = tables.lights.lights
    n, radii = lights.position.shape[0], lights.radius
    assert radii is not None
    power = safe_divide(jnp.sum(lights.intensity, -1), radii)
    sizes = lax.map(lambda light: _sizes(tables, light[0]) * light[1], (lights.position, power))
    cells = _cells(tables)
    rims = jnp.repeat(sizes.ravel(), cells * cells * cells)
    if outlines.rows == n or not (plan.geometry_moves or n > 1):
        return rims, False
    bins = bins_for(outlines.rows)
    others = shadow_weights(tables, outlines, bins).reshape(-1, outlines.rows, bins)
    moves = plan.geometry_moves | (jnp.arange(outlines.rows) >= tables.first_light)
    others = jnp.where((radii > 0)[:, None, None] & moves[None, :, None], others[:n], 0).ravel()
    return jnp.concatenate([safe_divide(x, jnp.full_like(x, jnp.sum(x))) for x in (rims, others)]), True


def _sizes(tables: Tables, eye: Array) -> Array:
    """Return about how large each mirror and glass (primitives,) looks from a place; 0 for other surfaces."""
    spheres, triangles = tables.geometry.spheres, tables.geometry.triangles
    assert spheres is not None
    away = spheres.center - eye[None]
    squared = spheres.radius * spheres.radius
    sizes, material = [jnp.pi * squared / jnp.maximum(jnp.sum(away * away, -1), squared)], spheres.material
    if triangles is not None:
        a, b, c = (triangles.corners[:, i] for i in range(3))
        normal, away = jnp.cross(b - a, c - a), (a + b + c) / 3 - eye[None]
        area, distance = (jnp.sqrt(jnp.sum(v * v, -1)) for v in (normal / 2, away))
        faced = jnp.abs(jnp.sum(normal * away, -1)) / 2
        sizes.append(safe_divide(faced + ASKANCE * area * distance, distance * (distance * distance + area)))
        material = jnp.concatenate([material, triangles.material])
    diffuse, delta, _ = tables.materials.ends
    return jnp.where((material >= diffuse) & (material < delta), jnp.concatenate(sizes), 0)


def _primitives(tables: Tables) -> int:
    triangles = tables.geometry.triangles
    return spheres_count(tables.geometry) + (0 if triangles is None else triangles.corners.shape[0])


def _cells(tables: Tables) -> int:
    """Return into how many parts the place on a mirror, either way, and that on a light's rim are divided."""
    return CELLS if _primitives(tables) <= FEW else 1


def _sample(plan: Plan, blocked: bool, operands: CausticTables, draw: Draw) -> tuple[EdgeSamples, Array]:
    """Return one sample, and what it brings. blocked: whether anything stands in the way."""
    operands = replace(operands, tables=through_lens(operands.tables, draw.stream))
    placed = once(place)(draw)
    light = once(_from_rim)(operands, draw, placed)
    if blocked:
        other = once(_past_outline)(operands, draw, placed)
        own = placed.bin < _rims(operands.tables)
        light = where(own, light, other)
    return _followed(plan, operands, draw, light)


def _rims(tables: Tables) -> int:
    """Return the number of bins that are of the lights' own rims."""
    assert tables.lights is not None
    count: int = tables.lights.lights.position.shape[0]
    return count * _primitives(tables) * _cells(tables) ** 3


def _from_rim(operands: CausticTables, draw: Draw, placed: Placed) -> Grazing:
    """Return light that comes to a mirror or glass from its own ball's rim."""
    tables = operands.tables
    assert tables.lights is not None
    lights, cells = tables.lights.lights, _cells(tables)
    assert lights.radius is not None
    rest, cell = jnp.divmod(jnp.minimum(placed.bin, _rims(tables) - 1), cells**3)
    light, target = jnp.divmod(rest, _primitives(tables))
    t, *u = (((cell // cells**k % cells).astype(x.dtype) + x) / cells for k, x in enumerate((placed.t, *draw.spread)))
    center, radius, row = lights.position[light], lights.radius[light], tables.first_light + light
    place, normal, pdf = _place_on(tables.geometry, target, center, (u[0], u[1]))
    rim = rim_at(Silhouettes(tables.geometry.spheres, None), row, t, place, False)
    direction = normalize(place - rim.point)
    # Radiance of the rays that clear the rim by a unit, at all places
    area = safe_divide(jnp.abs(dot(normal, direction)), pdf * (placed.density * cells**3 * draw.total))
    spread = safe_divide(rim.jacobian * area, jnp.pi * radius * radius * rim.distance * rim.distance)
    rounding = 32 * unit_roundoff(center) * (jnp.sum(jnp.abs(center)) + radius)
    ray = Ray(rim.point + rounding * rim.normal, direction)
    flux = jnp.where(rim.valid, lights.intensity[light] * spread, 0)
    carrier = Carrier(ray, ray, rim.distance * (1 - BEYOND), flux, jnp.zeros_like(flux))
    # Outside there is no light
    carrier = setting_out(carrier, operands.around, light)
    return Grazing(carrier, row, t, rim, jnp.zeros_like(flux), -jnp.ones_like(radius))


def _place_on(geometry: Geometry, index: Array, eye: Array, u: tuple[Array, Array]) -> tuple[Array, Array, Array]:
    """Return a place on a primitive, its normal, and the density per area.

    On a sphere most are evenly spread as an eye sees them, the others all over it: what is near sees more.
    """
    spheres, triangles, n = geometry.spheres, geometry.triangles, spheres_count(geometry)
    assert spheres is not None
    center, radius = spheres.center[jnp.minimum(index, n - 1)], spheres.radius[jnp.minimum(index, n - 1)]
    seen, first, second = u[0] < SEEN, u[0] / SEEN, (u[0] - SEEN) / (1 - SEEN)
    away = center - eye
    s2 = safe_divide(radius * radius, dot(away, away))
    outside = s2 < 1
    cone = jnp.where(outside, cone_of_sphere(s2), 2)
    axis = jnp.where(dot(away, away) > 0, normalize(away), jnp.zeros_like(away).at[2].set(1))
    toward = sample_cone(axis, cone, (jnp.where(seen, first, 0), u[1]))
    there = surface_point(geometry, Ray(eye, toward), Hit(jnp.minimum(index, n - 1), jnp.ones((), bool)))
    anywhere = sample_uniform_sphere((jnp.where(seen, 0, jnp.minimum(second, 1)), u[1]))
    normal = jnp.where(seen, there.normal, anywhere)
    place = jnp.where(seen, there.position, center + radius * anywhere)
    line = place - eye
    squared = dot(line, line)
    cosine = safe_divide(dot(line, normal), safe_sqrt(squared))
    shows = ~outside | (cosine < 0)
    pdf = jnp.where(shows, SEEN * pdf_cone(cone) * safe_divide(jnp.abs(cosine), squared), 0)
    pdf = pdf + safe_divide((1 - SEEN) / (4 * jnp.pi) * jnp.ones_like(radius), radius * radius)
    if triangles is None:
        return place, normal, pdf
    a, b, c = triangles.corners[jnp.maximum(index - n, 0)]
    across, side = jnp.sqrt(u[0]), cross(b - a, c - a)
    flat = a + across * ((1 - u[1]) * (b - a) + u[1] * (c - a))
    twice = safe_sqrt(dot(side, side))
    flatly = safe_divide(2 * jnp.ones_like(twice), twice)
    ball = index < n
    return (
        jnp.where(ball, place, flat),
        jnp.where(ball, normal, normalize(side)),
        jnp.where(ball, pdf, flatly),
    )


def _past_outline(operands: CausticTables, draw: Draw, placed: Placed) -> Grazing:
    """Return light that passes an outline on its way to a mirror."""
    tables, outlines = operands.tables, operands.outlines
    assert tables.lights is not None
    bins = bins_for(outlines.rows)
    chosen = jnp.maximum(placed.bin - _rims(tables), 0)
    light, rest = chosen // (outlines.rows * bins), chosen % (outlines.rows * bins)
    row = rest // bins
    t = ((rest % bins).astype(placed.t.dtype) + placed.t) / bins
    source = light_point(tables.lights, outlines, light, row, t, draw.spread)
    rim = rim_at(outlines, row, t, source.position, False)
    carrier = carrier_past(source, rim, placed.density * bins * draw.total)
    carrier = setting_out(carrier, operands.around, light)
    skimming = _skimming(operands, row, rim, carrier.ray.direction)
    return Grazing(carrier, row, t, rim, skimming, jnp.ones_like(t))


def _skimming(operands: CausticTables, row: Array, rim: Rim, direction: Array) -> Array:
    """Return the share (3,) of the light that goes straight on just inside of an outline, skimming a ball."""
    spheres = operands.outlines.spheres
    assert spheres is not None
    n = operands.outlines.spheres_count
    zero = jnp.zeros_like(rim.distance)
    material = spheres.material[jnp.minimum(row, n - 1)]
    point = SurfacePoint(rim.point, rim.normal, zero, material, chart=sphere_chart(spheres, rim.normal))
    scattering = scatter(operands.tables.materials, point, -direction, (zero, zero))
    return jnp.where(scattering.specular & (row < n), scattering.weight, 0)


def _followed(plan: Plan, operands: CausticTables, draw: Draw, light: Grazing) -> tuple[EdgeSamples, Array]:
    """Return what light brings to the picture by mirrors and glass, and the constants of its clearance."""
    tables, rim = operands.tables, light.rim
    vertices = vertices_along(partial(vertex, True), tables, draw.stream, light.carrier, plan.max_depth)
    skimming = jnp.where((jnp.arange(plan.max_depth) < plan.max_depth - 1)[:, None], light.skimming[None], 0)
    vertices = replace(vertices, weight=vertices.weight * (1 - skimming))
    measure = jnp.sum(vertices.weight)
    anchors = occluder_anchors(operands.outlines, plan.geometry_moves, light.row, light.t, rim)
    if not plan.geometry_moves:
        places = beside(vertices.view.image, plan.filter)
        return EdgeSamples(vertices.pixel, light.sign * vertices.weight, None, None, (anchors,), place=places), measure
    choice = independent(draw.stream, 0)[0].astype(light.t.dtype)
    shown, number = one_of(vertices, choice)
    away = rim.point - vertices.point.position[0]
    change = Ray(rim.normal, safe_sqrt(dot(away, away)) * rim.normal)
    path = path_from(tables, draw.stream, vertices, shown, number, change, rim.point)
    weight, seen = light.sign * shown.weight[None], beside(shown.view.image[None], plan.filter)
    samples = EdgeSamples(shown.pixel[None], weight, None, None, (anchors,), path=path, place=seen)
    return samples, measure
