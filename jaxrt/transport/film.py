"""Packets of pixels: which pixels a packet holds, one sample of each, and packets over devices."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.custom_batching import sequential_vmap as in_turn
from numpy.typing import NDArray

from jaxrt.core.maths import kahan_add
from jaxrt.core.records import Ray
from jaxrt.core.samplers import SAMPLERS, Stream
from jaxrt.filters import Filter
from jaxrt.kernels.gather import take
from jaxrt.kernels.native import fold_packets, map_packets, on_devices, want_wide
from jaxrt.transport.outputs import Output, channels, first_met, numbers_met
from jaxrt.transport.path import Numbers, Tables, marked, radiance

BLOCK = 4  # samples, numbered from 0, whose sum is rounded; all that is divided anywhere is divided between blocks
SHARES = 64  # at most, of a picture that several threads draw; the program of a share serves any number up to that
NATIVE_LANES = 1024  # packets of more lanes are not compiled as one native kernel

_numbers = {name: jax.jit(sampler) for name, sampler in SAMPLERS.items()}  # traced once, though each event asks anew

Operands = TypeVar("Operands")
Totals = TypeVar("Totals")
Pixels = TypeVar("Pixels", Array, NDArray[np.float32])


class Plan(NamedTuple):
    """How a picture is drawn: what is compiled, besides the scene's structure."""

    max_depth: int
    sampler: str
    unroll: bool
    tile: tuple[int, int]  # width, height of a packet in pixels
    devices: tuple[jax.Device, ...]
    shares: int = SHARES
    outputs: tuple[Output, ...] = ()  # what is drawn instead of radiance
    size: tuple[int, int] | None = None  # columns, rows of what is drawn; None: of the whole picture
    filter: Filter | None = None  # by which film counts in pixels; None: a box

    @property
    def channels(self) -> int:
        """Numbers of a pixel."""
        return channels(self.outputs)

    @property
    def lanes(self) -> int:
        """Pixels in a packet."""
        return self.tile[0] * self.tile[1]


class Run(NamedTuple):
    """Which samples are drawn: traced, so that one compilation serves them all."""

    seed: Array  # () uint32
    first: Array  # () int32
    end: Array  # () int32, one past the last
    spp: Array  # () int32
    corner: Array | None = None  # (2,) int32 column and row where a window begins
    pixels: Array | None = None  # (n, 2) int32 column and row of each pixel of a list, drawn as a picture n × 1


def sample_packet(
    plan: Plan,
    tables: Tables,
    run: Run,
    sample: Array,
    packet: Array,
    attached: bool = False,
    marks: Array | None = None,
) -> Array:
    """Return the radiance (lanes, 3) of sample number `sample` of the packet's pixels, in row order of its tile.

    Or the outputs (lanes, channels) that are drawn instead.

    attached: with the light samples that derivatives want, see `path.radiance`. marks: (lanes, …), see there.
    """
    x, y = pixels_of(plan, tables, run, packet)
    return jax.vmap(partial(_sample, plan, tables, run, sample, attached))(x, y, marks)


def size_of(tables: Tables, plan: Plan) -> tuple[int, int]:
    """Return columns and rows of what is drawn."""
    return plan.size or (tables.camera.width, tables.camera.height)


def pixels_of(plan: Plan, tables: Tables, run: Run, packet: Array) -> tuple[Array, Array]:
    """Return columns and rows (lanes,) of a packet's pixels."""
    return pixel_of(plan, tables, run, packet, jnp.arange(plan.lanes, dtype=jnp.int32))


