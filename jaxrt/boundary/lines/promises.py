"""In which pixels lines are likely to meet an edge: those whose corners see different things.

The picture's corners are looked at in tiles, all of a tile by the same numbers: neighbours that see different
surfaces, or the same in the light and in the shadow, have an edge between them. Where there is glass they are looked at
several times, for what it reflects is as bright as what it shows and is drawn seldom.
"""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxrt.boundary.guiding import of_packets
from jaxrt.boundary.lines.chains import Chain, Lamp, Numbers, is_light, lamp_middle
from jaxrt.boundary.lines.lamps import shows_lamp
from jaxrt.boundary.lines.looks import (
    FAINT,
    Look,
    brightest,
    goes_on,
    has_shadows,
    interest,
    is_lit,
    line_at,
    look_at,
    numbers_of,
)
from jaxrt.boundary.shadows import Plan
from jaxrt.boundary.trail import through_lens
from jaxrt.core.samplers import LAST, Stream
from jaxrt.kernels.native import once
from jaxrt.lights import casters_of
from jaxrt.materials import Materials
from jaxrt.transport.path import Tables

TILE = (8, 16)  # rows and columns of corners that are looked at together: neighbouring tiles share those between them
ELSEWHERE = 0.1  # share of the samples outside of where a look at the picture finds edges
SELDOM = 0.3  # weight of what glass reflects
LAMPS = 4  # whose shadows are looked for, of all


