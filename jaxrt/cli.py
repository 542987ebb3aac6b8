"""The command line: `jaxrt render`, `jaxrt info`, `jaxrt diff`, `jaxrt gradcheck`, `jaxrt fit`."""

import argparse
import gc
import math
import os
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NoReturn

import jax
import numpy as np
from numpy.typing import NDArray

from jaxrt.checks import check_memory
from jaxrt.chunks import CHUNKS, accumulate
from jaxrt.description import SceneDescription, SceneError, SceneWarning, nearest, show
from jaxrt.fit.command import add_arguments, run_fit
from jaxrt.gradcheck import gradcheck, heatmap
from jaxrt.io.image import check_suffix, load_image, save_image
from jaxrt.io.scene_file import read_description
from jaxrt.programs import load_or_compile
from jaxrt.render import Plan, Run, prepare, use_cpu_cores
from jaxrt.samplers import SAMPLERS
from jaxrt.scene import Scene, build
from jaxrt.selectors import parse_selector
from jaxrt.summary import print_summary

CHECK_SIDE = 64  # pixels of the longer side of the pictures that gradients are checked on
CHECK_SPP = 256
RELATIVE_FLOOR = 1e-2  # added to the squared reference in the relative MSE, so that black pixels do not rule it
COUNT_MAX = 2**31 - 1
SEED_MAX = 2**32 - 1

Image = NDArray[np.float32]


class UsageError(ValueError):
    """Arguments that cannot be served: one line with culprit and remedy."""


