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
from jaxrt.kernels.few import any_lane
from jaxrt.kernels.native import once
from jaxrt.transport.path import Tables

PIECES = 4  # of a line where chains are looked at; one where the camera's rays alone are
LEVELS = 3  # intervals, each half of the one before, that are looked at in the middle
HALVINGS = 14  # of a piece, until both ends see what lies on either side of one edge


@pytree
class Chosen:
    """A piece of a line whose ends differ, chosen among all such by its worth."""

    piece: Array  # () int32
    worth: Array  # (); 0 where none is chosen
    total: Array  # () worth of all


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


def choose(plan: Plan, tables: Tables, line: Line, numbers: Numbers, coin: Array) -> Chosen:
    """Return a piece of a line. numbers: of what is looked at. coin: () in [0, 1)."""
    count = _pieces(plan, tables)

    def step(i: Array, state: tuple[Look, Lamp | None, Chosen, Array]) -> tuple[Look, Lamp | None, Chosen, Array]:
        last, lamp, chosen, coin = state
        look, lamp = _look(plan, tables, line, i.astype(coin.dtype) / count, numbers, lamp, i == 0)
        worth = jnp.where(i > 0, once(partial(interest, plan))(tables, line, (last, look)), 0)
        taken, coin, total = one_of_both(coin, worth, chosen.total)
        piece, worth = where(taken, (i - 1, worth), (chosen.piece, chosen.worth))
        return look, lamp, Chosen(piece, worth, total), coin

    look, lamp = _blank(plan, tables, line, numbers)
    nothing = jnp.zeros_like(coin)
    start = look, lamp, Chosen(jnp.int32(0), nothing, nothing), coin
    return lax.fori_loop(0, count + 1, step, start)[2]


def search_along(
    plan: Plan, tables: Tables, line: Line, numbers: Numbers, coins: tuple[Array, Array], chosen: Chosen
) -> Search:
    """Return two places of a line that differ and are close, within a piece: if none is chosen, in what hides in one.

    numbers: of what is looked at. coins: () each in [0, 1), of the search.
    """
    count, inner = _pieces(plan, tables), 3 + LEVELS
    piece = jnp.floor(coins[0] * count)
    turns = coins[0] * count - piece
    piece = jnp.where(chosen.worth > 0, chosen.piece.astype(turns.dtype), piece)
    hides = any_lane(chosen.worth <= 0)

    def step(state: tuple[Array, Search]) -> tuple[Array, Search]:
        i, search = state
        low, high = where(i < inner, search.piece, search.ends)
        at_end = jnp.where(i == 0, 0, (piece + (i - 1).astype(piece.dtype)) / count)
        place = jnp.where(i < 3, at_end, (low.place + high.place) / 2)
        look, lamp = _look(plan, tables, line, place, numbers, search.lamp, i == 0)
        found = once(partial(_found, plan, count))(tables, line, search, look, chosen, i)
        new = once(where)(i < inner, found, once(_halved)(search, look))
        return jnp.where((i == 2) & ~hides, inner, i + 1), replace(new, lamp=lamp)

    def goes_further(state: tuple[Array, Search]) -> Array:
        i, search = state
        return (i < inner) | ((i < inner + HALVINGS) & any_lane(search.worth > 0))

    look, lamp = _blank(plan, tables, line, numbers)
    one = jnp.ones_like(turns)
    start = Search(lamp, (look, look), (look, look), turns, coins[1], chosen.worth, chosen.total, one)
    # The first look is for the light's point alone
    return lax.while_loop(goes_further, step, (jnp.int32(0 if has_shadows(plan, tables) else 1), start))[1]


def _pieces(plan: Plan, tables: Tables) -> int:
    return PIECES if goes_on(plan, tables.materials) else 1


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


def _found(
    plan: Plan, count: int, tables: Tables, line: Line, search: Search, look: Look, chosen: Chosen, i: Array
) -> Search:
    """Return the search with the interval that this look ends, or has in its middle, taken or left."""
    first, last = search.piece
    inside, left = i > 2, search.turns < 0.5
    piece = where(inside, where(left, (first, look), (look, last)), (last, look))
    turns = jnp.where(inside, 2 * search.turns - jnp.where(left, 0, 1), search.turns)
    given = chosen.worth > 0
    # Where the interval's ends differ, its halves are found by halving
    hidden = inside & ~given & ~differs(first, last)
    times = jnp.where(hidden, count * 2.0 ** (i - 2).astype(turns.dtype), 0)
    worth = once(partial(interest, plan))(tables, line, piece)
    taken, coins, total = one_of_both(search.coins, times * worth, search.total)
    ends = where(taken | (given & (i == 2)), piece, search.ends)
    return Search(search.lamp, piece, ends, turns, coins, jnp.where(taken, worth, search.worth), total, search.odds)


def _halved(search: Search, look: Look) -> Search:
    """Return the search with the half that differs: of two such one by chance."""
    first, last = search.ends
    changes = differs(first, look), differs(look, last)
    tossed, heads = changes[0] & changes[1], search.coins < 0.5
    left = jnp.where(tossed, heads, changes[0])
    coins = jnp.where(tossed, 2 * search.coins - jnp.where(heads, 0, 1), search.coins)
    ends = where(left, first, look), where(left, look, last)
    return replace(search, ends=ends, coins=coins, odds=jnp.where(tossed, 2, 1) * search.odds)
