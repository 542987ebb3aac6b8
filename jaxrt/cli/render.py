"""`jaxrt render`."""

import argparse
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from jaxrt.chunks import accumulate
from jaxrt.cli import start
from jaxrt.cli.errors import UsageError, refusing
from jaxrt.cli.progress import progress
from jaxrt.cli.start import built, check_output, described, usable_cores, warn
from jaxrt.description import nearest, show
from jaxrt.io.image import save_image
from jaxrt.programs import load_or_compile
from jaxrt.render import Plan, Run, prepare
from jaxrt.samplers import SAMPLERS
from jaxrt.scene import Scene

Image = NDArray[np.float32]


def run(args: argparse.Namespace) -> None:
    output = args.output or Path(f"{args.scene.stem or 'scene'}.png")
    check_output(output)
    description = described(args)
    began = time.perf_counter()
    folder = start.start_jax(args.cores or usable_cores())
    _check_sampler(args.sampler, description.render.spp)
    scene = built(description)
    image, compile_seconds, render_seconds = _draw(scene, args.seed, args.sampler, folder)
    with refusing():
        save_image(output, image, exposure=args.exposure, srgb=args.srgb)
    height, width, _ = image.shape
    spp, depth = description.render.spp, description.render.max_depth
    rate = width * height * spp / render_seconds / 1e6
    print(
        f"{output}: {width}x{height}, {spp} spp, max_depth {depth}, {args.sampler}: compile "
        f"{compile_seconds:.2f} s, render {render_seconds:.2f} s, {rate:.2f} Mpaths/s, "
        f"all {time.perf_counter() - began:.2f} s"
    )


def _check_sampler(name: str, spp: int) -> None:
    if name not in SAMPLERS:
        raise UsageError(f"argument --sampler: unknown sampler {show(name)}{nearest(name, SAMPLERS)}")
    if name == "sobol" and spp & (spp - 1):
        below = 1 << (spp.bit_length() - 1)
        warn(f"spp {spp} is not a power of two: sobol is at its best with {below} or {2 * below}")


def _draw(scene: Scene, seed: int, sampler: str, folder: Path | None) -> tuple[Image, float, float]:
    """Return the picture and the seconds of compiling and of rendering it."""
    spp = scene.defaults.spp

    def arguments(first: int, count: int) -> tuple[Scene, Run, Plan]:
        return prepare(scene, seed, first, count, spp, sampler=sampler)

    with progress(spp) as report:
        # Draw no sample, which compiles all the same
        began = time.perf_counter()
        nothing = arguments(0, 0)
        program = load_or_compile(folder, *nothing)
        compiled = time.perf_counter()
        report(0)
        total = accumulate(lambda first, count: np.asarray(program(*arguments(first, count)[:2])), spp, report)
        done = time.perf_counter()
    return (total / spp).astype(np.float32), compiled - began, done - compiled
