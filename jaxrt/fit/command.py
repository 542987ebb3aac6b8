"""The command `jaxrt fit`: `jaxrt.fit` with files around it."""

import argparse
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path

from jaxrt.description import SceneDescription, SceneWarning
from jaxrt.fit import Fit, FitError, Step, alike, fit, sought
from jaxrt.fit.answer import numbers
from jaxrt.fit.document import write_scene
from jaxrt.fit.files import (
    Target,
    draw_before_after,
    draw_losses,
    final_report,
    load_target,
    progress_report,
    read_progress,
    write_report,
)
from jaxrt.io.scene_file import read_description
from jaxrt.scene import build
from jaxrt.scene.build import views_of
from jaxrt.scene.checks import check_memory
from jaxrt.scene.parameters import asked

INTERRUPTED = 128  # exit status, with the signal's number


def run_fit(args: argparse.Namespace) -> int:
    """Fit, and write fitted.toml, fit.json, loss.png and before_after.png into the output folder.

    Returns the exit status: 0, 1 for a stalled or ambiguous fit, 128 + n for one that signal n ended.
    Raises SceneError for bad scenes and parameters, ValueError and OSError for a bad target.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("always", SceneWarning)
        warnings.showwarning = lambda message, *_: _say(f"warning: {message}")
        return _run(args)


def _run(args: argparse.Namespace) -> int:
    targets = [load_target(path, args.srgb) for path in args.targets]
    description = _sized(read_description(args.scene, args.allow_folder), targets, args)
    scenes = [asked(scene, args.parameters) for scene in views_of(build(description), description)]
    unknowns = sought(scenes[0], args.parameters)
    _say(*(note for target in targets for note in target.notes))
    folder: Path = args.output
    folder.mkdir(exist_ok=True)
    resume = read_progress(folder / "fit.json", unknowns) if args.resume else None
    selectors = {row.text: row.selector for row in unknowns.rows}

    def report(step: Step) -> None:
        _say(told(step))
        if step.accepted:
            write_scene(args.scene, folder / "fitted.toml", step.values, selectors, description)
        write_report(folder / "fit.json", progress_report(step.values, step.progress, step.lacks))

    if resume is None:
        # What has no place in the file is refused before anything is compiled
        start = unknowns.values(unknowns.vector(scenes[0]))
        write_scene(args.scene, folder / "fitted.toml", start, selectors, description)
    answer = fit(
        scenes, [target.image for target in targets], args.parameters, weight=[target.weight for target in targets],
        spp=args.spp, max_depth=args.max_depth, seed=args.seed, max_steps=args.max_steps, starts=args.starts,
        smoothness=args.smoothness, resume=resume, progress=report,
    )  # fmt: skip
    write_scene(args.scene, folder / "fitted.toml", answer.values, selectors, description)
    write_report(folder / "fit.json", final_report(answer))
    draw_losses(folder / "loss.png", answer.history)
    draw_before_after(folder / "before_after.png", targets, answer.before, answer.after)
    _conclude(folder, answer)
    if answer.interrupted:
        _say("interrupted: the best so far is written, go on with --resume")
        return INTERRUPTED + answer.interrupted
    return 1 if answer.verdict.word in ("stalled", "ambiguous") else 0


def _sized(description: SceneDescription, targets: Sequence[Target], args: argparse.Namespace) -> SceneDescription:
    """Return the description with cameras of the targets' sizes, where these have their shapes; else `fit` refuses.

    Raises FitError where there are more of one than of the other.
    """
    if len(targets) != len(description.views):
        raise FitError(
            f"{args.scene}: cameras: {len(description.views)}, for {len(targets)} pictures: name one picture for each "
            "camera, in the order of [[cameras]]"
        )
    cameras = []
    for camera, target, path in zip(description.views, targets, args.targets, strict=True):
        height, width, _ = target.image.shape
        check_memory(width, height, str(path))
        if (camera.width, camera.height) != (width, height) and alike(camera, width, height):
            _say(f"the scene is drawn in the size of {path}, {width}x{height}")
            camera = camera.model_copy(update={"width": width, "height": height})
        cameras.append(camera)
    return description.model_copy(update={"camera": cameras[0], "cameras": tuple(cameras)})


def told(step: Step) -> str:
    """Return a step in one line: what is new in it, and what is left."""
    left = "" if step.seconds_left is None else f", about {step.seconds_left:.0f} s left"
    if not step.accepted:
        return f"step {step.number}: rejected{left}"
    values = ", ".join(f"{name} {numbers(value)}" for name, value in step.values.items())
    return f"step {step.number}: loss {step.loss:.3e} at {step.spp} spp, {values}{left}"


def _conclude(folder: Path, answer: Fit) -> None:
    """Print values with standard errors, and the verdict."""
    verdict = answer.verdict
    print(
        f"{answer}\n{folder}: {answer.progress.step} steps, loss {verdict.loss:.3g} on fresh seeds, of which "
        f"{verdict.noise_floor:.3g} noise of the rendering; fitted.toml, fit.json, loss.png, before_after.png"
    )


def _say(*lines: str) -> None:
    for line in lines:
        print(f"jaxrt: {line}", file=sys.stderr, flush=True)
