"""What is measured for each chart of pictures."""

import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental.compilation_cache import compilation_cache
from rich.progress import Progress

import jaxrt
from benchmarks.alternatives.chance import draw_sum_by_chance
from benchmarks.chart import closed, subjects
from benchmarks.chart.curves import Curves
from benchmarks.chart.measure import Sweep, measure, relative_to_mean
from benchmarks.chart.peer import Peer, best_sampler
from benchmarks.chart.references import cached, content_key, mean_image
from benchmarks.chart.subjects import Draw, Subject, in_float64, jaxrt_method, picture_method, prefix_method
from benchmarks.samplers import Reference

DEEP = 12  # events of the reference of the chart of depths


class Methods(NamedTuple):
    """Which of jaxrt's methods the charts compare: each is a program to compile."""

    samplers: tuple[str, ...] = ("sobol", "stratified", "independent")
    heavy_samplers: tuple[str, ...] = ("sobol", "stratified", "independent")  # in scenes that take ten times as long
    depths: tuple[int, ...] = (1, 2, 3, 4, 5, 6, 7, 8)
    edges: tuple[int, ...] = (1024, 4096, 16384, 65536)  # samples of moving edges
    steps: tuple[float, ...] = (0.1, 0.01)  # of finite differences, scene units
    panels: int = 6  # scenes of the chart of moving edges
    fd_spp: int | None = None  # of its finite differences; None: what benchmarks.edges takes
    fd_keys: int = 8  # and how often, at most


@dataclass(frozen=True)
class Settings:
    """How much is measured, and with what."""

    sweep: Sweep
    reference: tuple[int, int]  # samples a pixel and seeds of a long render
    heavy_reference: tuple[int, int]  # for scenes that take ten times as long
    quadrature: int  # midpoints across a pixel
    methods: Methods
    cache: Path
    progress: Progress
    peer: Peer | None = None


@dataclass
class Study:
    """A chart's data."""

    curves: Curves
    band: float  # relative standard error of the reference
    facts: dict[str, Any] = field(default_factory=dict)  # numbers that the page tells


def long_render(subject: Subject, settings: Settings, size: tuple[int, int], max_depth: int | None = None) -> Reference:
    """Return the cached mean of Sobol' pictures of `size` (samples a pixel, seeds)."""
    (spp, seeds), depth = size, max_depth or subject.scene().defaults.max_depth
    names = {"kind": "picture", "size": subject.size, "spp": spp, "seeds": seeds, "max_depth": depth}

    def make() -> Reference:
        draw = picture_method(subject.scene(), max_depth=depth)
        track = partial(settings.progress.track, description=f"reference: {subject.title}")
        steps = iter(track(range(seeds)))

        def image(seed: int) -> np.ndarray:
            next(steps)
            return draw(seed, [spp])[spp][0]

        return mean_image(image, seeds)

    return cached(settings.cache, content_key(subject.contents(), names), make)


def samplers(settings: Settings, subject: Subject, heavy: bool = False) -> Study:
    """Return jaxrt's samplers, and Mitsuba's independent and best one, on one scene."""
    reference = long_render(subject, settings, settings.heavy_reference if heavy else settings.reference)
    metric = relative_to_mean(reference)
    scene = subject.scene()
    names = settings.methods.heavy_samplers if heavy else settings.methods.samplers
    methods: dict[str, Draw] = {name: jaxrt_method(scene, name) for name in names}
    facts: dict[str, Any] = {}
    sweep = settings.sweep.up_to(1024)._replace(seeds=min(settings.sweep.seeds, 8)) if heavy else settings.sweep
    if settings.peer:
        best, costs = best_sampler(settings.peer, subject, reference.image, sweep.short[-1], 3)
        facts = {"best": best, "costs": costs}
        for name in ("independent", best):
            methods[f"Mitsuba {name}"] = settings.peer.method(subject, name)
    (curves,) = measure(methods, sweep, [metric], settings.progress)
    return Study(curves, np.sqrt(reference.variance) / metric.scale, facts)


def light_sampling(settings: Settings) -> Study:
    """Return light sampling on and off in the room with a spherical light."""
    reference = long_render(subjects.SPHERE, settings, settings.reference)
    metric, scene = relative_to_mean(reference), subjects.SPHERE.scene()
    chance = prefix_method(scene, program=draw_sum_by_chance)
    methods = {"light sampling": jaxrt_method(scene), "paths that find the light by chance": chance}
    (curves,) = measure(methods, settings.sweep, [metric], settings.progress)
    return Study(curves, np.sqrt(reference.variance) / metric.scale)


