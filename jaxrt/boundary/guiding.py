"""Spread samples along all outlines: by a pilot's finding where they matter, evenly within.

Outlines are cut into bins. A sample's place v in [0, 1) chooses a bin, and the place within, through the cumulative
sum of the bins' weights; places are evenly spaced, so that the error of a hard shadow falls like 1/n. Samples of equal
number serve as the pilot of a quarter their size, at weights of the angle that a bin spans.
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
from jaxrt.kernels.native import map_packets, on_devices

LANES = 128  # of a packet
ROUNDS = 4  # of a pilot's size each

Operands = TypeVar("Operands")

# Fractions of the plane's R-sequence (Roberts 2018) in 32 bits: 1/g and 1/g², g³ = g + 1
_R2 = np.uint32(3242174889), np.uint32(2447445414)


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
    """A place on the outlines."""

    bin: Array  # () int32
    t: Array  # () place within the bin, in [0, 1)
    density: Array  # () per bin; 0 where nothing can be sampled


class Part(NamedTuple, Generic[Operands]):
    """Samples of one kind, of several that one kernel draws."""

    begin: Callable[[Operands, Draw], tuple[Any, Any]]  # gives what to follow, and what the sample keeps
    end: Callable[[Any, Any], tuple[Any, Array]]  # gives result and measure from what it has kept, and what was found
    weights: Array
    n: int
    seed: Array


Sample = Callable[[Operands, Draw], tuple[Any, Array]]


def place(draw: Draw) -> Placed:
    """Return where on the outlines a sample lies."""
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

    def begin(operands: Operands, draw: Draw) -> tuple[Array, Any]:
        result, measure = sample(operands, draw)
        return measure, result

    part = Part(begin, lambda result, measure: (result, measure), weights, n, seed)
    return sample_together([part], operands, lambda _, measure: measure, devices)[0]


def sample_together(
    parts: Sequence[Part[Operands]],
    operands: Operands,
    follow: Callable[[Operands, Any], Any],
    devices: tuple[jax.Device, ...],
) -> list[Any]:
    """Return the samples of each part as `sample_guided` does, from one kernel, which has follow's code but once."""
    counts = [-(-part.n // (ROUNDS * LANES)) for part in parts]

    def one_round(weights: list[Array], number: Array) -> tuple[list[Array], Any]:
        guides = [guide_of(x) for x in weights]
        starts = [(guide, number, part.seed) for guide, part in zip(guides, parts, strict=True)]
        found = _run(partial(_packet, parts, counts, follow), (operands, starts), sum(counts), devices)
        results, mixed, first = [], [], 0
        for part, count, guide, weight, both in zip(parts, counts, guides, weights, found, strict=True):
            result, measure = jax.tree.map(lambda x, i=first, n=count: x[i : i + n], both)
            brought = _found(guide, measure.reshape(-1), _shift(jnp.uint32(1), part.seed, weight.dtype)[0])
            # Keep half of the first weights: what the pilot missed is still found
            mixed.append(jnp.where(number == 0, _normalised(weight) + _normalised(brought), weight))
            results.append(result)
            first += count
        return mixed, results

    _, results = lax.scan(one_round, [part.weights for part in parts], jnp.arange(ROUNDS + 1, dtype=jnp.int32))
    return [
        jax.tree.map(lambda x, count=count: x[1:].reshape(ROUNDS * count * LANES, *x.shape[3:]), result)
        for count, result in zip(counts, results, strict=True)
    ]


def _packet(
    parts: Sequence[Part[Operands]],
    counts: list[int],
    follow: Callable[[Operands, Any], Any],
    operands: Any,
    packet: Array,
) -> list[Any]:
    """Return what samples give (LANES, …): of each part, though those of the packet's own alone are of use."""
    rest, starts = operands
    if len(parts) == 1:

        def one(draw: Draw) -> list[Any]:
            asked, own = parts[0].begin(rest, draw)
            return [parts[0].end(own, follow(rest, asked))]

        return _lanes(one, starts[0], packet, counts[0])
    first = [sum(counts[:i]) for i in range(len(parts))]
    begun = [jax.jit(partial(_begun, part, count)) for part, count in zip(parts, counts, strict=True)]
    given = [(rest, start, packet - i) for start, i in zip(starts, first, strict=True)]
    nothing = [jax.tree.map(_zeros, jax.eval_shape(f, *x)[1]) for f, x in zip(begun, given, strict=True)]

    def of(i: int) -> Callable[[], tuple[Any, list[Any]]]:
        def own() -> tuple[Any, list[Any]]:
            asked, drawn = begun[i](*given[i])
            return asked, [drawn if k == i else x for k, x in enumerate(nothing)]

        return own

    which = sum((packet >= i).astype(jnp.int32) for i in first[1:])
    asked, drawn = lax.switch(which, [of(i) for i in range(len(parts))])
    found = jax.vmap(partial(follow, rest))(asked)
    return [jax.vmap(part.end)(x, found) for part, x in zip(parts, drawn, strict=True)]


def _begun(part: Part[Operands], count: int, operands: Operands, start: Any, packet: Array) -> Any:
    """Return what the samples of one of `count` packets begin with."""
    return _lanes(lambda draw: part.begin(operands, draw), start, packet, count)


def _lanes(f: Callable[[Draw], Any], start: tuple[Guide, Array, Array], packet: Array, count: int) -> Any:
    """Return f (LANES, …) of what the samples of one of `count` packets are drawn from."""

    def one(lane: Array) -> Any:
        return f(draw_from(*start, packet * LANES + lane, count * LANES))

    return jax.vmap(one)(jnp.arange(LANES, dtype=jnp.int32))


def _zeros(x: jax.ShapeDtypeStruct) -> Array:
    return jnp.zeros(x.shape, x.dtype)


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

    def packet(operands: tuple[Operands, Any], packet: Array) -> Any:
        rest, start = operands
        return _lanes(partial(sample, rest), start, packet, packets)

    results = _run(packet, (operands, (guide_of(weights), jnp.int32(0), seed)), packets, devices)
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


def _run(f: Callable[..., Any], operands: Any, packets: int, devices: tuple[jax.Device, ...]) -> Any:
    """Return f(operands, packet) (packets, …) of each packet."""

    def on_device(operands: Any, packets: Array) -> Any:
        return jax.tree.map(lambda x: x[None], map_packets(f, operands, packets[0]))

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
    spread = _turned(index, _R2[0], first), _turned(index, _R2[1], second)
    stream = Stream(which, index.astype(jnp.uint32), seed ^ _OWN, total.astype(jnp.uint32))
    return Draw(guide, at, spread, stream, total.astype(dtype))


_OWN = np.uint32(0x68E31DA4)  # keeps the edges' random numbers apart from the pixels'


def _shift(which: Array, seed: Array, dtype: DTypeLike) -> tuple[Array, Array, Array]:
    """Return the random shifts of a sequence's three coordinates. which: () 1 for the pilot's, else 0."""
    a, b, c, _ = independent(Stream(which, jnp.uint32(0), seed ^ _OWN, jnp.uint32(1)), 0)
    return a.astype(dtype), b.astype(dtype), c.astype(dtype)


def _turned(index: Array, step: np.uint32, shift: Array) -> Array:
    """Return the fraction of index · step + shift, the product in 32 bits: float32 would lose it."""
    turns = ((index.astype(jnp.uint32) * step) >> 8).astype(jnp.int32).astype(shift.dtype) * 2.0**-24
    total = turns + shift
    return jnp.clip(jnp.where(total >= 1, total - 1, total), 0, LAST)
