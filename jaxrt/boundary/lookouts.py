"""Where on the outlines to look from anywhere: as it looks from the nearest of a few places.

How large each outline looks is found once for each of these places, and points of outlines are drawn by that. What does
not show from there, but may from nearby or from elsewhere, keeps a share.
"""

import jax.numpy as jnp
from jax import Array, lax

from jaxrt.boundary.silhouettes import Silhouettes, angular_lengths, is_bent
from jaxrt.core.maths import dot, safe_divide
from jaxrt.core.pytree import pytree

SHARES = 0.4, 0.4  # of the points drawn by what shows from the place itself, and from anywhere near it


@pytree
class Lookouts:
    """A few places of the scene, and how large outlines look from there."""

    position: Array  # (e, 3)
    cumulative: Array  # (e · rows,) of each place in turn, up to 1


def lookouts_at(outlines: Silhouettes, positions: Array, first: int, creases: bool) -> Lookouts:
    """Return the lookouts at positions (e, 3). first: the first row that counts. creases: as for `angular_lengths`."""
    counts = jnp.arange(outlines.rows) >= first
    others = _share(jnp.where(counts, _any_eye(outlines), 0))

    def cumulative(place: tuple[Array, Array]) -> Array:
        eye, reach = place
        here, near = (
            _share(jnp.where(counts, angular_lengths(outlines, eye, r, creases, 1), 0))
            for r in (jnp.zeros_like(reach), reach)
        )
        return jnp.cumsum(_share(SHARES[0] * here + SHARES[1] * near + (1 - sum(SHARES)) * others))

    reach = _spacing(positions)
    return Lookouts(positions, lax.map(cumulative, (positions, reach)).ravel())


def _spacing(positions: Array) -> Array:
    """Return the distance (e,) of each place to the nearest other one."""
    squared = jnp.sum((positions[:, None] - positions[None]) ** 2, -1)
    other = squared > 0
    return jnp.sqrt(jnp.min(jnp.where(other, squared, jnp.max(squared)), -1))


def nearest_lookout(lookouts: Lookouts, eye: Array) -> Array:
    """Return the number of the nearest place, in a loop: native kernels of jaxlib 0.12 have no reductions like this."""
    positions = lookouts.position

    def closer(k: Array, best: tuple[Array, Array]) -> tuple[Array, Array]:
        away = positions[k] - eye
        squared = dot(away, away)
        return jnp.where(squared < best[0], squared, best[0]), jnp.where(squared < best[0], k, best[1])

    start = jnp.full((), jnp.inf, eye.dtype), jnp.int32(0)
    return lax.fori_loop(0, positions.shape[0], closer, start)[1]


def point_seen(lookouts: Lookouts, start: Array, place: Array, rows: int) -> tuple[Array, Array, Array]:
    """Return row, t and density of a place in [0, 1) of what shows from the lookout whose rows begin at `start`."""
    cumulative = lookouts.cumulative

    def halve(_: Array, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = ends
        middle = (low + high) // 2
        beyond = cumulative[start + middle] > place
        return jnp.where(beyond, low, middle + 1), jnp.where(beyond, middle, high)

    low, _ = lax.fori_loop(0, rows.bit_length(), halve, (jnp.int32(0), jnp.int32(rows - 1)))
    row = jnp.minimum(low, rows - 1)
    below = jnp.where(row > 0, cumulative[start + jnp.maximum(row - 1, 0)], 0)
    share = jnp.maximum(cumulative[start + row] - below, 0)
    return row, jnp.clip(safe_divide(place - below, share), 0, 1), share


def _any_eye(outlines: Silhouettes) -> Array:
    """Return 1 (rows,) for each outline that shows to any eye at all, else 0."""
    parts = [jnp.ones_like(outlines.spheres.radius)] if outlines.spheres is not None else []
    if outlines.edges is not None:
        edges = outlines.edges
        shows = edges.used & (is_bent(edges) | ~edges.same)
        parts.append(shows.astype(edges.normals.dtype))
    return jnp.concatenate(parts)


def _share(weights: Array) -> Array:
    return safe_divide(weights, jnp.broadcast_to(jnp.sum(weights), weights.shape))