def pixel_of(plan: Plan, tables: Tables, run: Run, packet: Array, lane: Array) -> tuple[Array, Array]:
    """Return column and row of one of a packet's pixels, or of several."""
    width, height = plan.tile
    columns = -(-size_of(tables, plan)[0] // width)
    x = packet % columns * width + lane % width
    y = packet // columns * height + lane // width
    if run.pixels is not None:
        chosen = take(run.pixels, jnp.minimum(x, run.pixels.shape[0] - 1))
        return chosen[..., 0], chosen[..., 1]
    if run.corner is not None:
        return x + run.corner[0], y + run.corner[1]
    return x, y


def _sample(
    plan: Plan, tables: Tables, run: Run, sample: Array, attached: bool, x: Array, y: Array, marks: Array | None
) -> Array:
    """Return the radiance (3,), or the outputs, of one sample of pixel (x, y), column and row."""
    numbers = numbers_of(plan, tables, run, sample, x, y)
    ray = camera_ray(plan, tables, numbers, x, y)
    if plan.outputs:
        return first_met(plan.outputs, tables if marks is None else marked(tables, marks[0]), ray)
    return radiance(tables, ray, numbers, plan.max_depth, plan.unroll, attached, marks)


def numbers_of(plan: Plan, tables: Tables, run: Run, sample: Array, x: Array, y: Array) -> Numbers:
    """Return the random numbers of one sample of pixel (x, y), column and row."""
    dtype = tables.dtype
    pixel = y.astype(jnp.uint32) * jnp.uint32(tables.camera.width) + x.astype(jnp.uint32)
    stream = Stream(pixel, sample.astype(jnp.uint32), run.seed, run.spp.astype(jnp.uint32))

    def numbers(block: int | Array) -> tuple[Array, Array, Array, Array]:
        a, b, c, d = _numbers[plan.sampler](stream, jnp.int32(block))
        return a.astype(dtype), b.astype(dtype), c.astype(dtype), d.astype(dtype)

    return numbers


def camera_ray(plan: Plan, tables: Tables, numbers: Numbers, x: Array, y: Array) -> Ray:
    """Return the ray of a sample, whose random numbers these are, of pixel (x, y)."""
    jitter, dtype = numbers(0), tables.dtype
    across, down = jitter[:2]
    if plan.filter is not None:
        across, down = 0.5 + plan.filter.place(across), 0.5 + plan.filter.place(down)
    return tables.camera.ray((x.astype(dtype) + across, y.astype(dtype) + down), jitter[2:])


def draw_packets(f: Callable[[Operands, Array], Array], operands: Operands, size: tuple[int, int], plan: Plan) -> Array:
    """Return the picture (height, width, …) that the packets f(operands, packet) of shape (lanes, …) make up."""

    def on_device(operands: Operands, packets: Array) -> Array:
        return map_packets(f, operands, packets[0], is_native(plan))[None]

    return _picture(on_devices(on_device, operands, _count(size, plan), plan.devices), size, plan)


def draw_numbers(tables: Tables, run: Run, plan: Plan) -> Array:
    """Return primitive and row of its material (height, width, 2) that each pixel's middle shows, −1 for nothing."""

    def middle(tables: Tables, x: Array, y: Array) -> Array:
        half = jnp.full((), 0.5, tables.dtype)
        return numbers_met(
            tables, tables.camera.ray((x.astype(half.dtype) + half, y.astype(half.dtype) + half), (half, half))
        )

    def packet(operands: tuple[Tables, Run], packet: Array) -> Array:
        tables, run = operands
        return jax.vmap(partial(middle, tables))(*pixels_of(plan, tables, run, packet))

    # Batches in turn, as for pictures
    return in_turn(lambda *operands: draw_packets(packet, operands, size_of(tables, plan), plan))(tables, run)


def shares_of(size: tuple[int, int], plan: Plan) -> tuple[int, int]:
    """Return in how many shares a picture is drawn, and how many packets a share has: few turns for many hands."""
    count = _count(size, plan)
    turns = -(-count // plan.shares)
    return -(-count // turns), turns


def draw_share(
    f: Callable[[Operands, Array], Array], operands: Operands, share: Array, size: tuple[int, int], plan: Plan
) -> Array:
    """Return the packets (turns, lanes, …) of one share, f(operands, packet) each, dealt like cards."""
    shares, turns = shares_of(size, plan)
    packets = share + shares * jnp.arange(turns, dtype=jnp.int32)
    return map_packets(f, operands, packets, is_native(plan))


def joined(parts: NDArray[np.float32], size: tuple[int, int], plan: Plan) -> NDArray[np.float32]:
    """Return the picture (height, width, …) of all shares (shares, turns, lanes, …)."""
    return _picture(parts, size, plan)


def sum_packets(
    add: Callable[[Operands, Array, Totals], Totals],
    operands: Operands,
    nothing: Totals,
    totals_of: Callable[[Totals], list[Array]],
    size: tuple[int, int],
    plan: Plan,
) -> list[Array]:
    """Return the totals of sums over all packets of a picture.

    add: returns sums with what a packet adds to them. nothing: sums of nothing.
    """

    def on_device(operands: Operands, packets: Array) -> list[Array]:
        # Surplus packets have no pixels in the picture, and their cotangents are 0
        totals = totals_of(fold_packets(add, operands, nothing, packets[0], is_native(plan)))
        return [total[None] for total in totals]

    return [jnp.sum(total, axis=0) for total in on_devices(on_device, operands, _count(size, plan), plan.devices)]


def kahan_add_all(sums: list[list[Array]], values: list[Array]) -> list[list[Array]]:
    """Return [totals, compensations] after adding to each total its value."""
    pairs = [kahan_add(*each) for each in zip(*sums, values, strict=True)]
    return [[pair[0] for pair in pairs], [pair[1] for pair in pairs]]


def packets_of(picture: Array, plan: Plan) -> Array:
    """Return the packets (n, lanes, c) of a picture (height, width, c); what hangs over its edges is 0."""
    columns, rows, share = _layout((picture.shape[1], picture.shape[0]), plan)
    width, height = plan.tile
    picture = jnp.pad(picture, ((0, rows * height - picture.shape[0]), (0, columns * width - picture.shape[1]), (0, 0)))
    tiles = picture.reshape(rows, height, columns, width, picture.shape[2]).swapaxes(1, 2)
    packets = tiles.reshape(rows * columns, height * width, picture.shape[2])
    return jnp.pad(packets, ((0, share * len(plan.devices) - rows * columns), (0, 0), (0, 0)))


def is_native(plan: Plan) -> bool:
    """Return whether the packets are narrow enough for one native kernel, and are for CPUs."""
    return plan.lanes <= NATIVE_LANES and not want_wide(plan.devices)


def _layout(size: tuple[int, int], plan: Plan) -> tuple[int, int, int]:
    """Return columns and rows of tiles, and the number of packets of each device."""
    columns, rows = -(-size[0] // plan.tile[0]), -(-size[1] // plan.tile[1])
    return columns, rows, -(-columns * rows // len(plan.devices))


def _count(size: tuple[int, int], plan: Plan) -> int:
    """Return the number of packets of a picture."""
    columns, rows, _ = _layout(size, plan)
    return columns * rows


def _picture(packets: Pixels, size: tuple[int, int], plan: Plan) -> Pixels:
    """Return the picture from packets (device or share, turn, lane, …)."""
    columns, rows, _ = _layout(size, plan)
    width, height = plan.tile
    values = packets.shape[3:]
    packets = packets.swapaxes(0, 1).reshape(-1, height, width, *values)[: columns * rows]
    picture = packets.reshape(rows, columns, height, width, *values).swapaxes(1, 2)
    return picture.reshape(rows * height, columns * width, *values)[: size[1], : size[0]]
