"""What the camera sees end that is no outline before its own eye: found on lines through the picture.

These are the curves where surfaces cross; and, over mirrors and through glass, outlines, crossings, light balls, and
the edges of shadows on the surface that a chain ends on. A line is one pixel long, parallel to one of the picture's
axes, and looked at in a few places. A line along j meets an edge as often as it is long and F changes with j: each
place where it does counts

    (f₊ − f₋) · F_θ · |F_j| / (F_x² + F_y²),

f₊ and f₋ the radiances on both sides, so that lines in both directions make up the whole, and lines that graze an edge
count little. Which places these are, and how thin what is found may be, `search.py` tells; which lines are drawn,
`promises.py` and `candidates.py`.
"""

from functools import partial

import jax
import jax.numpy as jnp
from jax import Array, lax
from jax.extend.core import jaxpr_as_fun

from jaxrt.boundary.anchors import surface_anchors
from jaxrt.boundary.clearance import EdgeSamples, LightPoints, Path, beside
from jaxrt.boundary.guiding import LANES, Draw, Guide, guide_of, place, sample_evenly
from jaxrt.boundary.lines.between import Place, place_between
from jaxrt.boundary.lines.candidates import RATIO, candidate, choices
from jaxrt.boundary.lines.chains import ENDED, Lamp, Numbers, blocker, is_light, sent_by
from jaxrt.boundary.lines.looks import WITHIN, Line, Look, goes_on, numbers_of, ray_at
from jaxrt.boundary.lines.promises import promises
from jaxrt.boundary.lines.search import Chosen, search_along
from jaxrt.boundary.shadows import Plan
from jaxrt.boundary.trail import through_lens
from jaxrt.cameras import edges_known
from jaxrt.core.maths import safe_divide, unit_roundoff
from jaxrt.core.pytree import pytree, where
from jaxrt.core.records import Ray
from jaxrt.kernels.native import once
from jaxrt.scene import Scene
from jaxrt.transport.outputs import first_met
from jaxrt.transport.path import Tables, radiance, tables_of

ASIDE = 1e-3  # pixels: as near to its border no triangle is taken to cross another, for what touches does not cross
SHARE = 8  # one of so many boundary samples is a line: each costs as much as several others
LIGHTS_ONLY = 96  # the same where lights alone move: they show, and cast shadows, in a small part of the picture
LEAST = 512  # samples of them, or all: from few candidates most pixels with an edge would have none


@pytree
class LineTables:
    """What samples of lines are drawn from."""

    tables: Tables
    faces: Array | None  # (n, 3) int32
    pixels: Guide  # to candidates
    chosen: Chosen  # (count,) intervals of these
    seed: Array


@pytree
class Edge:
    """What ends within a bracket."""

    place: Place
    change: Ray  # factors of the ray, or of the point that it leaves
    event: Array  # () int32 that the ray leaves; −1 the camera
    light: Array  # (3,) factor of the light's point
    is_shadow: Array  # () bool
    valid: Array  # () bool


