"""jaxrt's half of `benchmarks.textures`: the only texture of a scene, sought with Adam.

    python -m benchmarks.jaxrt_textures SCENE VISIBLE.npy --rate 0.05 [--plain]

What Adam moves is a pyramid, whose sum's sigmoid the texels are; plain: the texels, clipped to [0, 1] after each step.
Prints a line of JSON: CPU and wall seconds of the steps but for the first few, which compile, and the PSNR along the
way.
"""

import json
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax

import jaxrt
from benchmarks.texture_task import TOLD, rate_at, texture_parser
from jaxrt.textures.pyramid import joined, parted


def main() -> None:
    """Fit, and print."""
    parser = texture_parser()
    parser.add_argument("--plain", action="store_true")
    options = parser.parse_args()
    views = jaxrt.load_views(options.scene)
    views = [replace(v, camera=replace(v.camera, width=options.width, height=options.height)) for v in views]
    name = next(name for name in jaxrt.parameters(views[0]) if name.startswith("textures."))
    truth, visible = jaxrt.parameters(views[0])[name], np.load(options.visible)
    drawn = {"spp": options.target_spp, "max_depth": options.max_depth}
    targets = [jaxrt.render(view, 2**31 + i, **drawn).block_until_ready() for i, view in enumerate(views)]
    moved = [jnp.full_like(truth, 0.5)] if options.plain else parted(jnp.zeros_like(truth))
    adam, psnr, begin = optax.scale_by_adam(), [], (0.0, 0.0)
    state, step = (moved, adam.init(moved)), step_of(name, adam, options)
    for i in range(options.steps):
        state = step(*state, views[i % len(views)], targets[i % len(views)], np.uint32(i), rate_at(i, options))
        if i + 1 == len(views):
            jax.block_until_ready(state)
            begin = time.process_time(), time.perf_counter()
        if (i + 1) % max(1, options.steps // TOLD) == 0:
            off = (texels(state[0], options.plain) - truth)[visible]
            psnr.append(-10 * float(jnp.log10(jnp.mean(off**2))))
    cpu, wall = time.process_time() - begin[0], time.perf_counter() - begin[1]
    print(json.dumps({"psnr": psnr, "cpu": cpu, "wall": wall}))


def texels(moved: list[Any], plain: bool) -> Any:
    """Return the texels that what Adam moves stands for."""
    return moved[0] if plain else jax.nn.sigmoid(joined(moved))


def step_of(name: str, adam: Any, options: Any) -> Callable[..., Any]:
    """Return (what moves, Adam's state, view, target, number, rate) -> these two after a step."""

    def loss(moved: list[Any], view: Any, target: Any, i: Any) -> Any:
        painted = jaxrt.with_parameters(view, {name: texels(moved, options.plain)})
        drawn = {"spp": options.spp, "max_depth": options.max_depth, "gradient_key": 2 * i + 1}
        return jnp.mean((jaxrt.render(painted, 2 * i, **drawn) - target) ** 2)

    @jax.jit
    def step(moved: Any, state: Any, view: Any, target: Any, i: Any, rate: Any) -> Any:
        moves, state = adam.update(jax.grad(loss)(moved, view, target, i), state)
        moved = [x - rate * move for x, move in zip(moved, moves, strict=True)]
        return [jnp.clip(x, 0, 1) for x in moved] if options.plain else moved, state

    return step


if __name__ == "__main__":
    main()