def depth(settings: Settings) -> Study:
    """Return depths from 1 on against the picture of a greater one, and the share of light that each leaves out."""
    spp, seeds = settings.reference
    reference = long_render(subjects.SPHERE, settings, (max(spp // 4, 1), seeds), DEEP)
    metric, scene = relative_to_mean(reference), subjects.SPHERE.scene()
    depths = settings.methods.depths
    methods = {f"max_depth {d}": jaxrt_method(scene, max_depth=d) for d in depths}
    sweep = settings.sweep.up_to(1024)._replace(seeds=settings.sweep.few)
    (curves,) = measure(methods, sweep, [metric], settings.progress)
    facts = {"floors": _floors(scene, depths, metric.scale, sweep.short[-1], sweep.few), "deep": DEEP}
    return Study(curves, np.sqrt(reference.variance) / metric.scale, facts)


def _floors(scene: jaxrt.Scene, depths: tuple[int, ...], scale: float, spp: int, seeds: int) -> dict[str, float]:
    """Return the RMS of what is cut off at each depth, over `scale`.

    Pictures of all depths are drawn with the same numbers, so that noise is left in nothing but the light cut off; its
    variance is subtracted.
    """
    draws = {d: picture_method(scene, max_depth=d) for d in (*depths, DEEP)}
    cut: dict[int, list[np.ndarray]] = {d: [] for d in depths}
    for seed in range(2000, 2000 + seeds):
        deep = draws[DEEP](seed, [spp])[spp][0]
        for d in depths:
            cut[d].append(deep - draws[d](seed, [spp])[spp][0])
    floors = {}
    for d, pictures in cut.items():
        stack = np.stack(pictures)
        square = (stack.mean(axis=0) ** 2).mean() - stack.var(axis=0, ddof=1).mean() / seeds
        floors[f"max_depth {d}"] = float(np.sqrt(max(square, 0)) / scale)
    return floors


def precision(settings: Settings, in_room: bool) -> Study:
    """Return float32 and float64 in the room with a spherical light, or on the floor of a closed form."""
    reference = long_render(subjects.SPHERE, settings, settings.reference) if in_room else closed.floor_picture()
    metric, max_depth = relative_to_mean(reference), None if in_room else 1
    with jax.enable_x64(True):
        wide = subjects.SPHERE.scene(jnp.float64) if in_room else jaxrt.build(closed.FLOOR, jnp.float64)
    narrow = subjects.SPHERE.scene() if in_room else jaxrt.build(closed.FLOOR)
    methods = {
        "float32": jaxrt_method(narrow, max_depth=max_depth),
        "float64": in_float64(jaxrt_method(wide, max_depth=max_depth)),
    }
    sweep = settings.sweep.up_to(1024) if in_room else settings.sweep
    (curves,) = measure(methods, sweep, [metric], settings.progress)
    return Study(curves, np.sqrt(reference.variance) / metric.scale)


def unroll(settings: Settings) -> Study:
    """Return events in a scan and unrolled, and what compiling each takes."""
    reference = long_render(subjects.SPHERE, settings, settings.reference)
    metric, scene = relative_to_mean(reference), subjects.SPHERE.scene()
    names = {"events in a scan": False, "events unrolled": True}
    facts = {"compile": {name: _compile_seconds(scene, unrolled) for name, unrolled in names.items()}}
    methods = {name: jaxrt_method(scene, unroll=unrolled) for name, unrolled in names.items()}
    (curves,) = measure(methods, settings.sweep.up_to(256), [metric], settings.progress)
    return Study(curves, np.sqrt(reference.variance) / metric.scale, facts)


@contextmanager
def nothing_kept() -> Iterator[None]:
    """Compile anew whatever is compiled, without JAX's cache of programs."""
    folder = jax.config.values["jax_compilation_cache_dir"]
    jax.clear_caches()
    with tempfile.TemporaryDirectory() as empty:
        _keep_programs_in(empty)
        yield
        _keep_programs_in(folder)


def _keep_programs_in(folder: str | None) -> None:
    """Set the folder of JAX's cache, also where it has been read from."""
    jax.config.update("jax_compilation_cache_dir", folder)
    compilation_cache.reset_cache()


def _compile_seconds(scene: jaxrt.Scene, unrolled: bool) -> float:
    """Return CPU seconds to trace and compile the picture's program."""
    with nothing_kept():
        start = time.process_time()
        jaxrt.render(scene, 0, spp=1, unroll=unrolled).block_until_ready()
        return time.process_time() - start


STUDIES: dict[str, Callable[[Settings], Study]] = {
    "samplers-point-light": partial(samplers, subject=subjects.POINT),
    "samplers-sphere-light": partial(samplers, subject=subjects.SPHERE),
    "samplers-mirror-and-glass": partial(samplers, subject=subjects.GLASS),
    "samplers-mesh": partial(samplers, subject=subjects.MESH, heavy=True),
    "light-sampling": light_sampling,
    "depth": depth,
    "precision-floor": partial(precision, in_room=False),
    "precision-room": partial(precision, in_room=True),
    "unroll": unroll,
}
