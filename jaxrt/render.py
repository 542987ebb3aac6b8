"""From a scene to a picture: the only vmap, packets of pixels, chunks of samples, devices."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple, TypedDict, Unpack

import jax
import jax.numpy as jnp
from jax import Array, lax
from jax.sharding import Mesh, PartitionSpec
from jax.typing import ArrayLike

from jaxrt.camera import camera_ray
from jaxrt.description import RenderDefaults, nearest
from jaxrt.maths import kahan_add
from jaxrt.native import map_packets
from jaxrt.path import Tables, radiance, tables_of
from jaxrt.samplers import SAMPLERS, Stream, seed_from_key
from jaxrt.scene import Scene

CPU_TILE = (16, 8)  # pixels of a packet on a CPU: its values stay in the first-level cache
WIDE_TILE = (512, 128)  # on accelerators, which want many lanes at once
NATIVE_LANES = 1024  # packets of more lanes are not compiled as one native kernel


class Plan(NamedTuple):
    """How a picture is drawn: what is compiled, besides the scene's structure."""

    max_depth: int
    sampler: str
    unroll: bool
    tile: tuple[int, int]  # width, height of a packet in pixels
    devices: tuple[jax.Device, ...]


class Run(NamedTuple):
    """Which samples are drawn: traced, so that one compilation serves them all."""

    seed: Array  # () uint32
    first: Array  # () int32
    end: Array  # () int32, one past the last
    spp: Array  # () int32


def use_cpu_cores(n: int) -> None:
    """Let JAX see `n` CPU devices, so that `render` uses as many cores. Must come before JAX computes anything.

    Raises ValueError for n < 1, and RuntimeError (JAX's own) where a backend has started already.
    """
    if n < 1:
        raise ValueError(f"use_cpu_cores: n is {n}, want at least 1")
    jax.config.update("jax_num_cpu_devices", n)


def render(
    scene: Scene,
    key: int | Array,
    *,
    spp: int | None = None,
    max_depth: int | None = None,
    sampler: str = "sobol",
    unroll: bool = False,
    tile: tuple[int, int] | None = None,
    devices: Sequence[jax.Device] | None = None,
) -> Array:
    """Return the picture (height, width, 3) in linear radiance, W·sr⁻¹·m⁻²; row 0 is the top.

    key: an int or a `jax.random.key`. spp: samples per pixel; max_depth: scattering events along a path; both default
    to the scene's own. sampler: "sobol", "stratified" or "independent". unroll: compile each event apart, instead of
    one event in a loop. tile: width and height of a packet in pixels. devices: those to use, by default all of JAX's
    default backend. The picture depends on none of the last three. Memory does not grow with spp.

    Pure: works under jit and vmap. Raises ValueError for an unknown sampler and for counts below 1.
    """
    spp = scene.defaults.spp if spp is None else spp
    if spp < 1:
        raise ValueError(f"render: spp is {spp}, want at least 1")
    total = render_sum(
        scene, key, 0, spp, spp=spp, max_depth=max_depth, sampler=sampler, unroll=unroll, tile=tile, devices=devices
    )
    return total / spp


class Options(TypedDict, total=False):
    """How to render, besides what; see `render`."""

    max_depth: int | None
    sampler: str
    unroll: bool
    tile: tuple[int, int] | None
    devices: Sequence[jax.Device] | None


def render_sum(
    scene: Scene, key: int | Array, first: ArrayLike, count: ArrayLike, *, spp: ArrayLike, **options: Unpack[Options]
) -> Array:
    """Return the sum (height, width, 3) of samples first … first + count − 1 out of `spp` in each pixel.

    Sums of chunks that cover 0 … spp − 1 add up to `spp` times the picture of `render`. `first`, `count` and `spp` may
    change without another compilation. The rest is as for `render`.
    """
    return draw_sum(*prepare(scene, key, first, count, spp, **options))


