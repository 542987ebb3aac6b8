"""Which of many lights a sample looks at: chosen by power over squared distance, in two steps.

Lights that lie side by side are a group. A sample chooses a group by its power and its box, then a light of the group
by its own distance: a light tree (Conty and Kulla 2018) of two levels, as wide as it pays to look at each branch.
"""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from numpy.typing import NDArray

from jaxrt.core.maths import dot, safe_divide, safe_sqrt, unit_roundoff
from jaxrt.core.pytree import pytree
from jaxrt.kernels.gather import take

MANY = 3  # spherical lights up to which power alone chooses: docs/choices.md has what is gained from 4 on
SOFT = 0.03  # of a box's squared half diagonal is added to squared distances: a box may be empty where it is nearest
LEAST = 1e-30  # squared distance


@pytree
class Groups:
    """Many lights, by groups; no derivative."""

    place: Array  # (g m, 3) of the lights of one group after the other, the last ones repeated
    weight: Array  # (g m,) share of the power, 0 of those repeated
    light: Array  # (g m,) int32 their numbers
    slot: Array  # (n,) int32 where each light is among these
    low: Array  # (g, 3) corner of a group's box
    high: Array  # (g, 3)
    total: Array  # (g,) share of the power

    @property
    def size(self) -> int:
        """How many lights a group has."""
        return _size(self.slot.shape[0])


def neighbours(places: NDArray[np.floating]) -> NDArray[np.int32]:
    """Return the numbers of lights at places (n, 3) in an order in which each group, and half of them, lie together."""
    size = _size(len(places))

    def ordered(rows: NDArray[np.int64]) -> NDArray[np.int64]:
        if len(rows) <= size:
            return rows
        rows = rows[np.argsort(places[rows, np.argmax(np.ptp(places[rows], axis=0))], kind="stable")]
        half = -(-len(rows) // (2 * size)) * size
        return np.concatenate([ordered(rows[:half]), ordered(rows[half:])])

    return ordered(np.arange(len(places))).astype(np.int32)


def groups_of(position: Array, share: Array, order: Array) -> Groups:
    """Return the groups of lights at these places (n, 3), with these shares (n,) of the power."""
    n = order.shape[0]
    size = _size(n)
    spare = -n % size
    light = jnp.concatenate([order, jnp.broadcast_to(order[-1:], (spare,))])
    place = lax.stop_gradient(position)[light]
    weight = jnp.where(jnp.arange(n + spare) < n, lax.stop_gradient(share)[light], 0)
    inside = place.reshape(-1, size, 3)
    slot = jnp.zeros(n, jnp.int32).at[order].set(jnp.arange(n, dtype=jnp.int32))
    total = jnp.sum(weight.reshape(-1, size), 1)
    return Groups(place, weight, light, slot, jnp.min(inside, 1), jnp.max(inside, 1), total)


def pick_near(groups: Groups, point: Array, u: Array) -> tuple[Array, Array, Array]:
    """Return (light, its probability, the number u made uniform again) for a point."""
    of_group, of_light = _weights(groups, point)
    group, first, u = _choose(of_group, groups.total.shape[0], u)
    row, second, u = _choose(lambda i: of_light(group, i), groups.size, u)
    return take(groups.light, group * groups.size + row), first * second, u


def share_near(groups: Groups, point: Array, light: Array) -> Array:
    """Return the probability () with which `pick_near` looks at a light from a point."""
    of_group, of_light = _weights(groups, point)
    slot = take(groups.slot, light)
    group, row = slot // groups.size, slot % groups.size
    first = of_group(group) / _sum(of_group, groups.total.shape[0], point[0])
    return first * of_light(group, row) / _sum(lambda i: of_light(group, i), groups.size, point[0])


def _size(n: int) -> int:
    """Return how many lights a group has, so that there are as many groups."""
    return round(n**0.5)


def _weights(groups: Groups, point: Array) -> tuple[Callable[[Array], Array], Callable[[Array, Array], Array]]:
    """Return the weights of a group, and of a light in a group, as a point sees them."""
    point, size = lax.stop_gradient(point), groups.size

    def of_group(i: Array) -> Array:
        low, high = take(groups.low, i), take(groups.high, i)
        nearest = jnp.maximum(jnp.maximum(low - point, point - high), 0)
        farthest = jnp.maximum(jnp.abs(low - point), jnp.abs(high - point))
        wide = high - low
        squared = safe_sqrt(dot(nearest, nearest)) * safe_sqrt(dot(farthest, farthest)) + SOFT / 4 * dot(wide, wide)
        return take(groups.total, i) / (squared + LEAST)

    def of_light(group: Array, i: Array) -> Array:
        away = take(groups.place, group * size + i) - point
        return take(groups.weight, group * size + i) / (dot(away, away) + LEAST)

    return of_group, of_light


def _sum(weight: Callable[[Array], Array], n: int, like: Array) -> Array:
    return lax.fori_loop(0, n, lambda i, total: total + weight(i), jnp.zeros_like(like))


def _choose(weight: Callable[[Array], Array], n: int, u: Array) -> tuple[Array, Array, Array]:
    """Return the number of one of n weights, its share, and u made uniform again."""
    total = _sum(weight, n, u)

    def look(i: Array, found: tuple[Array, ...]) -> tuple[Array, ...]:
        chosen, own, below, end = found
        this = weight(i)
        here = (end <= u * total) & (this > 0)
        return jnp.where(here, i, chosen), jnp.where(here, this, own), jnp.where(here, end, below), end + this

    nothing = jnp.zeros_like(u)
    chosen, own, below, _ = lax.fori_loop(0, n, look, (jnp.zeros_like(u, jnp.int32), nothing, nothing, nothing))
    rest = safe_divide(u * total - below, own)
    return chosen, safe_divide(own, total), jnp.clip(rest, 0, 1 - 2 * unit_roundoff(u))
