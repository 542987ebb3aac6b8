"""From a scene to a picture."""

import os
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TypedDict, Unpack, overload

import jax
import jax.numpy as jnp
from jax import Array, lax
from jax.typing import ArrayLike

from jaxrt import boundary
from jaxrt.boundary.tangent import moving_edges
from jaxrt.core.counts import whole_number
from jaxrt.core.messages import nearest, show
from jaxrt.core.samplers import SAMPLERS, seed_from_key
from jaxrt.core.system import usable_cores
from jaxrt.filters import Filter, filter_of
from jaxrt.kernels.native import as_operand, default_devices, everywhere, local, want_wide
from jaxrt.scene import Scene, check_scene, drawn
from jaxrt.scene.checks import check_memory
from jaxrt.shapes.uv import with_places
from jaxrt.transport.film import Plan, Run, draw_numbers
from jaxrt.transport.interior import draw
from jaxrt.transport.outputs import Output
from jaxrt.transport.path import Tables, tables_of
from jaxrt.views import Window, answers, asked_for, cut, viewed

CPU_TILE = (16, 8)  # pixels of a packet on a CPU: its values stay in the first-level cache
THREADS = 8  # of XLA's pool, for each CPU device
WIDE = 512  # pixels of a packet's sides, at most, on accelerators, which want many lanes at once
LEVEL = "xla_backend_optimization_level"


def use_cpu_cores(n: int | None = None) -> None:
    """Let JAX see `n` CPU devices, so that `render` uses as many cores: by default all that this process may run on.

    Those are what affinity and control groups leave of the machine's. Must come before JAX computes anything. Programs
    are then compiled at LLVM's second level instead of the third, unless `XLA_FLAGS` names one: they run faster.

    With n > 1, do not `vmap` whole solves: loops side by side that exchange pictures between devices can wait for one
    another for ever (jaxlib 0.10.1). `jax.lax.map` them, or render with `devices=jax.devices()[:1]`.

    Raises ValueError for what is no number from 1 on, and RuntimeError where JAX has started already.
    """
    if n is not None and (isinstance(n, bool) or not isinstance(n, int) or n < 1):
        raise ValueError(f"use_cpu_cores: n is {show(n)}: pass a whole number from 1 on, or none for all cores")
    n = usable_cores() if n is None else n
    # Where devices exchange results, each blocks a thread of XLA's one pool until the others come: were there no more
    # threads than cores, all could wait for one another for ever (seen in loops of steps, jaxlib 0.10.1)
    if n > 1:
        os.environ.setdefault("NPROC", str(THREADS * n))
    try:
        jax.config.update("jax_num_cpu_devices", n)
    except RuntimeError:
        raise RuntimeError("use_cpu_cores: JAX has started already: call it before anything is computed") from None
    # The third level moves a condition that is the same for a vector's three coordinates out of the loop over them; the
    # loop around it, over many vectors, then runs one by one: pictures take up to 1.3 times as long
    flags = os.environ.get("XLA_FLAGS", "")
    if LEVEL not in flags:
        os.environ["XLA_FLAGS"] = f"{flags} --{LEVEL}=2".strip()


class Options(TypedDict, total=False):
    """How to render, besides what; see `render`."""

    max_depth: int | None
    sampler: str
    unroll: bool
    tile: tuple[int, int] | None
    devices: Sequence[jax.Device] | None
    window: Window | None
    pixels: ArrayLike | None
    filter: str | None
    filter_width: float | None


class Drawing(Options, total=False):
    """What else `render` takes, but `outputs`."""

    spp: int | None
    width: int | None
    height: int | None
    boundary_samples: int
    gradient_key: int | Array | None
    gradient_spp: int | None
    samples: tuple[int | Array, int] | None


@overload
def render(scene: Scene, key: int | Array, *, outputs: None = None, **options: Unpack[Drawing]) -> Array:
    """Return the picture (height, width, 3)."""


@overload
def render(scene: Scene, key: int | Array, *, outputs: Sequence[str], **options: Unpack[Drawing]) -> dict[str, Array]:
    """Return what is asked for instead, by name."""


