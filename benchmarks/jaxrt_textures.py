"""jaxrt's half of `benchmarks.textures`: the only texture of a scene, sought by least squares, or with Adam.

    python -m benchmarks.jaxrt_textures SCENE VISIBLE.npy --rates 0.02 [--plain]

Least squares are those of examples/fit_texture.py: conjugate gradients by few samples, residuals by many. plain: Adam
moves the texels, clipped to [0, 1] after each step, as Mitsuba's half does. Prints a line of JSON, a report for each
rate, or for least squares one: CPU and wall seconds but for what compiles, gradients and pictures of one sample a pixel
that were drawn, and the PSNR along the way; of Adam the mean loss of the last tenth of its steps too.
"""

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax import Array

import jaxrt
from benchmarks.texture_task import TOLD, rate_at, texture_parser, told_after

ADAM = optax.scale_by_adam()
ROUNDS = ((64, 4), (256, 8), (256, 8), (256, 8))  # samples of the residual, steps: the last two to see a drift
FEW = 4  # samples of a gradient
SMOOTH = 1e-4  # weight of the mean square of differences of neighbouring texels, beside that of pixels
LEAST = 1e-3  # what steps are divided by, of the largest such number


def main() -> None:
    """Fit, and print."""
    parser = texture_parser()
    parser.add_argument("--plain", action="store_true")
    options = parser.parse_args()
    views = jaxrt.load_views(options.scene)
    views = [replace(v, camera=replace(v.camera, width=options.width, height=options.height)) for v in views]
    name = next(name for name in jaxrt.parameters(views[0]) if name.startswith("textures."))
    truth = jnp.asarray(np.load(options.texels), jnp.float32) if options.texels else jaxrt.parameters(views[0])[name]
    visible = np.load(options.visible)
    draw = partial(drawn, name=name, max_depth=options.max_depth)
    targets = [draw(truth, view, 2**31 + i, options.target_spp) for i, view in enumerate(views)]

    def psnr(found: Array) -> float:
        return -10 * float(jnp.log10(jnp.mean((found - truth)[visible] ** 2)))

    if options.plain:
        step = step_of(draw, options)
        fits = [{"rate": rate, **adam(step, views, targets, truth, psnr, rate, options)} for rate in options.rates]
    else:
        fits = [least_squares(draw, views, targets, truth, psnr)]
    print(json.dumps({"fits": fits}))


def drawn(texels: Array, view: Any, key: Any, spp: int, *, name: str, **options: Any) -> Array:
    """Return the picture of a view with these texels."""
    return jaxrt.render(jaxrt.with_parameters(view, {name: texels}), key, spp=spp, **options)


def least_squares(
    draw: Callable[..., Array],
    views: Sequence[Any],
    targets: Sequence[Array],
    truth: Array,
    psnr: Callable[[Array], float],
) -> dict[str, Any]:
    """Take all rounds, and return what they come to."""

    @jax.jit
    @jax.grad
    def slope(texels: Array, view: Any, key: Any, target: Array) -> Array:
        uneven = jnp.mean(jnp.diff(texels, axis=0) ** 2) + jnp.mean(jnp.diff(texels, axis=1) ** 2)
        return (jnp.mean((draw(texels, view, key, FEW) - target) ** 2) + SMOOTH * uneven) / len(views)

    texels, told, gradients, renders = jnp.full_like(truth, 0.5), [], 0, 0
    jax.block_until_ready(slope(texels, views[0], np.uint32(0), targets[0]))  # which compiles
    begin = time.process_time(), time.perf_counter()
    for number, (spp, steps) in enumerate(ROUNDS):
        keys = [np.uint32(100 * number + i) for i in range(len(views))]
        shown = [draw(texels, v, k, FEW) - draw(texels, v, k + 50, spp) for v, k in zip(views, keys, strict=True)]
        goals = [target + less for target, less in zip(targets, shown, strict=True)]
        texels = jnp.clip(texels + solved(partial(whole_slope, slope, views, keys, goals), texels, steps), 0, 1)
        gradients, renders = gradients + FEW * len(views) * (steps + 2), renders + len(views) * (spp + FEW)
        now = time.process_time() - begin[0], time.perf_counter() - begin[1]
        report = {"gradients": gradients, "renders": renders, "psnr": psnr(texels), "cpu": now[0], "wall": now[1]}
        told.append(report)
    return {"rounds": told}


def whole_slope(
    slope: Callable[..., Array], views: Sequence[Any], keys: Sequence[Any], goals: Sequence[Array], texels: Array
) -> Any:
    """Return the gradient of all views' loss."""
    return sum(slope(texels, *each) for each in zip(views, keys, goals, strict=True))


def solved(slope: Callable[[Array], Array], texels: Array, steps: int) -> Array:
    """Return the change of texels that takes a linear slope towards 0, by steps of conjugate gradients."""
    here = slope(texels)
    alike = slope(texels + 1) - here
    alike = jnp.maximum(alike, LEAST * jnp.max(alike))
    left, change, way = -here, jnp.zeros_like(texels), -here / alike
    for _ in range(steps):
        pushed, size = slope(texels + way) - here, jnp.vdot(left, left / alike)
        share = size / jnp.vdot(way, pushed)
        change, left = change + share * way, left - share * pushed
        way = left / alike + jnp.vdot(left, left / alike) / size * way
    return change


def adam(
    step: Callable[..., Any],
    views: Sequence[Any],
    targets: Sequence[Array],
    truth: Array,
    psnr: Callable[[Array], float],
    rate: float,
    options: Any,
) -> dict[str, Any]:
    """Take all steps, each in one of the views, and return what they come to."""
    texels, told, losses, begin, took = jnp.full_like(truth, 0.5), [], [], (0.0, 0.0), (0.0, 0.0)
    state, steps = ADAM.init(texels), options.steps
    for i in range(steps + options.more):
        view = i % len(views)
        texels, state, loss = step(texels, state, views[view], targets[view], np.uint32(i), rate_at(i, rate, options))
        if steps - steps // TOLD <= i < steps:
            losses.append(loss)
        if i + 1 in (len(views), steps):
            jax.block_until_ready(texels)
            now = time.process_time(), time.perf_counter()
            took, begin = (now[0] - begin[0], now[1] - begin[1]), now
        if told_after(i + 1, options):
            told.append(psnr(texels))
    return {"psnr": told, "loss": float(np.mean(losses)), "cpu": took[0], "wall": took[1]}


def step_of(draw: Callable[..., Array], options: Any) -> Callable[..., Any]:
    """Return (texels, Adam's state, view, target, number, rate) -> these two after a step, and the loss."""

    def loss(texels: Array, view: Any, target: Array, i: Any) -> Array:
        return jnp.mean((draw(texels, view, 2 * i, options.spp, gradient_key=2 * i + 1) - target) ** 2)

    @jax.jit
    def step(texels: Array, state: Any, view: Any, target: Array, i: Any, rate: Any) -> Any:
        off, slopes = jax.value_and_grad(loss)(texels, view, target, i)
        moves, state = ADAM.update(slopes, state)
        return jnp.clip(texels - rate * moves, 0, 1), state, off

    return step


if __name__ == "__main__":
    main()
