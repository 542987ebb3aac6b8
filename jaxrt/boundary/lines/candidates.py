"""Lines that are looked at beforehand, many more than are searched: each is drawn as often as it is worth it.

So what is seldom found is not drawn seldom: it counts as much as all else.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxrt.boundary.guiding import LANES, R2, Guide, draw_from, of_packets, place, turned
from jaxrt.boundary.lines.looks import WITHIN, Line, line_through, numbers_of
from jaxrt.boundary.lines.search import Chosen, choose
from jaxrt.boundary.shadows import Plan
from jaxrt.boundary.trail import through_lens
from jaxrt.cameras import View
from jaxrt.core.maths import safe_divide
from jaxrt.core.samplers import Stream
from jaxrt.kernels.native import once
from jaxrt.transport.path import Tables

RATIO = 4  # candidates for each sample


class Candidate(NamedTuple):
    """A line that may be searched."""

    line: Line
    stream: Stream  # of the numbers by which all is looked at on it
    pixel: Array  # () int32
    density: Array  # () per pixel and direction


def candidate(camera: View, guide: Guide, k: Array, count: int, seed: Array) -> Candidate:
    """Return the k-th candidate of so many. guide: of pixels."""
    draw = draw_from(guide, jnp.int32(0), seed ^ jnp.uint32(16), k, count)
    placed = once(place)(draw)
    # Even places start elsewhere in each pixel: of one start for all, a seed's error would be that of a single number,
    # and of starts by chance, edges through many pixels would lose what even places are for
    width = jnp.int32(camera.width)
    start = turned(placed.bin % width, R2[0], turned(placed.bin // width, R2[1], placed.t))
    line = line_through(camera, placed.bin, start)
    return Candidate(line, draw.stream, placed.bin, placed.density * draw.total / 2)


def choices(plan: Plan, tables: Tables, guide: Guide, count: int, seed: Array) -> tuple[Chosen, Array]:
    """Return the intervals of candidates (count,), a multiple of LANES, and their worths, each over its density."""

    def one_packet(operands: tuple[Tables, Guide, Array], packet: Array) -> tuple[Chosen, Array]:
        lanes = packet * LANES + jnp.arange(LANES, dtype=jnp.int32)
        return jax.vmap(partial(_choice, plan, count, *operands))(lanes)

    found = of_packets(one_packet, (tables, guide, seed), count // LANES, plan.devices)
    chosen: tuple[Chosen, Array] = jax.tree.map(lambda x: x.reshape(count, *x.shape[2:]), found)
    return chosen


def _choice(plan: Plan, count: int, tables: Tables, guide: Guide, seed: Array, k: Array) -> tuple[Chosen, Array]:
    """Return the interval of a candidate, and its worth."""
    here = candidate(tables.camera, guide, k, count, seed)
    tables = through_lens(tables, here.stream)
    numbers = numbers_of(here.stream, tables.dtype)
    chosen = choose(plan, tables, here.line, numbers, numbers(WITHIN)[:2])
    return chosen, safe_divide(chosen.total, here.density)
