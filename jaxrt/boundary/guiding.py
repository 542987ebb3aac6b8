"""Spread samples along all outlines, or over pixels or candidates: where a pilot finds that they matter, else evenly.

All is cut into bins. A sample's place v in [0, 1) chooses a bin, and the place within, through the cumulative sum of
the bins' weights; places are evenly spaced, so that the error of a hard shadow falls like 1/n. A pilot of a quarter as
many samples goes first, at weights of the angle that a bin spans; none does where the weights tell each bin's worth.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Generic, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.typing import DTypeLike

from jaxrt.core.maths import safe_divide
from jaxrt.core.pytree import pytree
from jaxrt.core.samplers import LAST, Stream, independent
from jaxrt.kernels.native import map_packets, map_together, on_devices, want_wide

LANES = 128  # of a packet
TOGETHER = 2048  # packets at the same time, where devices want many lanes
ROUNDS = 4  # of a pilot's size each

Operands = TypeVar("Operands")

# Fractions of the plane's R-sequence (Roberts 2018) in 32 bits: 1/g and 1/g², g³ = g + 1
R2 = np.uint32(3242174889), np.uint32(2447445414)


@pytree
class Guide:
    """How likely each bin is."""

    cumulative: Array  # (b,)


class Draw(NamedTuple):
    """What one sample is drawn from: its place, and numbers of its own."""

    guide: Guide
    place: Array  # () in [0, 1)
    spread: tuple[Array, Array]  # a point of a sequence that fills the unit square evenly together with `place`
    stream: Stream
    total: Array  # () number of samples


class Placed(NamedTuple):
    """A place in one of the bins."""

    bin: Array  # () int32
    t: Array  # () place within the bin, in [0, 1)
    density: Array  # () per bin; 0 where nothing can be sampled


class Part(NamedTuple, Generic[Operands]):
    """Samples of one kind, of several for which one kernel finds what they ask for."""

    begin: Callable[[Operands, Draw], tuple[Any, Any]]  # gives what a sample asks for, and what it keeps
    end: Callable[[Any, Any], tuple[Any, Array]]  # gives result and measure from what it has kept, and what was found
    weights: Array
    n: int
    seed: Array


Sample = Callable[[Operands, Draw], tuple[Any, Array]]


def place(draw: Draw) -> Placed:
    """Return in which bin a sample lies, and where."""
    cumulative = draw.guide.cumulative
    last = cumulative.shape[0] - 1
    chosen = jnp.minimum(jnp.searchsorted(cumulative, draw.place, side="right"), last).astype(jnp.int32)
    below = jnp.where(chosen > 0, cumulative[jnp.maximum(chosen - 1, 0)], 0)
    share = cumulative[chosen] - below
    t = jnp.clip(safe_divide(draw.place - below, share), 0, 1)
    return Placed(chosen, t, jnp.maximum(share, 0))


def one_of_both(coin: Array, worth: Array, total: Array) -> tuple[Array, Array, Array]:
    """Return whether a candidate takes the place of all before it, by its worth; a coin for the next; the new total.

    coin: () in [0, 1), `total`: () worth of those before. One pass in any order chooses each by its share (Chao 1982).
    """
    total = total + worth
    share = safe_divide(worth, total)
    taken = coin < share
    coin = jnp.where(taken, safe_divide(coin, share), safe_divide(coin - share, 1 - share))
    return taken, jnp.clip(coin, 0, LAST), total


def sample_guided(
    sample: Sample[Operands], operands: Operands, weights: Array, n: int, seed: Array, devices: tuple[jax.Device, ...]
) -> Any:
    """Return the samples, a pytree with leading axis >= n, that sample(operands, draw) -> (result, measure) gives.

    weights: (b,) >= 0 to begin with. measure: () >= 0, what a sample brings, divided by its density. Results do not
    depend on the devices.
    """

    def begin(operands: Operands, draw: Draw) -> tuple[None, tuple[Any, Array]]:
        return None, sample(operands, draw)

    return sample_together([Part(begin, lambda own, _: own, weights, n, seed)], operands, None, devices)[0]


def sample_together(
    parts: Sequence[Part[Operands]],
    operands: Operands,
    follow: Callable[[Operands, Any], Any] | None,
    devices: tuple[jax.Device, ...],
) -> list[Any]:
    """Return the samples of each part as `sample_guided` does: what all parts ask for is found in one kernel.

    follow: gives what is found from what is asked for; None where that is nothing.
    """
    counts = [-(-part.n // (ROUNDS * LANES)) for part in parts]

    def one_round(weights: list[Array], number: Array) -> tuple[list[Array], list[Any]]:
        guides = [guide_of(x) for x in weights]
        begun = [
            _drawn(part.begin, operands, (guide, number, part.seed), count, devices)
            for part, guide, count in zip(parts, guides, counts, strict=True)
        ]
        found = [None for _ in parts] if follow is None else _followed(follow, operands, begun, devices)
        ended = [jax.vmap(jax.vmap(part.end))(x[1], y) for part, x, y in zip(parts, begun, found, strict=True)]
        mixed = []
        for part, guide, start, (_, measure) in zip(parts, guides, weights, ended, strict=True):
            brought = _found(guide, measure.reshape(-1), _shift(jnp.uint32(1), part.seed, start.dtype)[0])
            # Keep half of the first weights: what the pilot missed is still found
            mixed.append(jnp.where(number == 0, _normalised(start) + _normalised(brought), start))
        return mixed, [result for result, _ in ended]

    _, results = lax.scan(one_round, [part.weights for part in parts], jnp.arange(ROUNDS + 1, dtype=jnp.int32))
    return [jax.tree.map(lambda x: x[1:].reshape(-1, *x.shape[3:]), result) for result in results]


def _followed(
    follow: Callable[[Operands, Any], Any], operands: Operands, begun: list[Any], devices: tuple[jax.Device, ...]
) -> list[Any]:
    """Return what is found, part by part, from what is asked for (packets, LANES, …)."""
    asked = jax.tree.map(lambda *x: jnp.concatenate(x), *(asked for asked, _ in begun))

    def packet(operands: tuple[Operands, Any], packet: Array) -> Any:
        rest, asked = operands
        return jax.vmap(partial(follow, rest))(jax.tree.map(lambda x: x[packet], asked))

    counts = [jax.tree.leaves(asked)[0].shape[0] for asked, _ in begun]
    found = of_packets(packet, (operands, asked), sum(counts), devices)
    ends = [sum(counts[: i + 1]) for i in range(len(counts))]
    return [jax.tree.map(lambda x, i=end - n, k=end: x[i:k], found) for n, end in zip(counts, ends, strict=True)]


def sample_evenly(
    sample: Callable[[Operands, Draw], Any],
    operands: Operands,
    weights: Array,
    n: int,
    seed: Array,
    devices: tuple[jax.Device, ...],
) -> Any:
    """Return samples as `sample_guided` does, without a pilot: what sample(operands, draw) gives, by the weights alone.

    Where they tell each bin's worth, what few samples find of few bins would only make them uneven.
    """
    packets = -(-n // LANES)
    results = _drawn(sample, operands, (guide_of(weights), jnp.int32(0), seed), packets, devices)
    return jax.tree.map(lambda x: x.reshape(packets * LANES, *x.shape[2:]), results)


def guide_of(weights: Array) -> Guide:
    """Return the guide by weights (b,) >= 0."""
    return Guide(jnp.cumsum(_normalised(weights)))


def _normalised(weights: Array) -> Array:
    return safe_divide(weights, jnp.broadcast_to(jnp.sum(weights), weights.shape))


def _found(guide: Guide, measure: Array, offset: Array) -> Array:
    """Return the sums (b,) of the pilot's measures in each bin: its samples stand in the order of their places."""
    n = measure.shape[0]
    total = jnp.concatenate([jnp.zeros(1, measure.dtype), jnp.cumsum(measure)])
    end = jnp.clip(jnp.ceil(n * guide.cumulative - offset).astype(jnp.int32), 0, n)
    return jnp.maximum(jnp.diff(total[end], prepend=jnp.zeros(1, measure.dtype)), 0)


