"""The command `jaxrt fit`."""

import argparse
import sys
from pathlib import Path

import jax.numpy as jnp

from jaxrt.description import SceneDescription
from jaxrt.fit import Fit, FitError, Machine, Problem, Progress, all_rows, fit, unknowns_of
from jaxrt.fit.files import (
    Target,
    check_writable,
    draw_before_after,
    draw_losses,
    final_report,
    load_target,
    progress_report,
    read_progress,
    write_report,
    write_scene,
)
from jaxrt.fit.solve import Vector
from jaxrt.fit.unknowns import Floats, Unknowns
from jaxrt.gradcheck.coverage import coverage
from jaxrt.io.scene_file import read_description
from jaxrt.scene import Scene, build
from jaxrt.scene.checks import check_memory
from jaxrt.scene.selectors import Selector, parse_selector

DIGITS = 5


def run_fit(args: argparse.Namespace) -> int:
    """Fit, and write fitted.toml, fit.json, loss.png and before_after.png into the output folder.

    Returns the exit status: 0, 1 for a stalled or ambiguous fit, 130 for an interrupted one.
    Raises SceneError for bad scenes and parameters, ValueError and OSError for a bad target.
    """
    target = load_target(args.target, args.srgb)
    description = _sized(read_description(args.scene, args.allow_folder), target, args)
    scene = build(description)
    selectors = _selectors(args.parameters, scene, description)
    unknowns = unknowns_of(scene, selectors)
    _say(*target.notes)
    depth = args.max_depth or description.render.max_depth
    problem = Problem(scene, unknowns, jnp.asarray(target.image), jnp.asarray(target.weight), depth)
    missing = missing_terms(scene, unknowns, depth)
    _warn(missing, args.scene)
    machine = Machine(problem)
    folder = args.output or Path(f"{args.scene.stem}_fit")
    folder.mkdir(parents=True, exist_ok=True)
    resume = read_progress(folder / "fit.json", unknowns) if args.resume else None

    def save(vector: Vector) -> None:
        write_scene(args.scene, folder / "fitted.toml", unknowns.values(vector), selectors, description)

    def report(now: Progress) -> None:
        _say(f"step {now.step}: loss {now.loss:.3e}, {_values(unknowns.values(now.vector))}")
        save(now.vector)
        write_report(folder / "fit.json", progress_report(unknowns, now, missing))

    spp = args.spp or description.render.spp
    answer = fit(machine, spp, args.seed, args.max_steps, args.starts, resume, report)
    save(answer.vector)
    write_report(folder / "fit.json", final_report(unknowns, answer, missing))
    draw_losses(folder / "loss.png", answer.progress.losses)
    draw_before_after(folder / "before_after.png", target, *answer.pictures)
    _tell(folder, problem, answer)
    if answer.interrupted:
        _say("interrupted: the best so far is written, go on with --resume")
        return 130
    return 1 if answer.verdict.word in ("stalled", "ambiguous") else 0


def _sized(description: SceneDescription, target: Target, args: argparse.Namespace) -> SceneDescription:
    """Return the description with a camera of the target's size."""
    height, width, _ = target.image.shape
    camera = description.camera
    if (camera.width, camera.height) != (width, height):
        if abs(camera.width * height - camera.height * width) > max(camera.width, camera.height):
            raise FitError(
                f"{args.target}: {width}x{height}, but the scene's camera has {camera.width}x{camera.height}, another "
                "shape: set camera.width and camera.height, or crop the picture"
            )
        _say(f"the scene is drawn in the target's size, {width}x{height}")
    check_memory(width, height, str(args.target))
    return description.model_copy(update={"camera": camera.model_copy(update={"width": width, "height": height})})


def _selectors(texts: list[str], scene: Scene, description: SceneDescription) -> dict[str, Selector]:
    selectors = {text: parse_selector(text, scene, description) for text in all_rows(texts, scene)}
    check_writable(selectors)
    return selectors


def missing_terms(scene: Scene, unknowns: Unknowns, max_depth: int) -> dict[str, tuple[str, ...]]:
    """Return for each unknown what its derivative lacks in this scene; those that lack nothing are left out."""
    selectors = ((row.text, row.selector) for row in unknowns.rows)
    found = {text: coverage(scene, name, max_depth, 1, row).missing for text, (name, row) in selectors}
    return {text: missing for text, missing in found.items() if missing}


def _warn(missing: dict[str, tuple[str, ...]], scene: Path) -> None:
    """Say in one line which unknowns lack which terms."""
    if not missing:
        return
    alike: dict[tuple[str, ...], list[str]] = {}
    for text, terms in missing.items():
        alike.setdefault(terms, []).append(text)
    lacks = "; ".join(f"{', '.join(texts)}: {', '.join(terms)}" for terms, texts in alike.items())
    first = next(iter(missing))
    _say(
        f'warning: derivatives lack, for {lacks}. The fit may stall or be off: `jaxrt gradcheck {scene} "{first}"` '
        "tells by how much; another view or start may not need them"
    )


def _tell(folder: Path, problem: Problem, answer: Fit) -> None:
    """Print values with standard errors, and the verdict."""
    unknowns, verdict = problem.unknowns, answer.verdict
    errors = verdict.errors * unknowns.slopes(answer.vector)
    for row in unknowns.rows:
        value, error = unknowns.values(answer.vector)[row.text].ravel(), errors[row.span]
        print(f"{row.text} = {' '.join(f'{v:.{DIGITS}g} ± {e:.1g}' for v, e in zip(value, error, strict=True))}")
    print(
        f"{verdict.word}: {verdict.message}\n{folder}: {answer.progress.step} steps, loss {verdict.loss:.3g} on fresh "
        f"seeds, of which {verdict.noise_floor:.3g} noise of the rendering; fitted.toml, fit.json, loss.png, "
        "before_after.png"
    )


def _values(values: dict[str, Floats]) -> str:
    return ", ".join(f"{name} {' '.join(f'{v:.{DIGITS}g}' for v in value.ravel())}" for name, value in values.items())


def _say(*lines: str) -> None:
    for line in lines:
        print(f"jaxrt: {line}", file=sys.stderr, flush=True)