def render(
    scene: Scene,
    key: int | Array,
    *,
    spp: int | None = None,
    max_depth: int | None = None,
    width: int | None = None,
    height: int | None = None,
    sampler: str = "sobol",
    boundary_samples: int = 0,
    gradient_key: int | Array | None = None,
    gradient_spp: int | None = None,
    samples: tuple[int | Array, int] | None = None,
    unroll: bool = False,
    tile: tuple[int, int] | None = None,
    devices: Sequence[jax.Device] | None = None,
    window: Window | None = None,
    pixels: ArrayLike | None = None,
    filter: str | None = None,
    filter_width: float | None = None,
    outputs: Sequence[str] | None = None,
) -> Array | dict[str, Array]:
    """Return the picture (height, width, 3) in linear radiance, W·sr⁻¹·m⁻²; row 0 is the top.

    key: an int or a `jax.random.key`. spp: samples per pixel; max_depth: scattering events along a path; width, height:
    columns and rows, another size being another program; all default to the scene's own. sampler: "sobol", "stratified"
    or "independent". unroll: compile each event apart, instead of one event in a loop. tile: width and height of a
    packet in pixels, by default 16 and 8 on a CPU, up to 512 each elsewhere. devices: those to use, by default all of
    JAX's default backend, or those on which the scene was put; under jit, one device alone is where the arguments are.
    The number of CPU devices does not change the picture; that of others, tile and unroll may by 1e-6 (CONVENTIONS,
    Bits). Memory does not grow with spp.

    outputs: names of what to return instead, in a dict; who does not ask pays nothing. "radiance" is the picture,
    "foreground" that without the sky that the camera itself sees, "sky" the rest of it, (height, width, 3). "alpha" is
    the share of a pixel that shows anything, "mask[NAME]" the share that shows a sphere, light, mesh or material so
    called, and "depth" the distance from where the ray starts, (height, width). "position", "albedo" and the shading
    "normal", on the side of the camera, are (height, width, 3), "uv" is (height, width, 2). All these are means over a
    pixel, in which what shows nothing counts as 0. "shape" and "material", int32, are the numbers in the scene file of
    what the middle of a pixel shows, −1 for nothing. docs/outputs.md tells more.

    window: (x0, y0, w, h) draws w columns from x0 on and h rows from y0 on of the whole picture, to the bit what that
    has there where x0 and y0 are multiples of the tile, else to 1e-6. pixels: columns and rows (n, 2) of what is to be
    drawn alone: (n, 3). Windows of one size, and lists of one length, share a program; x0, y0, pixels may be traced.

    samples: (first, n) draws only the spp samples from `first` on of a picture of n. Pictures of one key whose samples
    are 0 … n − 1 together have that picture's mean, whose noise is far below that of as many keys; `first` may be
    traced, as that of the next step of a descent.

    filter: "box", a pixel's own square, "gaussian" or "blackman-harris", whose samples lie about a pixel's middle as
    the filter weighs them; filter_width: pixels from end to end, 3 by default. Both default to the scene's.

    Pure: works under jit, vmap, jvp, vjp, jacfwd, jacrev and hessian. boundary_samples: 0 gives interior derivatives
    only, which lack what moving visibility edges add; n leaves the picture unchanged to the bit and adds the edge terms
    from n samples, about 4 a pixel (second derivatives then raise ValueError). gradient_key and gradient_spp: the
    random numbers of derivatives and how many samples a pixel they take. By default those of the picture; with another
    key, gradients of losses are unbiased. Raises NoSceneError (a TypeError) for what is no scene, and ValueError
    for an unknown sampler, for counts that are out of range or traced, and (SceneError) for a size that memory is too
    small for.

    The edge terms are those of shadows and caustics, of outlines that the camera or a diffuse surface sees, of curves
    where surfaces cross as the camera sees them, and of what it sees in mirrors and through glass. They lack crossings,
    mirrors and glass as diffuse surfaces see them, and lights sunk into surfaces (docs/derivatives.md lists all).
    `gradcheck` names which of these a scene and a parameter lack.
    """
    check_scene(scene)
    scene = _sized(scene, width, height)
    spp = _count("spp", scene.defaults.spp if spp is None else spp)
    gradient_spp = _count("gradient_spp", spp if gradient_spp is None else gradient_spp)
    _count("boundary_samples", boundary_samples, least=0)
    options: Options = dict(max_depth=max_depth, sampler=sampler, unroll=unroll, tile=tile, devices=devices)
    options |= dict(window=window, pixels=pixels, filter=filter, filter_width=filter_width)
    gradient_key = key if gradient_key is None else gradient_key
    first, of = (0, None) if samples is None else _samples(samples, max(spp, gradient_spp))

    def drawn_as(outputs: tuple[Output, ...]) -> Array:
        plain, run, plan = prepare(scene, key, first, spp, of or spp, outputs=outputs, **options)
        gradient_run = prepare(scene, gradient_key, first, gradient_spp, of or gradient_spp, **options)[1]
        # XLA divides or multiplies as it likes, which is not the same to the bit: the choice is made here
        picture = draw_sum(plain, run, plan, gradient_run) * (1 / spp)
        if boundary_samples:
            edges = boundary.Plan(boundary_samples, plan.max_depth, False, False, plan.devices, outputs, plan.filter)
            picture = picture + cut(moving_edges(plain, gradient_run.seed, edges), run, plan)
        return picture if pixels is None else picture[0]

    if outputs is None:
        return drawn_as(())
    asked = asked_for(scene, outputs)
    light = drawn_as(()) if asked.light else None
    others = drawn_as(tuple(asked.outputs.values())) if asked.outputs else None
    numbers = None
    if asked.numbers:
        numbers = numbers_of(*prepare(scene, key, 0, 1, 1, **options))
        numbers = numbers if pixels is None else numbers[0]
    return answers(scene, asked, light, others, numbers)


