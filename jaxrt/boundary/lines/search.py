"""Search a line through the picture for one place where something ends, near enough that all else lies beside it.

The line is cut into pieces. One whose ends differ is halved, and the half whose ends differ again. What begins and ends
within a piece whose ends are alike differs in its middle alone: by chance one piece is taken, one half of it and one of
that, and each is looked at in its middle. Each edge is so found in just one way: from the largest interval around it
below which no other hides it. A way that is tried one time in k counts k times.
"""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxrt.boundary.guiding import one_of_both
from jaxrt.boundary.lines.chains import Lamp, Numbers, end_of, lamp_for
from jaxrt.boundary.lines.looks import Line, Look, differs, goes_on, has_shadows, interest, is_lit, look_at
from jaxrt.boundary.shadows import Plan
from jaxrt.core.pytree import pytree, where
from jaxrt.kernels.native import once
from jaxrt.transport.path import Tables

PIECES = 4  # of a line where chains are looked at; one where the camera's rays alone are
LEVELS = 5  # intervals, each half of the one before, that are looked at in the middle
HALVINGS = 14  # of an interval, until both ends see what lies on either side of one edge


@pytree
class Chosen:
    """An interval of a line whose ends differ, chosen among all such by its worth."""

    ends: Array  # (2,) places
    first: Array  # () place that was looked at first: a light's point is chosen for it
    worth: Array  # () of what its ends tell; 0 where none is chosen
    total: Array  # () of all, each as often as it counts


@pytree
class Scan:
    """A look for such intervals."""

    lamp: Lamp | None
    interval: tuple[Look, Look]  # that was looked at last
    turns: Array  # () number in [0, 1) by which halves are chosen
    coins: Array  # () number in [0, 1) by which one of the intervals is
    chosen: Chosen


@pytree
class Search:
    """A search for two neighbouring places that differ."""

    lamp: Lamp | None
    ends: tuple[Look, Look]
    coins: Array  # () number in [0, 1) that further choices are made by
    odds: Array  # () one over the probability of these choices


def choose(plan: Plan, tables: Tables, line: Line, numbers: Numbers, coins: tuple[Array, Array]) -> Chosen:
    """Return an interval of a line. numbers: of what is looked at. coins: () each in [0, 1)."""
    count = PIECES if goes_on(plan, tables.materials) else 1
    piece = jnp.floor(coins[0] * count)
    # Looks at the ends of all pieces, first at those of one by chance and at the middles within
    inner = 2 + LEVELS

    def step(i: Array, scan: Scan) -> Scan:
        number = i.astype(piece.dtype)
        low, high = scan.interval
        at_end = jnp.where(i < 2, piece + number, number - inner) / count
        place = jnp.where((i < 2) | (i >= inner), at_end, (low.place + high.place) / 2)
        look, lamp = _look(plan, tables, line, place, numbers, scan.lamp, i == 0)
        return replace(once(partial(_taken, plan, count))(tables, line, scan, look, i), lamp=lamp)

    look, lamp = _blank(plan, tables, line, numbers)
    nothing = jnp.zeros_like(piece)
    chosen = Chosen(jnp.zeros_like(line.start), piece / count, nothing, nothing)
    start = Scan(lamp, (look, look), coins[0] * count - piece, coins[1], chosen)
    return lax.fori_loop(0, inner + count + 1, step, start).chosen


def _taken(plan: Plan, count: int, tables: Tables, line: Line, scan: Scan, look: Look, i: Array) -> Scan:
    """Return the scan with the interval at one end of which this look is, the last one or half of it, taken or left."""
    first, last = scan.interval
    inside, (left, turns) = (i >= 2) & (i < 2 + LEVELS), _tossed(scan.turns)
    interval = where(inside, where(left, (first, look), (look, last)), (last, look))
    turns = jnp.where(inside, turns, scan.turns)
    # Where an interval's ends differ, its halves are found by halving
    hidden = jnp.where(differs(first, last), 0, count * 2.0 ** (i - 1).astype(turns.dtype))
    times = jnp.where(inside, hidden, jnp.where(i > 2 + LEVELS, 1, 0))
    worth = once(partial(interest, plan))(tables, line, interval)
    taken, coins, total = one_of_both(scan.coins, times * worth, scan.chosen.total)
    ends = jnp.stack([interval[0].place, interval[1].place])
    ends, worth = where(taken, (ends, worth), (scan.chosen.ends, scan.chosen.worth))
    return Scan(scan.lamp, interval, turns, coins, Chosen(ends, scan.chosen.first, worth, total))


def search_along(plan: Plan, tables: Tables, line: Line, numbers: Numbers, coin: Array, chosen: Chosen) -> Search:
    """Return two places of a chosen interval that differ and are close: of several such pairs one by chance.

    numbers: of what is looked at. coin: () in [0, 1), of the search.
    """

    def step(i: Array, search: Search) -> Search:
        low, high = search.ends
        at_end = jnp.where(i == 1, chosen.ends[0], chosen.ends[1])
        place = jnp.where(i == 0, chosen.first, jnp.where(i < 3, at_end, (low.place + high.place) / 2))
        look, lamp = _look(plan, tables, line, place, numbers, search.lamp, i == 0)
        ends = replace(search, ends=(search.ends[1], look))
        return replace(once(where)(i < 3, ends, once(_halved)(search, look)), lamp=lamp)

    look, lamp = _blank(plan, tables, line, numbers)
    start = Search(lamp, (look, look), coin, jnp.ones_like(coin))
    # The first look is for the light's point alone
    return lax.fori_loop(0 if has_shadows(plan, tables) else 1, 3 + HALVINGS, step, start)


def _blank(plan: Plan, tables: Tables, line: Line, numbers: Numbers) -> tuple[Look, Lamp | None]:
    """Return a look of zeros and, if there are shadows, a light's point."""

    def blank() -> tuple[Look, Lamp | None]:
        look = look_at(plan, tables, line, line.start[0], numbers)
        return look, lamp_for(tables, look.chain.weight, numbers(0)) if has_shadows(plan, tables) else None

    nothing: tuple[Look, Lamp | None] = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), jax.eval_shape(blank))
    return nothing


def _look(
    plan: Plan, tables: Tables, line: Line, place: Array, numbers: Numbers, lamp: Lamp | None, first: Array
) -> tuple[Look, Lamp | None]:
    """Return what is seen at a place of a line, and the light's point that lights it: chosen where it looks first."""
    look = look_at(plan, tables, line, place, numbers)
    if lamp is None:
        return look, None
    end = end_of(tables, look.chain)[0].position
    lamp = where(first, once(lamp_for)(tables, end, numbers(0)), lamp)
    return replace(look, lit=is_lit(plan, tables, look.chain, lamp)), lamp


def _halved(search: Search, look: Look) -> Search:
    """Return the search with the half that differs: of two such one by chance."""
    first, last = search.ends
    changes = differs(first, look), differs(look, last)
    tossed, (heads, coins) = changes[0] & changes[1], _tossed(search.coins)
    left = jnp.where(tossed, heads, changes[0])
    coins = jnp.where(tossed, coins, search.coins)
    ends = where(left, first, look), where(left, look, last)
    return replace(search, ends=ends, coins=coins, odds=jnp.where(tossed, 2, 1) * search.odds)


def _tossed(coin: Array) -> tuple[Array, Array]:
    """Return one choice of two, equally likely, by a number in [0, 1), and a number for the next."""
    heads = coin < 0.5
    return heads, 2 * coin - jnp.where(heads, 0, 1)
