"""Find the parameters that make a scene look like a picture: bounds, coarse to fine, and a verdict.

What a program of a few lines does with optimistix itself (see examples/), for those who do not write one.
"""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from jax import Array
from jax.typing import ArrayLike

from jaxrt.core.counts import whole_number
from jaxrt.core.extras import require
from jaxrt.description import SceneWarning, show
from jaxrt.fit.answer import Fit, answer_of
from jaxrt.fit.descent import Progress, Step, descend
from jaxrt.fit.lacks import missing_terms, warning_of
from jaxrt.fit.solve import Machine, Problem
from jaxrt.fit.targets import FitError, targets_of
from jaxrt.fit.unknowns import Unknowns, all_rows, differences, unknowns_of
from jaxrt.fit.verdict import Verdict, standard_errors
from jaxrt.fit.views import check_views, tall
from jaxrt.scene import Scene, check_scene
from jaxrt.scene.parameters import asked
from jaxrt.scene.selectors import parse_selector

__all__ = [
    "Fit",
    "FitError",
    "Machine",
    "Problem",
    "Progress",
    "Step",
    "Unknowns",
    "Verdict",
    "fit",
    "standard_errors",
    "unknowns_of",
]

MANY = 300  # numbers sought at once: each is a derivative picture in every step
Target = ArrayLike | Mapping[str, ArrayLike]
Weight = ArrayLike | Mapping[str, ArrayLike]


def fit(
    scene: Scene | Sequence[Scene],
    target: Target | Sequence[Target],
    parameters: Sequence[str],
    *,
    weight: Weight | Sequence[Weight | None] | None = None,
    spp: int | None = None,
    max_depth: int | None = None,
    seed: int = 0,
    max_steps: int = 60,
    starts: int = 1,
    smoothness: float | None = None,
    resume: Progress | None = None,
    progress: Callable[[Step], None] | None = None,
) -> Fit:
    """Return the parameters that bring the scene's picture nearest to a target: values, standard errors, a verdict.

    target: (height, width, 3) linear radiance; the scene is drawn in its size. Or a dict of outputs of `render`, as
    {"mask[mug]": ..., "depth": ...}: each counts by its error relative to its own size, and without "radiance" no light
    is drawn. parameters: names such as "lights.position[0]"; one of several rows without a row stands for all.
    weight: (height, width, 3), or what broadcasts to it, 0 where the target is not to be trusted; for a dict a dict, of
    some of its names. spp: samples of the last stage, max_depth: scattering events; both default to the scene's own.
    max_steps: of all stages. starts: how many starts to choose from. smoothness: how much neighbouring texels of the
    textures sought are to be alike, as a share of the target's size, such as 0.01; None: not at all. resume: the
    `progress` of an earlier fit of the same, to go on from as if it had not ended. progress: called after each step.

    Several views are fitted together: scene is then a list of scenes alike but for their cameras, as
    `jaxrt.load_views` returns, with a list of targets, and of weights. What is sought of the camera is the same for
    all. The answer's `scene` is the first of them, its pictures stand one below the other.

    Ctrl-C ends the steps, and judges the best so far. The answer is never worse on fresh seeds than the start.
    Raises MissingExtra (a SceneError, an ImportError) without the packages of jaxrt[fit], SceneError for unknown
    parameters, FitError (a SceneError) for targets that do not fit and where a picture or a derivative is not finite,
    and ValueError for counts out of range. Warns SceneWarning of what derivatives lack.
    """
    require("fit", "optimistix")
    scenes, targets, weights = _views(scene, target, weight)
    scenes = [asked(one, _names(parameters)) for one in scenes]
    scene = scenes[0]
    spp = _count("spp", scene.defaults.spp if spp is None else spp)
    counts = {"max_steps": _count("max_steps", max_steps), "starts": _count("starts", starts)}
    depth = _count("max_depth", scene.defaults.max_depth if max_depth is None else max_depth)
    shown = targets_of(scene, targets, weights)
    unknowns = sought(scene, parameters)
    check_views(scenes, unknowns)
    missing = missing_terms(scene, unknowns, depth, shown.outputs.light)
    if missing:
        warnings.warn(warning_of(missing), SceneWarning, stacklevel=2)
    sized = [_sized(*view) for view in zip(scenes, shown.pictures, strict=True)]
    cameras = tuple(view.camera for view in sized) if len(sized) > 1 else ()
    picture, trust = tall(shown.pictures), tall(shown.weights)
    smooth = differences(scene, unknowns, smoothness)
    problem = Problem(sized[0], unknowns, picture, trust, depth, cameras=cameras, outputs=shown.outputs, smooth=smooth)
    seed = _count("seed", seed, least=0)

    def report(step: Step) -> None:
        if progress is not None:
            progress(step._replace(lacks=missing))

    found = descend(Machine(problem), spp, seed, **counts, resume=resume, report=report)
    return answer_of(scene, problem, found, missing, shown.by_name)


def sought(scene: Scene, parameters: Sequence[str]) -> Unknowns:
    """Return the unknowns that texts such as `lights.position[0]` name. Raises SceneError."""
    texts = _names(parameters)
    scene = asked(scene, texts)
    if not texts:
        raise FitError('fit: parameters is empty: name some, as in ["lights.position[0]"]')
    if any(not isinstance(text, str) for text in texts):
        raise FitError(f'fit: parameters is {show(texts)}: write names, as in ["lights.position[0]"]')
    selectors = {text: parse_selector(text, scene) for text in all_rows(texts, scene)}
    unknowns = unknowns_of(scene, selectors)
    n = len(unknowns.labels())
    if n > MANY:
        raise FitError(
            f"fit: {n} numbers are sought, each a derivative picture in every step: name parameters of at most {MANY}, "
            "or descend on jax.grad of a loss, whose cost does not grow with them (examples/fit_texture.py)"
        )
    return unknowns


def _names(parameters: Sequence[str]) -> list[str]:
    return [parameters] if isinstance(parameters, str) else list(parameters)


def _views(scene: Any, target: Any, weight: Any) -> tuple[list[Scene], list[Any], list[Any]]:
    """Return scenes, targets and weights of all views. Raises FitError where there are not as many of each."""
    if not isinstance(scene, list | tuple):
        check_scene(scene)
        return [scene], [target], [weight]
    for one in scene:
        check_scene(one)
    weights = [None] * len(scene) if weight is None else weight
    for name, given in (("target", target), ("weight", weights)):
        if not scene or not isinstance(given, list | tuple) or len(given) != len(scene):
            raise FitError(f"{name}: {len(scene)} scenes want a list of as many: pass one for each view")
    return list(scene), list(target), list(weights)


def _sized(scene: Scene, picture: Array) -> Scene:
    """Return the scene with a camera of the target's size. Raises FitError for another shape."""
    height, width, _ = picture.shape
    camera = scene.camera
    if not alike(camera, width, height):
        raise FitError(
            f"target: {width}x{height}, but the scene's camera has {camera.width}x{camera.height}, another shape: set "
            "camera.width and camera.height, or crop the picture"
        )
    return replace(scene, camera=replace(camera, width=width, height=height))


def alike(camera: Any, width: int, height: int) -> bool:
    """Return whether a picture of that size has the shape of the camera's, up to a pixel."""
    return abs(camera.width * height - camera.height * width) <= max(camera.width, camera.height)


def _count(name: str, value: int, least: int = 1) -> int:
    return whole_number(f"fit: {name}", value, least, bits=32)
