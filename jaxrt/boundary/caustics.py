"""The edges of light that mirrors and glass bring: what a surface sees of a light of some size by scattered rays.

Such a ray finds the light, or not, by chance: what it brings ends abruptly at the light's own rim, and where something
stands between the light and the last mirror. Samples start there, at the light, and must meet a mirror or glass before
the first surface that scatters; from there on all is as for shadows. What the ray's clearance depends on is the path
from the camera at fixed random numbers, as inside of edges: so it moves with all that the path turns on.
"""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxrt.boundary.clearance import EdgeSamples
from jaxrt.boundary.guiding import Draw, Placed, place, sample_guided
from jaxrt.boundary.shadows import (
    Carrier,
    Plan,
    bins_for,
    carrier_past,
    light_point,
    occluder_anchors,
    shadow_weights,
    vertex,
)
from jaxrt.boundary.silhouettes import Rim, Silhouettes, edge_table, rim_at
from jaxrt.boundary.trail import one_of, reach_of, trail_from
from jaxrt.core.maths import dot, safe_divide, safe_sqrt, unit_roundoff
from jaxrt.core.pytree import pytree
from jaxrt.core.records import Ray, SurfacePoint
from jaxrt.core.samplers import independent
from jaxrt.core.sampling import frame, sample_uniform_sphere, sincos_2pi
from jaxrt.kernels.native import once
from jaxrt.materials import scatter
from jaxrt.scene import Scene
from jaxrt.transport.path import Tables, tables_of

CELLS = 16, 32  # of directions, among which a pilot shares the samples of each light: by height, about the axis


@pytree
class CausticTables:
    """What the samples are drawn from."""

    tables: Tables
    outlines: Silhouettes


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

    None where no surface can show such light, nor for a camera that is not at one place.
    """
    lights, materials = scene.lights, scene.materials
    if not scene.camera.is_central or lights is None or not lights.have_size:
        return ()
    if plan.max_depth == 1 or not (materials.are_delta and materials.are_lit):
        return ()
    tables = tables_of(scene)
    edges = edge_table(scene.triangles) if scene.triangles is not None and plan.geometry_moves else None
    outlines = Silhouettes(tables.geometry.spheres, edges)
    weights, blocked = _weights(tables, outlines, plan)
    operands = CausticTables(tables, outlines)
    sample = partial(_sample, plan, blocked)
    return (sample_guided(sample, operands, weights, plan.n, seed ^ jnp.uint32(4), plan.devices),)


def _weights(tables: Tables, outlines: Silhouettes, plan: Plan) -> tuple[Array, bool]:
    """Return weights of all bins, those of the lights' own rims first, and whether those of other outlines follow."""
    assert tables.lights is not None
    lights = tables.lights.lights
    n, radii = lights.position.shape[0], lights.radius
    assert radii is not None
    rims = jnp.repeat(jnp.where(radii > 0, jnp.sum(lights.intensity, -1), 0), CELLS[0] * CELLS[1])
    if outlines.rows == n or not (plan.geometry_moves or n > 1):
        return rims, False
    others = shadow_weights(tables, outlines, bins_for(outlines.rows)).reshape(
        -1, outlines.rows, bins_for(outlines.rows)
    )
    moves = plan.geometry_moves | (jnp.arange(outlines.rows) >= tables.first_light)
    others = jnp.where((radii > 0)[:, None, None] & moves[None, :, None], others[:n], 0).ravel()
    return jnp.concatenate([safe_divide(x, jnp.full_like(x, jnp.sum(x))) for x in (rims, others)]), True


def _sample(plan: Plan, blocked: bool, operands: CausticTables, draw: Draw) -> tuple[EdgeSamples, Array]:
    """Return one sample, and what it brings. blocked: whether anything stands in the way."""
    placed = once(place)(draw)
    light = once(_from_rim)(operands, draw, placed)
    if blocked:
        other = once(_past_outline)(operands, draw, placed)
        own = placed.bin < _rims(operands.tables)
        light = jax.tree.map(lambda a, b: jnp.where(own, a, b), light, other)
    return _followed(plan, operands, draw, light)


def _rims(tables: Tables) -> int:
    """Return the number of bins that are of the lights' own rims."""
    assert tables.lights is not None
    count: int = tables.lights.lights.position.shape[0]
    return count * CELLS[0] * CELLS[1]