class _Parser(argparse.ArgumentParser):
    """A parser that refuses in one line."""

    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message}: see {self.prog} --help")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status.

    0: done. 1: a gradient differs from finite differences, or noise leaves it open; a fit is stalled or ambiguous.
    2: bad scene or arguments, told in one line on stderr. 130: interrupted. Only 0, 1 and interrupted fits write files.
    """
    try:
        args = _parser().parse_args(argv)
        return args.run(args) or 0
    except (SceneError, UsageError) as error:
        print(f"jaxrt: error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("jaxrt: interrupted, nothing written", file=sys.stderr)
        return 130


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="jaxrt", description="A differentiable path tracer.", allow_abbrev=False)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    _add_render(commands.add_parser("render", help="render a scene file to a picture", allow_abbrev=False))

    info = commands.add_parser("info", help="tell what is in a scene file", allow_abbrev=False)
    info.add_argument("scene", type=Path, metavar="SCENE", help="scene file (TOML)")
    info.set_defaults(run=_info)

    diff = commands.add_parser("diff", help="compare two pictures", allow_abbrev=False)
    diff.add_argument("a", type=Path, metavar="A", help="picture (.png or .exr)")
    diff.add_argument("b", type=Path, metavar="B", help="the reference")
    diff.add_argument("-o", "--output", type=Path, default=Path("diff.png"), help="error picture (diff.png)")
    diff.add_argument("--srgb", action="store_true", help="PNG holds the sRGB curve, not gamma 2.2")
    diff.set_defaults(run=_diff)

    _add_gradcheck(
        commands.add_parser("gradcheck", help="compare a gradient with finite differences", allow_abbrev=False)
    )
    fit = commands.add_parser("fit", help="recover parameters from a picture", allow_abbrev=False)
    add_arguments(fit, _integer(1, COUNT_MAX), _integer(0, SEED_MAX))
    fit.set_defaults(run=_fit)
    return parser


def _add_render(parser: argparse.ArgumentParser) -> None:
    count, seed = _integer(1, COUNT_MAX), _integer(0, SEED_MAX)
    parser.add_argument("scene", type=Path, metavar="SCENE", help="scene file (TOML)")
    parser.add_argument("-o", "--output", type=Path, help="picture (.png or .exr); SCENE's name with .png")
    parser.add_argument("--spp", type=count, metavar="N", help="samples per pixel")
    parser.add_argument("--max-depth", type=count, metavar="D", help="scattering events along a path")
    parser.add_argument("--width", type=count, metavar="W", help="columns")
    parser.add_argument("--height", type=count, metavar="H", help="rows")
    parser.add_argument("--seed", type=seed, default=0, metavar="S", help="of the random numbers (0)")
    parser.add_argument("--sampler", default="sobol", metavar="NAME", help="sobol, stratified or independent")
    parser.add_argument("--cores", type=count, metavar="N", help="CPU cores (all)")
    parser.add_argument("--exposure", type=_real, default=0.0, metavar="EV", help="brighten by 2**EV (0)")
    parser.add_argument("--srgb", action="store_true", help="write PNG by the sRGB curve, not gamma 2.2")
    parser.set_defaults(run=_render)


def _add_gradcheck(parser: argparse.ArgumentParser) -> None:
    count, seed = _integer(1, COUNT_MAX), _integer(0, SEED_MAX)
    parser.add_argument("scene", type=Path, metavar="SCENE", help="scene file (TOML)")
    parser.add_argument("parameter", metavar="NAME[ROW]", help="such as lights.position[0] or materials.albedo[white]")
    parser.add_argument("-o", "--output", type=Path, help="picture: finite differences | interior only | with edges")
    parser.add_argument("--spp", type=count, metavar="N", help=f"samples per pixel ({CHECK_SPP})")
    parser.add_argument("--max-depth", type=count, metavar="D", help="scattering events along a path")
    parser.add_argument("--width", type=count, metavar="W", help=f"columns (the longer side has {CHECK_SIDE} pixels)")
    parser.add_argument("--height", type=count, metavar="H", help="rows")
    parser.add_argument("--boundary-samples", type=_integer(0, COUNT_MAX), metavar="N", help="on edges (4 a pixel)")
    parser.add_argument("--component", type=_integer(0, 2), metavar="I", help="of a vector: 0, 1 or 2 (all)")
    parser.add_argument("--step", type=float, metavar="H", help="of the finer difference (about 1 %% of what matters)")
    parser.add_argument("--seeds", type=_integer(2, COUNT_MAX), default=8, metavar="N", help="for error bars (8)")
    parser.add_argument("--seed", type=seed, default=0, metavar="S", help="of the random numbers (0)")
    parser.add_argument("--cores", type=count, metavar="N", help="CPU cores (all)")
    parser.set_defaults(run=_gradcheck)


def _integer(low: int, high: int) -> Callable[[str], int]:
    def convert(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{show(text)} is not a whole number") from None
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{value} is out of range, use {low} to {high}")
        return value

    return convert


def _real(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{show(text)} is not a number") from None
    if not abs(value) <= 100:
        raise argparse.ArgumentTypeError(f"{text} is out of range, use -100 to 100 stops")
    return value


@contextmanager
def _refusing() -> Iterator[None]:
    """Turn what the file layer raises into one line."""
    try:
        yield
    except SceneError:
        raise
    except OSError as error:
        culprit = f"{error.filename}: {error.strerror}" if error.strerror else str(error)
        raise UsageError(f"{culprit}: choose another file") from None
    except ValueError as error:
        raise UsageError(str(error)) from None


def _check_output(path: Path) -> None:
    """Refuse an output that could not be written, before any work."""
    with _refusing():
        check_suffix(path)
    if path.is_dir():
        raise UsageError(f"{path}: is a folder: name a file in it")
    if not path.parent.is_dir():
        raise UsageError(f"{path}: the folder {show(str(path.parent))} does not exist: make it first")
    if not os.access(path.parent, os.W_OK):
        raise UsageError(f"{path}: the folder {show(str(path.parent))} is not writable: choose another")


def _render(args: argparse.Namespace) -> None:
    output = args.output or Path(args.scene.with_suffix(".png").name)
    _check_output(output)
    description = _described(args)
    start = time.perf_counter()
    folder = _start_jax(args.cores or _usable_cores())
    _check_sampler(args.sampler, description.render.spp)
    scene = _build(description)
    image, compile_seconds, render_seconds = _draw(scene, args.seed, args.sampler, folder)
    with _refusing():
        save_image(output, image, exposure=args.exposure, srgb=args.srgb)
    height, width, _ = image.shape
    spp, depth = description.render.spp, description.render.max_depth
    rate = width * height * spp / render_seconds / 1e6
    print(
        f"{output}: {width}x{height}, {spp} spp, max_depth {depth}, {args.sampler}: compile "
        f"{compile_seconds:.2f} s, render {render_seconds:.2f} s, {rate:.2f} Mpaths/s, "
        f"all {time.perf_counter() - start:.2f} s"
    )


def _described(args: argparse.Namespace) -> SceneDescription:
    """Return the scene's description, with what the arguments override."""
    description = read_description(args.scene)
    size = {k: v for k in ("width", "height") if (v := getattr(args, k)) is not None}
    drawn = {k: v for k in ("spp", "max_depth") if (v := getattr(args, k)) is not None}
    camera = description.camera.model_copy(update=size)
    check_memory(camera.width, camera.height, str(args.scene))
    render = description.render.model_copy(update=drawn)
    return description.model_copy(update={"camera": camera, "render": render})


def _usable_cores() -> int:
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1


def _start_jax(cores: int) -> Path | None:
    """Give JAX the cores, and return the folder that keeps compiled programs between runs, if it can be written."""
    use_cpu_cores(cores)
    # Tracing makes many objects that live as long as this short process: collecting them costs a tenth of the start
    gc.disable()
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "jaxrt"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    if not os.access(folder, os.W_OK):
        return None
    # The small programs around the large one
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        jax.config.update("jax_compilation_cache_dir", str(folder))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    return folder


def _check_sampler(name: str, spp: int) -> None:
    if name not in SAMPLERS:
        raise UsageError(f"argument --sampler: unknown sampler {show(name)}{nearest(name, SAMPLERS)}")
    if name == "sobol" and spp & (spp - 1):
        below = 1 << (spp.bit_length() - 1)
        _warn(f"spp {spp} is not a power of two: sobol is at its best with {below} or {2 * below}")