def _drawn(
    sample: Callable[[Operands, Draw], Any],
    operands: Operands,
    start: tuple[Guide, Array, Array],
    packets: int,
    devices: tuple[jax.Device, ...],
) -> Any:
    """Return what sample(operands, draw) gives (packets, LANES, …). start: as `draw_from` takes it."""

    def packet(operands: tuple[Operands, tuple[Guide, Array, Array]], packet: Array) -> Any:
        rest, start = operands

        def one(lane: Array) -> Any:
            return sample(rest, draw_from(*start, packet * LANES + lane, packets * LANES))

        return jax.vmap(one)(jnp.arange(LANES, dtype=jnp.int32))

    return of_packets(packet, (operands, start), packets, devices)


def of_packets(
    f: Callable[[Operands, Array], Any], operands: Operands, packets: int, devices: tuple[jax.Device, ...]
) -> Any:
    """Return f(operands, packet) (packets, …) of each packet, wherever it is computed."""
    found = partial(map_together, together=TOGETHER) if want_wide(devices) else map_packets

    def on_device(operands: Operands, packets: Array) -> Any:
        return jax.tree.map(lambda x: x[None], found(f, operands, packets[0]))

    results = on_devices(on_device, operands, packets, devices)
    return jax.tree.map(
        lambda x: jnp.swapaxes(x, 0, 1).reshape(x.shape[0] * x.shape[1], *x.shape[2:])[:packets], results
    )


def draw_from(guide: Guide, number: Array, seed: Array, k: Array, count: int) -> Draw:
    """Return what sample k of `count` is drawn from. Round 0 is the pilot, or all there is; the others interleave."""
    dtype = guide.cumulative.dtype
    pilot = number == 0
    total = jnp.where(pilot, count, ROUNDS * count)
    index = jnp.where(pilot, k, ROUNDS * k + number - 1)
    which = jnp.where(pilot, 1, 0).astype(jnp.uint32)
    offset, first, second = _shift(which, seed, dtype)
    at = jnp.minimum((index.astype(dtype) + offset) / total.astype(dtype), 1 - jnp.finfo(dtype).epsneg)
    spread = turned(index, R2[0], first), turned(index, R2[1], second)
    stream = Stream(which, index.astype(jnp.uint32), seed ^ _OWN, total.astype(jnp.uint32))
    return Draw(guide, at, spread, stream, total.astype(dtype))


_OWN = np.uint32(0x68E31DA4)  # keeps the edges' random numbers apart from the pixels'


def _shift(which: Array, seed: Array, dtype: DTypeLike) -> tuple[Array, Array, Array]:
    """Return the random shifts of a sequence's three coordinates. which: () 1 for the pilot's, else 0."""
    a, b, c, _ = independent(Stream(which, jnp.uint32(0), seed ^ _OWN, jnp.uint32(1)), 0)
    return a.astype(dtype), b.astype(dtype), c.astype(dtype)


def turned(index: Array, step: np.uint32, shift: Array) -> Array:
    """Return the fraction of index · step + shift, the product in 32 bits: float32 would lose it."""
    turns = ((index.astype(jnp.uint32) * step) >> 8).astype(jnp.int32).astype(shift.dtype) * 2.0**-24
    total = turns + shift
    return jnp.clip(jnp.where(total >= 1, total - 1, total), 0, LAST)