def promises(plan: Plan, tables: Tables, seed: Array) -> Array:
    """Return weights (height · width,): pixels where something seems to end and their neighbours, then all others."""
    width, height, (rows, columns) = tables.camera.width, tables.camera.height, (TILE[0] - 1, TILE[1] - 1)
    down, across = -(-height // rows), -(-width // columns)

    def one_packet(operands: tuple[Tables, Array], packet: Array) -> Array:
        tables, seed = operands
        stream = Stream(jnp.uint32(0), packet.astype(jnp.uint32), seed, jnp.uint32(down * across))
        start = jnp.stack([packet % across * columns, packet // across * rows])
        return _in_tile(plan, through_lens(tables, stream), stream, start.astype(tables.dtype))

    found: Array = of_packets(one_packet, (tables, seed), down * across, plan.devices)
    found = found.reshape(down, across, rows, columns).swapaxes(1, 2).reshape(down * rows, across * columns)
    found = found[:height, :width]
    weights = lax.reduce_window(found, jnp.zeros((), found.dtype), lax.max, (3, 3), (1, 1), "SAME").ravel()
    return weights + ELSEWHERE / (1 - ELSEWHERE) * jnp.mean(weights)


def _in_tile(plan: Plan, tables: Tables, stream: Stream, start: Array) -> Array:
    """Return what the pixels (rows, columns) of a tile promise, 0 for nothing. start: (2,) its first corner."""
    places = jnp.stack(jnp.meshgrid(*(jnp.arange(n, dtype=start.dtype) for n in reversed(TILE))), -1).reshape(-1, 2)
    corners = start[None] + places
    lamps = _lamps(tables, numbers_of(stream, start.dtype)(0)) if has_shadows(plan, tables) else None

    def compared(tables: Tables, corners: Array, looks: Look, lamps: Lamp | None) -> Array:
        if lamps is not None:
            looks = replace(looks, lit=jax.vmap(partial(_lit, plan, tables, lamps))(looks.chain))
        promised: Array = once(partial(_compared, plan))(tables, corners, looks)
        return promised

    def one(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        found, turn, _ = state
        numbers = _leading(tables.materials, numbers_of(stream, start.dtype), turn)
        looks = jax.vmap(partial(_look, plan, tables, numbers))(corners)
        chains = looks.chain
        goes = jnp.any(chains.last > 0)
        # Where all see one thing, or where lights alone move and none shows, nothing ends
        ends = jnp.any(chains.met[:, 0] != chains.met[0, 0])
        if not plan.geometry_moves:
            ends = ends & jnp.any(is_light(tables, chains.met[:, 0]))
        promised = lax.cond(goes | ends, compared, lambda *_: jnp.zeros_like(found), tables, corners, looks, lamps)
        found = jnp.maximum(found, jnp.where(turn == 0, promised, SELDOM * promised))
        return found, turn + 1, goes

    turns = 3 if goes_on(plan, tables.materials) and _may_choose(tables.materials) else 1
    nothing = jnp.zeros((TILE[0] - 1, TILE[1] - 1), start.dtype)
    state = nothing, jnp.int32(0), jnp.ones((), bool)
    # Other turns see the same where no chain goes on
    return lax.while_loop(lambda state: (state[1] < turns) & state[2], one, state)[0]


def _may_choose(materials: Materials) -> bool:
    """Return whether chains go on by chance one way or another."""
    return any(kind.transmits and kind.is_delta for kind in materials.kinds)


def _leading(materials: Materials, numbers: Numbers, turn: Array) -> Numbers:
    """Return numbers that lead through all glass, off all of it, or off its second side, by the turn; else the same."""
    if not _may_choose(materials):
        return numbers

    def leading(k: int | Array) -> tuple[Array, Array, Array, Array]:
        a, b, c, d = numbers(k)
        reflects = (turn == 1) | ((turn == 2) & (k == 2))
        return a, b, jnp.where(reflects, 0, LAST).astype(c.dtype), d

    return leading


def _lamps(tables: Tables, u: tuple[Array, Array, Array, Array]) -> Lamp:
    """Return the middles of some lights (l,), of few all, as if they were points."""
    assert tables.lights is not None
    n = min(LAMPS, casters_of(tables.lights.lights)[0].shape[0])
    return lax.map(lambda i: lamp_middle(tables, (u[0], (i + u[1]) / n, u[2], u[3])), jnp.arange(n, dtype=u[1].dtype))


def _look(plan: Plan, tables: Tables, numbers: Numbers, corner: Array) -> Look:
    """Return what is seen at a corner."""
    return look_at(plan, tables, line_at(corner, jnp.ones((), bool)), jnp.zeros_like(corner[0]), numbers)


def _lit(plan: Plan, tables: Tables, lamps: Lamp, chain: Chain) -> Array:
    """Return from which of some lamps (l,) a chain's end is lit."""
    lit: Array = lax.map(partial(is_lit, plan, tables, chain), lamps)
    return lit


def _compared(plan: Plan, tables: Tables, corners: Array, looks: Look) -> Array:
    """Return for pixels (rows, columns) what is promised where something seems to end between their corners, else 0."""
    places = jnp.arange(TILE[0] * TILE[1]).reshape(TILE)
    # Those at the tile's border are compared with themselves
    right = jnp.minimum(places + 1, places[:, -1:])
    down = jnp.minimum(places + TILE[1], places[-1:])

    def beside(order: Array) -> Look:
        """Return the looks in another order."""
        found: Look = jax.tree.map(lambda x: x[order.ravel()], looks)
        return found

    def ends(others: Look, across: Array) -> Array:
        def one(corner: Array, look: Look, other: Look) -> Array:
            pair = look, Look(jnp.ones_like(look.place), other.chain, other.lit)
            found = interest(plan, tables, line_at(corner, across), pair)
            return jnp.where(found > FAINT, found, 0)

        return jax.vmap(one)(corners, looks, others).reshape(TILE)

    both = beside(right), beside(down)
    rightward, downward = lax.map(
        lambda x: ends(*x), (jax.tree.map(lambda *x: jnp.stack(x), *both), jnp.array([True, False]))
    )
    sides = rightward[:-1, :-1], rightward[1:, :-1], downward[:-1, :-1], downward[:-1, 1:]
    found = jnp.max(jnp.stack(sides), 0)
    if goes_on(plan, tables.materials):
        three = jax.tree.map(lambda *x: jnp.stack(x, 1), looks.chain, both[0].chain, both[1].chain)
        shown = jax.vmap(partial(shows_lamp, tables))(three).reshape(TILE)[:-1, :-1]
        found = jnp.where(shown, brightest(plan), found)
    return found
