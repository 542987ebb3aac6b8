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

from jaxrt.boundary.clearance import EdgeSamples
from jaxrt.boundary.guiding import Draw, place, sample_guided
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
    outlines: Silhouettes  # what stands in the way


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
    spheres = tables.geometry.spheres
    assert lights.radius is not None
    powers = jnp.where(lights.radius > 0, jnp.sum(lights.intensity, -1), 0)
    own = CausticTables(tables, Silhouettes(spheres, None))
    cells = CELLS[0] * CELLS[1]
    seed = seed ^ jnp.uint32(4)
    rims = sample_guided(partial(_rim, plan), own, jnp.repeat(powers, cells), plan.n, seed, plan.devices)
    return rims, *_shaded(scene, tables, seed ^ jnp.uint32(12), plan)


def _shaded(scene: Scene, tables: Tables, seed: Array, plan: Plan) -> tuple[EdgeSamples, ...]:
    """Return samples of what stands between lights and mirrors."""
    lights = scene.lights
    assert lights is not None and lights.radius is not None and tables.lights is not None
    crowd = lights.count > 1
    edges = edge_table(scene.triangles) if scene.triangles is not None and plan.geometry_moves else None
    # A scene's only light cannot block itself
    outlines = Silhouettes(tables.occluders.spheres, edges)
    if outlines.rows == 0 or not (plan.geometry_moves or crowd):
        return ()
    bins = bins_for(outlines.rows)
    weights = shadow_weights(tables, outlines, bins).reshape(-1, outlines.rows, bins)
    moves = jnp.ones(outlines.rows, bool) if plan.geometry_moves else jnp.arange(outlines.rows) >= tables.first_light
    sized = jnp.arange(weights.shape[0]) < lights.radius.shape[0]
    sized = sized & (jnp.pad(lights.radius, (0, weights.shape[0] - lights.radius.shape[0])) > 0)
    weights = jnp.where(sized[:, None, None] & moves[None, :, None], weights, 0).ravel()
    operands = CausticTables(tables, outlines)
    return (sample_guided(partial(_past, plan, bins), operands, weights, plan.n, seed, plan.devices),)


def _rim(plan: Plan, operands: CausticTables, draw: Draw) -> tuple[EdgeSamples, Array]:
    """Return one sample of the light's own rim, and what it brings.

    A ray of any direction touches a sphere anywhere on a circle: all these rays carry alike of its radiance.
    """
    tables = operands.tables
    assert tables.lights is not None
    lights = tables.lights.lights
    assert lights.radius is not None
    rows, columns = CELLS
    placed = once(place)(draw)
    light, cell = placed.bin // (rows * columns), placed.bin % (rows * columns)
    turn = ((cell % columns).astype(placed.t.dtype) + draw.spread[0]) / columns
    height = ((cell // columns).astype(placed.t.dtype) + placed.t) / rows
    direction = sample_uniform_sphere((turn, height))
    center, radius = lights.position[light], lights.radius[light]
    rim, start = once(_touched)(center, radius, direction, draw.spread[1])
    density = placed.density * (rows * columns) * draw.total
    # Radiance times all directions times all of the circle
    flux = lights.intensity[light] * safe_divide(8 * jnp.pi * jnp.ones_like(radius), radius * density)
    ray = Ray(start, direction)
    carrier = Carrier(ray, ray, jnp.zeros_like(radius), jnp.where(density > 0, flux, 0))
    row = tables.first_light + light
    nothing = jnp.zeros_like(flux)
    # Outside there is no light
    return _follow(plan, operands, draw, carrier, (row, placed.t, rim), nothing, -1)


def _touched(center: Array, radius: Array, direction: Array, turn: Array) -> tuple[Rim, Array]:
    """Return the point of a sphere that a ray of a direction touches, and that point moved off by its rounding."""
    side, up = frame(direction)
    cos, sin = sincos_2pi(turn)
    normal = cos * side + sin * up
    point = center + radius * normal
    rounding = 32 * unit_roundoff(center) * (jnp.sum(jnp.abs(center)) + radius)
    rim = Rim(point, normal, 2 * jnp.pi * radius, jnp.zeros_like(radius), radius > 0)
    return rim, point + rounding * normal


def _past(plan: Plan, bins: int, operands: CausticTables, draw: Draw) -> tuple[EdgeSamples, Array]:
    """Return one sample of what stands between a light and a mirror, and what it brings."""
    tables, outlines = operands.tables, operands.outlines
    assert tables.lights is not None
    placed = once(place)(draw)
    light, rest = placed.bin // (outlines.rows * bins), placed.bin % (outlines.rows * bins)
    row = rest // bins
    t = ((rest % bins).astype(placed.t.dtype) + placed.t) / bins
    source = once(light_point)(tables.lights, outlines, light, row, t, draw.spread)
    rim = once(partial(rim_at, creases=False))(outlines, row, t, source.position)
    carrier = once(carrier_past)(source, rim, placed.density * bins * draw.total)
    skimming = once(_skimming)(operands, row, rim, carrier.ray.direction)
    return _follow(plan, operands, draw, carrier, (row, t, rim), skimming, 1)


def _skimming(operands: CausticTables, row: Array, rim: Rim, direction: Array) -> Array:
    """Return the share (3,) of the light that goes straight on just inside of an outline, skimming a ball."""
    spheres = operands.outlines.spheres
    if spheres is None:
        return jnp.zeros_like(direction)
    n = operands.outlines.spheres_count
    material = spheres.material[jnp.minimum(row, n - 1)]
    point = SurfacePoint(rim.point, rim.normal, jnp.zeros_like(rim.distance), material)
    zero = jnp.zeros_like(rim.distance)
    scattering = scatter(operands.tables.materials, point, -direction, (zero, zero))
    return jnp.where(scattering.specular & (row < n), scattering.weight, 0)


def _follow(
    plan: Plan,
    operands: CausticTables,
    draw: Draw,
    carrier: Carrier,
    outline: tuple[Array, Array, Rim],
    skimming: Array,
    sign: int,
) -> tuple[EdgeSamples, Array]:
    """Return the weights and the clearance of light that sets out past an outline, and what it brings.

    outline: row, place t and point. skimming: (3,) share that goes the same way on the outline's inside, with one event
    more. sign: 1 where light passes outside of the outline, −1 where it does inside.
    """
    row, t, rim = outline
    tables = operands.tables
    _, vertices = lax.scan(partial(vertex, tables, draw, True), carrier, jnp.arange(plan.max_depth, dtype=jnp.int32))
    both = jnp.arange(plan.max_depth)[:, None] < plan.max_depth - 1
    lost = 1 - jnp.where(both, skimming[None], 0)
    weight = vertices.weight * lost
    measure = jnp.sum(weight)
    anchors = occluder_anchors(operands.outlines, plan.geometry_moves, row, t, rim)
    if not plan.geometry_moves:
        return EdgeSamples(vertices.pixel, sign * weight, None, None, (anchors,)), measure
    choice = independent(draw.stream, 0)[0].astype(t.dtype)
    shown, number = one_of(replace(vertices, weight=weight), choice)
    away = rim.point - vertices.point.position[0]
    change = Ray(rim.normal, safe_sqrt(dot(away, away)) * rim.normal)
    view, trail = trail_from(tables, vertices, shown, number, change, rim.point)
    samples = EdgeSamples(shown.pixel[None], sign * shown.weight[None], None, view, (anchors,), trail)
    return samples, measure * (1 + reach_of(trail))
