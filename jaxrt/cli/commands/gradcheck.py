"""`jaxrt gradcheck`."""

import argparse
from collections.abc import Callable
from contextlib import ExitStack

from jaxrt.cli import start
from jaxrt.cli.errors import refusing
from jaxrt.cli.progress import progress
from jaxrt.cli.start import built, check_output, described, present
from jaxrt.gradcheck import gradcheck, heatmap
from jaxrt.io.image import save_image
from jaxrt.io.scene_file import read_description
from jaxrt.scene.selectors import parse_selector

CHECK_SIDE = 64  # pixels of the longer side of the pictures that gradients are checked on
CHECK_SPP = 256


def run(args: argparse.Namespace) -> int:
    """Print how a derivative compares with finite differences, and return the exit status."""
    if args.output is not None:
        check_output(args.output)
    if args.width is None and args.height is None:
        args.width, args.height = _check_size(args)
    args.spp = args.spp or CHECK_SPP
    description = described(args)
    start.start_jax(present(args.cores))
    scene = built(description)
    name, row = parse_selector(args.parameter, scene)
    options = {k: getattr(args, k) for k in ("component", "boundary_samples", "step", "seeds")}
    with ExitStack() as stack:
        report: Callable[[int], None] | None = None

        def tell(done: int, total: int) -> None:
            nonlocal report
            report = report or stack.enter_context(progress(total, "draws"))
            report(done)

        with refusing():
            found = gradcheck(scene, name, args.seed, row=row, progress=tell, **options)
    if args.output is not None:
        with refusing():
            save_image(args.output, heatmap(found.components))
    print(found)
    return 0 if found.verdict == "agrees" else 1


def _check_size(args: argparse.Namespace) -> tuple[int, int]:
    """Return width and height of the scene's picture, made small."""
    camera = read_description(args.scene, args.allow_folder).camera
    share = min(1, CHECK_SIDE / max(camera.width, camera.height))
    return max(1, round(camera.width * share)), max(1, round(camera.height * share))
