"""From a scene to a picture."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TypedDict, Unpack

import jax
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from jaxrt import boundary
from jaxrt.description import RenderDefaults, nearest
from jaxrt.edges import moving_edges
from jaxrt.film import Plan, Run
from jaxrt.interior import draw, draw_parts
from jaxrt.path import tables_of
from jaxrt.samplers import SAMPLERS, seed_from_key
from jaxrt.scene import Scene

CPU_TILE = (16, 8)  # pixels of a packet on a CPU: its values stay in the first-level cache
WIDE_TILE = (512, 128)  # on accelerators, which want many lanes at once


def use_cpu_cores(n: int) -> None:
    """Let JAX see `n` CPU devices, so that `render` uses as many cores. Must come before JAX computes anything.

    With n > 1, do not `vmap` whole solves: loops side by side that exchange pictures between devices can wait for one
    another for ever (jaxlib 0.10.1). `jax.lax.map` them, or render with `devices=jax.devices()[:1]`.

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
    boundary_samples: int = 0,
    gradient_key: int | Array | None = None,
    gradient_spp: int | None = None,
    unroll: bool = False,
    tile: tuple[int, int] | None = None,
    devices: Sequence[jax.Device] | None = None,
) -> Array:
    """Return the picture (height, width, 3) in linear radiance, W·sr⁻¹·m⁻²; row 0 is the top.

    key: an int or a `jax.random.key`. spp: samples per pixel; max_depth: scattering events along a path; both default
    to the scene's own. sampler: "sobol", "stratified" or "independent". unroll: compile each event apart, instead of
    one event in a loop. tile: width and height of a packet in pixels. devices: those to use, by default all of JAX's
    default backend. The number of devices does not change the picture, tile and unroll may by 1e-6 (CONVENTIONS, Bits).
    Memory does not grow with spp.

    Pure: works under jit, vmap, jvp, vjp, jacfwd, jacrev and hessian. boundary_samples: 0 gives interior derivatives
    only, which lack what moving visibility edges add; n leaves the picture unchanged to the bit and adds the edge terms
    from n samples, about 4 a pixel (second derivatives then raise ValueError). gradient_key and gradient_spp: the
    random numbers of derivatives and how many samples a pixel they take. By default those of the picture; with another
    key, gradients of losses are unbiased. Raises ValueError for an unknown sampler and for counts out of range.
    """
    spp = _count("spp", scene.defaults.spp if spp is None else spp)
    gradient_spp = _count("gradient_spp", spp if gradient_spp is None else gradient_spp)
    _count("boundary_samples", boundary_samples, least=0)
    options: Options = dict(max_depth=max_depth, sampler=sampler, unroll=unroll, tile=tile, devices=devices)
    gradient_key = key if gradient_key is None else gradient_key
    plain, run, plan = prepare(scene, key, 0, spp, spp, **options)
    gradient_run = prepare(scene, gradient_key, 0, gradient_spp, gradient_spp, **options)[1]
    # XLA divides or multiplies as it likes, which is not the same to the bit: the choice is made here
    picture = draw_sum(plain, run, plan, gradient_run) * (1 / spp)
    if boundary_samples == 0:
        return picture
    edges = boundary.Plan(boundary_samples, plan.max_depth, False, False, plan.devices)
    return picture + moving_edges(plain, gradient_run.seed, edges)


def _count(name: str, value: int, least: int = 1) -> int:
    if value < least:
        raise ValueError(f"render: {name} is {value}, want at least {least}")
    return value


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
    max_depth = _count("max_depth", scene.defaults.max_depth if max_depth is None else max_depth)
    if sampler not in SAMPLERS:
        raise ValueError(f"render: unknown sampler {sampler!r}{nearest(sampler, SAMPLERS)}")
    devices = tuple(jax.devices() if devices is None else devices)
    tile = tile or (CPU_TILE if devices[0].platform == "cpu" else WIDE_TILE)
    run = Run(seed_from_key(key), jnp.int32(first), jnp.int32(first) + jnp.int32(count), jnp.int32(spp))
    # The defaults are spent: scenes that differ in them alone share a program
    return replace(scene, defaults=RenderDefaults()), run, Plan(max_depth, sampler, unroll, tile, devices)


@partial(jax.jit, static_argnames="plan")
def draw_sum(scene: Scene, run: Run, plan: Plan, gradient_run: Run | None = None) -> Array:
    """Return the sum of the samples of `run`; derivatives use those of `gradient_run`, by default the same."""
    return draw(tables_of(scene), run, run if gradient_run is None else gradient_run, plan)


@partial(jax.jit, static_argnames="plan")
def sum_parts(scene: Scene, run: Run, plan: Plan) -> Array:
    """Return the sum of the samples of `run` as parts (height, width, 3, 3) along the last axis, without derivative.

    Sums of runs that part between blocks, added exactly and rounded once, are `draw_sum` of all their samples.
    """
    return draw_parts(tables_of(scene), run, plan)