def prepare(
    scene: Scene,
    key: int | Array,
    first: ArrayLike,
    count: ArrayLike,
    spp: ArrayLike,
    *,
    max_depth: int | None = None,
    sampler: str = "sobol",
    unroll: bool = False,
    tile: tuple[int, int] | None = None,
    devices: Sequence[jax.Device] | None = None,
) -> tuple[Scene, Run, Plan]:
    """Return the arguments of `draw_sum` from those of `render_sum`, checked."""
    max_depth = scene.defaults.max_depth if max_depth is None else max_depth
    if max_depth < 1:
        raise ValueError(f"render: max_depth is {max_depth}, want at least 1")
    if sampler not in SAMPLERS:
        raise ValueError(f"render: unknown sampler {sampler!r}{nearest(sampler, SAMPLERS)}")
    devices = tuple(jax.devices() if devices is None else devices)
    tile = tile or (CPU_TILE if devices[0].platform == "cpu" else WIDE_TILE)
    run = Run(seed_from_key(key), jnp.int32(first), jnp.int32(first) + jnp.int32(count), jnp.int32(spp))
    # The defaults are spent: scenes that differ in them alone share a program
    return replace(scene, defaults=RenderDefaults()), run, Plan(max_depth, sampler, unroll, tile, devices)


@partial(jax.jit, static_argnames="plan")
def draw_sum(scene: Scene, run: Run, plan: Plan) -> Array:
    """Return the sum of samples: packets dealt to devices in turn, one native loop on each."""
    width, height = scene.camera.width, scene.camera.height
    columns, rows = -(-width // plan.tile[0]), -(-height // plan.tile[1])
    n = len(plan.devices)
    # Deal packets like cards: neighbours cost alike, so every device gets its share of the dear ones
    share = -(-columns * rows // n)
    packets = jnp.arange(share * n, dtype=jnp.int32).reshape(share, n).T
    operands = tables_of(scene), run

    def on_device(operands: tuple[Tables, Run], packets: Array) -> Array:
        native = plan.tile[0] * plan.tile[1] <= NATIVE_LANES
        return map_packets(partial(_packet_sum, plan, columns), operands, packets[0], native)[None]

    if n > 1:
        mesh = Mesh(plan.devices, ("packets",))
        spread, everywhere = PartitionSpec("packets"), PartitionSpec()
        # Unchecked: the check wants every loop's start value marked as differing between devices
        shares = jax.shard_map(on_device, mesh=mesh, in_specs=(everywhere, spread), out_specs=spread, check_vma=False)
        sums = shares(operands, packets)
    else:
        sums = on_device(operands, packets)
    # (device, turn, lane, 3) -> rows and columns of tiles -> picture
    sums = jnp.swapaxes(sums, 0, 1).reshape(share * n, plan.tile[1], plan.tile[0], 3)[: columns * rows]
    sums = sums.reshape(rows, columns, plan.tile[1], plan.tile[0], 3).swapaxes(1, 2)
    return sums.reshape(rows * plan.tile[1], columns * plan.tile[0], 3)[:height, :width]


def _packet_sum(plan: Plan, columns: int, operands: tuple[Tables, Run], packet: Array) -> Array:
    """Return the sums (lanes, 3) of the packet's pixels, in row order of its tile."""
    tables, run = operands
    width, height = plan.tile
    lane = jnp.arange(width * height, dtype=jnp.int32)
    x = packet % columns * width + lane % width
    y = packet // columns * height + lane // width

    def add_sample(sample: Array, sums: tuple[Array, Array]) -> tuple[Array, Array]:
        one = partial(_sample, plan, tables, run, sample)
        return kahan_add(*sums, jax.vmap(one)(x, y))

    nothing = jnp.zeros((width * height, 3), tables.camera.position.dtype)
    return lax.fori_loop(run.first, run.end, add_sample, (nothing, nothing))[0]


def _sample(plan: Plan, tables: Tables, run: Run, sample: Array, x: Array, y: Array) -> Array:
    """Return the radiance (3,) of one sample of pixel (x, y), column and row."""
    dtype = tables.camera.position.dtype
    pixel = y.astype(jnp.uint32) * jnp.uint32(tables.camera.width) + x.astype(jnp.uint32)
    stream = Stream(pixel, sample.astype(jnp.uint32), run.seed, run.spp.astype(jnp.uint32))

    def numbers(block: int | Array) -> tuple[Array, Array, Array, Array]:
        a, b, c, d = SAMPLERS[plan.sampler](stream, block)
        return a.astype(dtype), b.astype(dtype), c.astype(dtype), d.astype(dtype)

    jitter = numbers(0)
    ray = camera_ray(tables.camera, x.astype(dtype) + jitter[0], y.astype(dtype) + jitter[1])
    return radiance(tables, ray, numbers, plan.max_depth, plan.unroll)