def _from_rim(operands: CausticTables, draw: Draw, placed: Placed) -> Grazing:
    """Return light that touches its own ball.

    A ray of any direction touches a sphere anywhere on a circle: all these rays carry alike of its radiance.
    """
    tables = operands.tables
    assert tables.lights is not None
    lights = tables.lights.lights
    assert lights.radius is not None
    rows, columns = CELLS
    chosen = jnp.minimum(placed.bin, _rims(tables) - 1)
    light, cell = chosen // (rows * columns), chosen % (rows * columns)
    turn = ((cell % columns).astype(placed.t.dtype) + draw.spread[0]) / columns
    height = ((cell // columns).astype(placed.t.dtype) + placed.t) / rows
    direction = sample_uniform_sphere((turn, height))
    center, radius = lights.position[light], lights.radius[light]
    rim, start = _touched(center, radius, direction, draw.spread[1])
    density = placed.density * (rows * columns) * draw.total
    # Radiance times all directions times all of the circle
    flux = lights.intensity[light] * safe_divide(8 * jnp.pi * jnp.ones_like(radius), radius * density)
    ray = Ray(start, direction)
    carrier = Carrier(ray, ray, jnp.zeros_like(radius), flux)
    # Outside there is no light
    return Grazing(carrier, tables.first_light + light, placed.t, rim, jnp.zeros_like(flux), -jnp.ones_like(radius))


def _touched(center: Array, radius: Array, direction: Array, turn: Array) -> tuple[Rim, Array]:
    """Return the point of a sphere that a ray of a direction touches, and that point moved off by its rounding."""
    side, up = frame(direction)
    cos, sin = sincos_2pi(turn)
    normal = cos * side + sin * up
    point = center + radius * normal
    rounding = 32 * unit_roundoff(center) * (jnp.sum(jnp.abs(center)) + radius)
    rim = Rim(point, normal, 2 * jnp.pi * radius, jnp.zeros_like(radius), radius > 0)
    return rim, point + rounding * normal


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
    skimming = _skimming(operands, row, rim, carrier.ray.direction)
    return Grazing(carrier, row, t, rim, skimming, jnp.ones_like(t))


def _skimming(operands: CausticTables, row: Array, rim: Rim, direction: Array) -> Array:
    """Return the share (3,) of the light that goes straight on just inside of an outline, skimming a ball."""
    spheres = operands.outlines.spheres
    assert spheres is not None
    n = operands.outlines.spheres_count
    zero = jnp.zeros_like(rim.distance)
    point = SurfacePoint(rim.point, rim.normal, zero, spheres.material[jnp.minimum(row, n - 1)])
    scattering = scatter(operands.tables.materials, point, -direction, (zero, zero))
    return jnp.where(scattering.specular & (row < n), scattering.weight, 0)


def _followed(plan: Plan, operands: CausticTables, draw: Draw, light: Grazing) -> tuple[EdgeSamples, Array]:
    """Return what light brings to the picture by mirrors and glass, and the constants of its clearance."""
    tables, rim = operands.tables, light.rim
    events = jnp.arange(plan.max_depth, dtype=jnp.int32)
    _, vertices = lax.scan(partial(vertex, tables, draw, True), light.carrier, events)
    skimming = jnp.where((events < plan.max_depth - 1)[:, None], light.skimming[None], 0)
    vertices = replace(vertices, weight=vertices.weight * (1 - skimming))
    measure = jnp.sum(vertices.weight)
    anchors = occluder_anchors(operands.outlines, plan.geometry_moves, light.row, light.t, rim)
    if not plan.geometry_moves:
        return EdgeSamples(vertices.pixel, light.sign * vertices.weight, None, None, (anchors,)), measure
    choice = independent(draw.stream, 0)[0].astype(light.t.dtype)
    shown, number = one_of(vertices, choice)
    away = rim.point - vertices.point.position[0]
    change = Ray(rim.normal, safe_sqrt(dot(away, away)) * rim.normal)
    view, trail = trail_from(tables, vertices, shown, number, change, rim.point)
    samples = EdgeSamples(shown.pixel[None], light.sign * shown.weight[None], None, view, (anchors,), trail)
    return samples, measure * (1 + reach_of(trail))
