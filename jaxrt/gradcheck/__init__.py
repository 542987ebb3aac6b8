"""Derivatives of a picture against finite differences."""

from collections.abc import Callable, Iterator
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxrt import boundary
from jaxrt.boundary.tangent import moving_edges
from jaxrt.core.samplers import seed_from_key
from jaxrt.description import SceneError
from jaxrt.gradcheck.coverage import coverage
from jaxrt.gradcheck.functionals import functionals, loss_slope
from jaxrt.gradcheck.heatmap import heatmap
from jaxrt.gradcheck.report import Component, Group, Report, compare
from jaxrt.gradcheck.steps import default_step
from jaxrt.render import prepare, render
from jaxrt.scene import Scene, check_scene
from jaxrt.scene.measures import measure
from jaxrt.scene.parameters import asked, parameters, with_parameters
from jaxrt.scene.selectors import Selector, select

__all__ = ["Component", "Group", "Report", "gradcheck", "heatmap"]

SAMPLES_PER_PIXEL = 4  # boundary samples
AWAY = 4  # steps from here to where the loss has its minimum
DRAWS = 6  # pictures and derivatives a seed


def gradcheck(
    scene: Scene,
    name: str,
    key: int | Array,
    *,
    row: int | None = None,
    component: int | None = None,
    spp: int | None = None,
    max_depth: int | None = None,
    boundary_samples: int | None = None,
    step: float | None = None,
    seeds: int = 8,
    tolerance: float = 0.02,
    progress: Callable[[int, int], None] | None = None,
) -> Report:
    """Return how the derivatives of the scene's picture with respect to one row of a parameter compare.

    Forward-mode derivatives, with and without moving edges, against central differences of pictures with the same
    random numbers, by functionals that see shadows move and by an L2 loss; independent seeds give error bars.

    name: may hold the row, as in `materials.albedo[ball]`. row: may be None where there is but one. component: 0, 1 or
    2 of a vector, by default each in turn. spp: samples of each picture, by default the scene's own. boundary_samples:
    by default 4 a pixel; 0 checks the interior alone. step: of the finer difference, by default about 1 % of what the
    camera looks over, and less where what moves is small or nearly touches something; the other has twice as much.
    tolerance: the difference that is let pass, and the noise that is not. progress: called with the draws done and
    their number.
    Raises SceneError for an unknown parameter or row, and ValueError for arguments out of range.
    """
    check_scene(scene)
    scene = asked(scene, [name])
    selector = select(scene, name, row)
    name = selector.name
    spp = scene.defaults.spp if spp is None else spp
    max_depth = scene.defaults.max_depth if max_depth is None else max_depth
    pixels = scene.camera.width * scene.camera.height
    n = SAMPLES_PER_PIXEL * pixels if boundary_samples is None else boundary_samples
    labels = _labels(selector, scene, component)
    _check(seeds, step, tolerance)
    known = coverage(scene, name, max_depth, n, selector.row)
    keys = jax.random.split(jax.random.key(seed_from_key(key)), seeds)
    total = len(labels) * seeds * DRAWS
    done = iter(range(1, total + 1))

    def tell() -> None:
        if progress is not None:
            progress(next(done), total)

    if progress is not None:
        progress(0, total)
    samples = n if known.edges else 0
    one = partial(_check_component, scene, selector, spp=spp, max_depth=max_depth, n=samples, keys=keys, tell=tell)
    found = tuple(one(label, number, step) for label, number in labels)
    return Report(str(selector), found, known, spp, max_depth, samples, seeds, tolerance)


def _check(seeds: int, step: float | None, tolerance: float) -> None:
    if seeds < 2:
        raise ValueError(f"gradcheck: seeds is {seeds}, want at least 2 for error bars")
    if step is not None and not 0 < step < np.inf:
        raise ValueError(f"gradcheck: step is {step}, want a positive number")
    if not 0 < tolerance < np.inf:
        raise ValueError(f"gradcheck: tolerance is {tolerance}, want a positive number")