def line_edges(scene: Scene, seed: Array, plan: Plan) -> tuple[EdgeSamples, ...]:
    """Return samples of what ends in the picture besides outlines: of all that moves, or of lights alone."""
    delta = goes_on(plan, scene.materials)
    shapes = sum(0 if x is None else x.material.shape[0] for x in (scene.spheres, scene.triangles))
    lights = 0 if scene.lights is None or scene.lights.radius is None else scene.lights.radius.shape[0]
    if not edges_known(scene.camera) or shapes + lights < 2 or not (plan.geometry_moves or (delta and scene.lights)):
        return ()
    tables = tables_of(scene)
    faces = scene.triangles.faces if scene.triangles is not None and plan.geometry_moves else None
    seed = seed ^ jnp.uint32(8)
    n = max(plan.part(SHARE, LIGHTS_ONLY), min(plan.n, LEAST))
    promised = promises(plan, tables, seed)

    def sampled(promised: Array) -> EdgeSamples:
        pixels = guide_of(promised)
        chosen, weights = choices(plan, tables, pixels, -(-RATIO * n // LANES) * LANES, seed)
        operands = LineTables(tables, faces, pixels, chosen, seed)
        found: EdgeSamples = sample_evenly(partial(_sample, plan), operands, weights, n, seed, plan.devices)
        return found

    # Traced once, for its shapes and for itself
    program, shapes = jax.make_jaxpr(sampled, return_shape=True)(promised)
    nothing = [jnp.zeros(x.shape, x.dtype) for x in program.out_avals]
    # Where a look at the picture finds nothing, samples would cost much more than it
    samples = lax.cond(jnp.any(promised > 0), jaxpr_as_fun(program), lambda _: nothing, promised)
    return (jax.tree.unflatten(jax.tree.structure(shapes), samples),)


# Samples of them


def _sample(plan: Plan, operands: LineTables, draw: Draw) -> EdgeSamples:
    """Return one sample."""
    camera, placed = operands.tables.camera, once(place)(draw)
    chosen = jax.tree.map(lambda x: x[placed.bin], operands.chosen)
    count = operands.chosen.worth.shape[0]
    line, stream, pixel, density = candidate(camera, operands.pixels, placed.bin, count, operands.seed)
    tables = through_lens(operands.tables, stream)
    numbers, (coin, *_) = numbers_of(stream, tables.dtype), numbers_of(draw.stream, tables.dtype)(WITHIN)
    search = search_along(plan, tables, line, numbers, coin, chosen)
    looks, lamp = jax.tree.map(lambda *x: jnp.stack(x), *search.ends), search.lamp
    edge = once(partial(_edge, plan))(tables, line, search.lamp, looks)
    # Nearer to where surfaces cross, rounding puts what is met behind the other: in its shadow. Rims are shaded as they
    # are at the very edge
    aside = jnp.where(edge.place.crossing, _aside(tables, line), 0)
    # Both use the same random numbers, so that equal surfaces cancel
    rays = jax.vmap(partial(ray_at, camera, line))(looks.place + jnp.stack([-aside, aside]))
    light = lax.map(partial(_seen, plan, tables, numbers), rays)
    jump = light[1] - light[0]
    if lamp is not None:
        sent = once(sent_by)(tables, search.ends[0].chain, lamp)
        jump = jnp.where(edge.is_shadow, jnp.where(looks.lit[1], sent, -sent), jump)
    density = density * placed.density * draw.total
    seen = edge.valid & (density > 0) & (chosen.worth > 0)
    odds = search.odds * safe_divide(chosen.total, chosen.worth)
    weight = jnp.where(seen, jump * safe_divide(odds, density), 0)
    pixel = jnp.where(seen, pixel, camera.width * camera.height)
    # How it moves
    anchors = []
    for i in range(2):
        point = edge.place.position[i], edge.place.normal[i]
        factor = jnp.where(seen, edge.place.factor[i], 0)
        anchors.append(once(surface_anchors)(tables.geometry, operands.faces, edge.place.index[i], point, factor))
    lights = LightPoints(lamp.light, lamp.omega, jnp.where(seen, edge.light, 0)) if lamp and plan.lights_move else None
    change = jax.tree.map(lambda x: jnp.where(seen, x, 0), edge.change)
    image = line.start + looks.place[0] * line.along
    turns = search.ends[0].chain.turns
    if not goes_on(plan, tables.materials):
        turns = jax.tree.map(lambda x: x[:0], turns)
    path = Path(turns, edge.event, change, image, line.along, camera.lens)
    seen_at = beside(image[None], plan.filter)
    return EdgeSamples(pixel[None], weight[None], lights, None, tuple(anchors), path=path, place=seen_at)


def _seen(plan: Plan, tables: Tables, numbers: Numbers, ray: Ray) -> Array:
    """Return the radiance (3,) along a camera's ray, or the outputs of what it meets."""
    if plan.outputs:
        return first_met(plan.outputs, tables, ray)
    return radiance(tables, ray, numbers, plan.max_depth, False)


def _aside(tables: Tables, line: Line) -> float:
    """Return how far beside a place rays are sure to meet what lies on that side, in pixels."""
    return ASIDE + 16 * unit_roundoff(line.start) * tables.camera.width


def _edge(plan: Plan, tables: Tables, line: Line, lamp: Lamp | None, looks: Look) -> Edge:
    """Return what ends between two looks (2,)."""
    chains = looks.chain
    length = chains.met.shape[1]
    # The first event at which they part, and whether glass has parted them before: that is no edge
    event, flipped = jnp.int32(length), jnp.zeros((), bool)
    for k in reversed(range(length)):
        parts, flips = chains.met[0, k] != chains.met[1, k], chains.through[0, k] != chains.through[1, k]
        event = jnp.where(parts, k, event)
        flipped = jnp.where(parts, False, flips | flipped)
    at = jnp.minimum(event, length - 1)
    rays, met = jax.tree.map(lambda x: x[:, at], (chains.turns.ray, chains.met))
    valid = (event < length) & jnp.all(met != ENDED)
    is_shadow = jnp.zeros((), bool)
    aside = _aside(tables, line)
    margin = tuple(ray_at(tables.camera, line, s) for s in (looks.place[0] - aside, looks.place[1] + aside))
    beyond = tuple(
        jax.tree.map(lambda x, y, i=i: jnp.where(event == 0, x, y[i]), ray, rays) for i, ray in enumerate(margin)
    )
    toward_lamp = jnp.ones((), tables.dtype)
    if lamp is not None:
        is_shadow = (event == length) & (looks.lit[0] != looks.lit[1])
        shadow_rays, lengths, blockers = lax.map(lambda chain: blocker(tables, chain, lamp, plan.max_depth), chains)
        rays, met = where(is_shadow, (shadow_rays, blockers), (rays, met))
        beyond = tuple(
            jax.tree.map(lambda x, y, i=i: jnp.where(is_shadow, y[i], x), ray, rays) for i, ray in enumerate(beyond)
        )
        toward_lamp = lengths[0]
    found = once(place_between)(tables.geometry, rays, met, beyond)
    share = jnp.where(is_shadow, safe_divide(found.distance, toward_lamp), 0)
    change = Ray((1 - share) * found.aside, jnp.where(is_shadow, 0, found.distance) * found.aside)
    # Outlines before the camera's own eye have samples of their own
    valid = (is_shadow | (valid & (found.crossing | (event > 0)))) & found.valid & ~flipped
    if not plan.geometry_moves:
        valid = valid & (is_shadow | jnp.any(is_light(tables, met)))
    return Edge(found, change, jnp.where(is_shadow, chains.last[0], event - 1), share * found.aside, is_shadow, valid)