def _warn(message: object) -> None:
    print(f"jaxrt: warning: {message}", file=sys.stderr)


def _build(description: SceneDescription, warn: Callable[[object], None] = _warn) -> Scene:
    """Return the scene, handing its warnings to `warn`."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", SceneWarning)
        scene = build(description)
    for warning in caught:
        warn(warning.message)
    return scene


def _draw(scene: Scene, seed: int, sampler: str, folder: Path | None) -> tuple[Image, float, float]:
    """Return the picture and the seconds of compiling and of rendering it."""
    spp = scene.defaults.spp

    def arguments(first: int, count: int) -> tuple[Scene, Run, Plan]:
        return prepare(scene, seed, first, count, spp, sampler=sampler)

    with _progress(spp) as report:
        # Draw no sample, which compiles all the same
        start = time.perf_counter()
        nothing = arguments(0, 0)
        program = load_or_compile(folder, *nothing)
        compiled = time.perf_counter()
        report(0)
        total = accumulate(lambda first, count: np.asarray(program(*arguments(first, count)[:2])), spp, report)
        done = time.perf_counter()
    return (total / spp).astype(np.float32), compiled - start, done - compiled


def _gradcheck(args: argparse.Namespace) -> int:
    if args.output is not None:
        _check_output(args.output)
    if args.width is None and args.height is None:
        args.width, args.height = _check_size(args.scene)
    args.spp = args.spp or CHECK_SPP
    description = _described(args)
    _start_jax(args.cores or _usable_cores())
    scene = _build(description)
    name, row = parse_selector(args.parameter, scene, description)
    options = {k: getattr(args, k) for k in ("component", "boundary_samples", "step", "seeds")}
    with ExitStack() as stack:
        report: Callable[[int], None] | None = None

        def progress(done: int, total: int) -> None:
            nonlocal report
            report = report or stack.enter_context(_progress(total, "draws"))
            report(done)

        with _refusing():
            found = gradcheck(scene, name, args.seed, row=row, progress=progress, **options)
    if args.output is not None:
        with _refusing():
            save_image(args.output, heatmap(found.components))
    print(found)
    return 0 if found.verdict == "agrees" else 1


def _fit(args: argparse.Namespace) -> int:
    _start_jax(args.cores or _usable_cores())
    with _refusing():
        return run_fit(args)


def _check_size(path: Path) -> tuple[int, int]:
    """Return width and height of the scene's picture, made small."""
    camera = read_description(path).camera
    share = min(1, CHECK_SIDE / max(camera.width, camera.height))
    return max(1, round(camera.width * share)), max(1, round(camera.height * share))


@contextmanager
def _progress(count: int, unit: str = "spp") -> Iterator[Callable[[int], None]]:
    """Yield a function to call with the units done: a bar on a terminal, lines elsewhere, on stderr."""
    if not sys.stderr.isatty():
        yield _lines(count, unit)
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("compiling", total=count)

        def update(done: int) -> None:
            # Forget the time of compiling, or the time left would count it
            if done == 0:
                bar.reset(task, description="rendering")
            bar.update(task, completed=done)

        yield update


def _lines(count: int, unit: str) -> Callable[[int], None]:
    """Return a function that prints a line for each twentieth of the count; 0 starts its clock."""
    start, told = time.perf_counter(), 0

    def report(done: int) -> None:
        nonlocal start, told
        if done == 0:
            start = time.perf_counter()
        elif done * CHUNKS // count > told:
            told = done * CHUNKS // count
            left = (time.perf_counter() - start) * (count - done) / done
            print(f"jaxrt: {done}/{count} {unit}, {left:.1f} s left", file=sys.stderr, flush=True)

    return report


def _info(args: argparse.Namespace) -> None:
    description = read_description(args.scene)
    check_memory(description.camera.width, description.camera.height, str(args.scene))
    messages: list[object] = []
    scene = _build(description, messages.append)
    print_summary(str(args.scene), description, scene, [str(message) for message in messages])


def _diff(args: argparse.Namespace) -> None:
    _check_output(args.output)
    with _refusing():
        a, b = (load_image(path, srgb=args.srgb).astype(np.float64) for path in (args.a, args.b))
    if a.shape != b.shape:
        sizes = " and ".join(f"{image.shape[1]}x{image.shape[0]}" for image in (a, b))
        raise UsageError(f"{args.a}, {args.b}: sizes differ, {sizes}: render both in one size")
    error = np.abs(a - b)
    worst = float(error.max())
    i, j, _ = np.unravel_index(error.argmax(), error.shape)
    with _refusing():
        save_image(args.output, error / worst if worst > 0 else error)
    print(f"RMSE          {math.sqrt(np.mean(error**2)):.6g}")
    print(f"relative MSE  {np.mean(error**2 / (b**2 + RELATIVE_FLOOR)):.6g}")
    print(f"max error     {worst:.6g} at column {j}, row {i}")
    print(f"error picture {args.output}, |A - B|, white = {worst:.6g}")