def _sized(scene: Scene, width: int | None, height: int | None) -> Scene:
    """Return the scene with as many columns and rows as are asked for."""
    if width is None and height is None:
        return scene
    columns = _count("width", scene.camera.width if width is None else width)
    rows = _count("height", scene.camera.height if height is None else height)
    check_memory(columns, rows, "render")
    return replace(scene, camera=replace(scene.camera, width=columns, height=rows))


def _samples(samples: tuple[int | Array, int], spp: int) -> tuple[int | Array, int]:
    """Return the number of the first sample, modulo that of all, and that."""
    if not isinstance(samples, tuple | list) or len(samples) != 2:
        raise ValueError(
            f"render: samples is {show(samples)}: pass the first and how many there are in all, as (0, 256)"
        )
    of = _count("samples", samples[1])
    first = samples[0] % of
    if isinstance(first, int) and first + spp > of:
        raise ValueError(f"render: samples is {show(samples)} and spp {spp}: there are not so many from {first} on")
    return first, of


def _count(name: str, value: int, least: int = 1) -> int:
    if isinstance(value, jax.core.Tracer):
        raise ValueError(
            f"render: {name} is traced, but the program depends on it: pass a number, or jit over the rest"
        )
    return whole_number(f"render: {name}", value, least)


def render_sum(
    scene: Scene, key: int | Array, first: ArrayLike, count: ArrayLike, *, spp: ArrayLike, **options: Unpack[Options]
) -> Array:
    """Return the sum (height, width, 3) of samples first … first + count − 1 out of `spp` in each pixel.

    Sums of chunks that cover 0 … spp − 1 add up to `spp` times the picture of `render`. `first`, `count` and `spp` may
    change without another compilation. The rest is as for `render`.
    """
    scene, run, plan = prepare(scene, key, first, count, spp, **options)
    total = draw_sum(scene, run, plan)
    return total if run.pixels is None else total[0]


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
    window: Window | None = None,
    pixels: ArrayLike | None = None,
    filter: str | None = None,
    filter_width: float | None = None,
    outputs: tuple[Output, ...] = (),
) -> tuple[Scene, Run, Plan]:
    """Return the arguments of `draw_sum` from those of `render_sum`, checked."""
    check_scene(scene)
    max_depth = _count("max_depth", scene.defaults.max_depth if max_depth is None else max_depth)
    if sampler not in SAMPLERS:
        raise ValueError(f"render: unknown sampler {sampler!r}{nearest(str(sampler), SAMPLERS)}")
    scene, devices = _placed(scene, devices)
    if "uv" in outputs:
        scene = replace(scene, triangles=with_places(scene.triangles))
    run = Run(seed_from_key(key), jnp.int32(first), jnp.int32(first) + jnp.int32(count), jnp.int32(spp))
    # What is met first is the same whatever comes after
    plan = Plan(
        1 if outputs else max_depth,
        sampler,
        unroll,
        _tile(tile) if tile else CPU_TILE,
        devices,
        outputs=outputs,
        filter=_filter(scene, filter, filter_width),
    )
    run, plan = viewed(scene, run, plan, window, pixels)
    if not tile and want_wide(devices):
        hosts = jax.process_count() // len({device.process_index for device in devices})
        width, height = plan.size or (scene.camera.width, scene.camera.height)
        plan = plan._replace(tile=wide_tile(width, height, len(devices) * hosts))
    return drawn(scene), run, plan


