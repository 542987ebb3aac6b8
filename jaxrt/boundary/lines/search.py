"""Search a line through the picture for one place where something ends, near enough that all else lies beside it.

The line is cut into pieces, and of those whose ends differ one is halved, and the half whose ends differ again. What
begins and ends within a piece, or within a half on the way, differs in its middle alone: some such intervals, each half
of the one before, are looked at there too. Each edge is so found in just one way: from the largest interval around it
below which no other hides it. A way that is tried one time in k counts k times.
"""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxrt.boundary.guiding import one_of_both
from jaxrt.boundary.lines.chains import Lamp, end_of, lamp_for
from jaxrt.boundary.lines.looks import (
    Line,
    Look,
    differs,
    goes_on,
    has_shadows,
    interest,
    is_lit,
    look_at,
    numbers_of,
)
from jaxrt.boundary.shadows import Plan
from jaxrt.boundary.trail import LENS
from jaxrt.core.pytree import pytree, where
from jaxrt.core.samplers import Stream
from jaxrt.kernels.native import once
from jaxrt.transport.path import Tables

STEPS = 8  # parts of a line where chains are looked at; one where the camera's rays alone are
LEVELS = 2  # intervals, each half of the one before, that are looked at in the middle
INNER = 2 + LEVELS  # looks at such an interval's ends, and at the middles
HALVINGS = 13  # of a part, until both ends see what lies on either side of one edge
WITHIN = LENS + 1  # block of a sample's random numbers that choose these intervals


@pytree
class Search:
    """A search for two neighbouring places that differ."""

    lamp: Lamp | None
    piece: tuple[Look, Look]  # that was looked at last
    ends: tuple[Look, Look]  # of the piece that is taken so far
    turns: Array  # () number in [0, 1) by which halves are chosen
    coins: Array  # () number in [0, 1) that further choices are made by
    worth: Array  # () of the piece that is taken, looked at
    total: Array  # () of all pieces so far, each as often as it counts
    odds: Array  # () one over the probability of choices within the piece


def search_along(plan: Plan, tables: Tables, line: Line, stream: Stream) -> Search:
    """Return two places of a line that differ and are close: of several such pairs one by chance."""
    of_chain = numbers_of(stream, line.start.dtype)
    numbers, (turns, *_) = of_chain(0), of_chain(WITHIN)
    coins = numbers[0]
    parts = STEPS if goes_on(plan, tables.materials) else 1
    part = jnp.floor(turns * parts)
    # Looks at the ends of one part, at the middles within, at the ends of all parts; then halvings
    scanned = INNER + parts + 1

    def step(i: Array, search: Search) -> Search:
        number = i.astype(coins.dtype)
        at_end = jnp.where(i < 2, part + number, number - INNER) / parts
        within = where(i < INNER, search.piece, search.ends)
        middle = (within[0].place + within[1].place) / 2
        place = jnp.where((i < 2) | ((i >= INNER) & (i < scanned)), at_end, middle)
        look = look_at(plan, tables, line, place, of_chain)
        lamp = search.lamp
        if lamp is not None:
            end = end_of(tables, look.chain)[0].position
            lamp = where(i == 0, once(lamp_for)(tables, end, numbers), lamp)
            look = replace(look, lit=is_lit(plan, tables, look.chain, lamp))
        found = once(partial(_found, plan, parts))(tables, line, search, look, i)
        new = once(where)(i < scanned, found, once(_halved)(search, look))
        return replace(new, lamp=lamp)

    def blank() -> Search:
        look = look_at(plan, tables, line, coins, of_chain)
        lamp = lamp_for(tables, look.chain.weight, numbers) if has_shadows(plan, tables) else None
        return Search(lamp, (look, look), (look, look), coins, coins, coins, coins, coins)

    nothing = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), jax.eval_shape(blank))
    start = replace(nothing, turns=turns * parts - part, coins=coins, odds=jnp.ones_like(coins))
    return lax.fori_loop(0, scanned + HALVINGS, step, start)


def _found(plan: Plan, parts: int, tables: Tables, line: Line, search: Search, look: Look, i: Array) -> Search:
    """Return the search with the piece that ends at this look taken or left, by its worth."""
    first, last = search.piece
    inside, left = (i >= 2) & (i < INNER), search.turns < 0.5
    half = where(left, (first, look), (look, last))
    piece = where(inside, half, (last, look))
    turns = jnp.where(inside, 2 * search.turns - jnp.where(left, 0, 1), search.turns)
    # Where the interval's ends differ, its halves are found by halving
    hidden = jnp.where(differs(first, last), 0, parts * 2.0 ** (i - 1).astype(turns.dtype))
    times = jnp.where(inside, hidden, jnp.where(i > INNER, 1, 0))
    worth = once(partial(interest, plan))(tables, line, piece)
    taken, coins, total = one_of_both(search.coins, times * worth, search.total)
    ends, worth = where(taken, (piece, worth), (search.ends, search.worth))
    return Search(search.lamp, piece, ends, turns, coins, worth, total, search.odds)


def _halved(search: Search, look: Look) -> Search:
    """Return the search with the half that differs: of two such one by chance."""
    first, last = search.ends
    changes = differs(first, look), differs(look, last)
    tossed, heads = changes[0] & changes[1], search.coins < 0.5
    left = jnp.where(tossed, heads, changes[0])
    coins = jnp.where(tossed, 2 * search.coins - jnp.where(heads, 0, 1), search.coins)
    ends = where(left, first, look), where(left, look, last)
    return replace(search, ends=ends, coins=coins, odds=jnp.where(tossed, 2, 1) * search.odds)