def _labels(selector: Selector, scene: Scene, component: int | None) -> list[tuple[str, int | None]]:
    """Return the numbers to check, each with its name."""
    value = selector.pick(parameters(scene)[selector.name])
    if value.ndim == 0:
        if component is not None:
            raise SceneError(f"{selector}: is a single number: leave out component {component}")
        return [(str(selector), None)]
    axes = measure(selector.name).axes
    if component is not None and not 0 <= component < 3:
        raise SceneError(f"{selector}: no component {component}: use 0, 1 or 2")
    return [(f"{selector} {axes[i]}", i) for i in range(3) if component in (None, i)]


def _check_component(
    scene: Scene, selector: Selector, label: str, number: int | None, step: float | None,
    *, spp: int, max_depth: int, n: int, keys: Array, tell: Callable[[], None],
) -> Component:  # fmt: skip
    value = parameters(scene)[selector.name]
    index = tuple(i for i in (selector.row, number) if i is not None)
    h = default_step(scene, selector, float(value[index])) if step is None else step
    direction = jnp.zeros_like(value).at[index].set(1)

    def picture(key: Array, steps: int) -> np.ndarray:
        moved = with_parameters(scene, {selector.name: value + (steps * h) * direction})
        image = np.asarray(render(moved, key, spp=spp, max_depth=max_depth), np.float64)
        tell()
        return image

    def draws(key: Array) -> tuple[np.ndarray, ...]:
        """Return fine and coarse differences, both derivatives, and how far the picture is from the loss's minimum."""
        near = [picture(key, steps) for steps in (-1, 1)]
        far = [picture(key, steps) for steps in (-2, 2)]
        parts = _derivative(scene, selector.name, direction, key, spp, max_depth, n)
        interior, edges = (np.asarray(part, np.float64) for part in parts)
        tell()
        residual = (near[0] + near[1]) / 2 - picture(key, AWAY)
        return (near[1] - near[0]) / (2 * h), (far[1] - far[0]) / (4 * h), interior, interior + edges, residual

    *derivatives, residuals = (np.stack(each) for each in zip(*(draws(key) for key in keys), strict=True))
    fine, _, interior, total = (each.mean(0).astype(np.float32) for each in derivatives)
    return Component(label, float(value[index]), h, tuple(_groups(derivatives, residuals)), fine, interior, total)


def _groups(derivatives: list[np.ndarray], residuals: np.ndarray) -> Iterator[Group]:
    """Yield the groups from derivatives (seeds, height, width, 3): fine, coarse, interior, total."""
    measured = [[functionals(picture) for picture in each] for each in derivatives]
    for name in measured[0][0]:
        yield compare(name, *(np.stack([numbers[name] for numbers in each]) for each in measured))
    # Residuals of other seeds: noise that residual and derivative share would not average out
    others = (residuals.sum(0) - residuals) / (len(residuals) - 1)
    losses = [[[loss_slope(*pair)] for pair in zip(others, each, strict=True)] for each in derivatives]
    yield compare("L2 loss", *map(np.asarray, losses))


@partial(jax.jit, static_argnames=("name", "spp", "max_depth", "n"))
def _derivative(
    scene: Scene, name: str, direction: Array, key: Array, spp: int, max_depth: int, n: int
) -> tuple[Array, Array]:
    """Return the picture's derivative along a change of a parameter: inside of edges, and what edges add."""
    value = parameters(scene)[name]

    def inside(x: Array) -> Array:
        return render(with_parameters(scene, {name: x}), key, spp=spp, max_depth=max_depth)

    def edges(x: Array) -> Array:
        plain, run, plan = prepare(with_parameters(scene, {name: x}), key, 0, spp, spp, max_depth=max_depth)
        return moving_edges(
            plain, run.seed, boundary.Plan(n, plan.max_depth, False, False, plan.devices, filter=plan.filter)
        )

    interior = jax.jvp(inside, (value,), (direction,))[1]
    return interior, jax.jvp(edges, (value,), (direction,))[1] if n else jnp.zeros_like(interior)