def _filter(scene: Scene, name: str | None, width: float | None) -> Filter | None:
    """Return the filter that is asked for, by default the scene's own."""
    own = scene.defaults
    if name is None:
        name, width = own.filter, own.filter_width if width is None else width
    try:
        return filter_of(name, width)
    except ValueError as error:
        raise ValueError(f"render: {error}") from None


def wide_tile(width: int, height: int, devices: int = 1) -> tuple[int, int]:
    """Return columns and rows of packets for accelerators: few, of one size, but one for each where there can be."""
    if height == 1:
        return -(-width // max(-(-width // WIDE**2), devices)), 1
    across = -(-width // WIDE)
    down = max(-(-height // WIDE), -(-devices // across))
    return -(-width // across), -(-height // down)


def _tile(tile: tuple[int, int]) -> tuple[int, int]:
    if len(tile) != 2:
        raise ValueError(f"render: tile is {show(tile)}, want width and height")
    return _count("width of tile", tile[0]), _count("height of tile", tile[1])


def _placed(scene: Scene, devices: Sequence[jax.Device] | None) -> tuple[Scene, tuple[jax.Device, ...]]:
    """Return the scene on the devices that are to draw it, and these: by default those where it was put."""
    scene = local(scene)
    leaves = jax.tree.leaves(scene)
    traced = any(isinstance(leaf, jax.core.Tracer) for leaf in leaves)
    here = {d for x in leaves if isinstance(x, jax.Array) and not traced and x.committed for d in x.devices()}
    wanted = tuple(devices or sorted(here, key=lambda device: device.id) or default_devices())
    if not all(isinstance(device, jax.Device) for device in wanted):
        raise ValueError(f"render: devices is {show(devices)}, want some of jax.devices()")
    # A traced scene is where its arguments are
    if traced or set(wanted) == (here or set(default_devices())):
        return scene, wanted
    return everywhere(scene, wanted), wanted


@partial(jax.jit, static_argnames="plan")
def draw_sum(scene: Scene, run: Run, plan: Plan, gradient_run: Run | None = None) -> Array:
    """Return the sum of the samples of `run`; derivatives use those of `gradient_run`, by default the same."""
    return draw(
        tables_of(as_operand(scene), bool(plan.outputs)), run, run if gradient_run is None else gradient_run, plan
    )


@partial(jax.jit, static_argnames="plan")
def numbers_of(scene: Scene, run: Run, plan: Plan) -> Array:
    """Return primitive and row of its material (height, width, 2) that the middle of each pixel shows, −1 for none."""
    return draw_numbers(tables_of(as_operand(lax.stop_gradient(scene))), run, plan)


@jax.jit
def scene_tables(scene: Scene) -> Tables:
    """Return the scene as the kernel reads it, for `sum_share`: once, however often samples are drawn."""
    return tables_of(scene)
