"""jaxrt's half of `benchmarks.adam`: the albedos of a scene, sought with Adam.

    python -m benchmarks.jaxrt_adam SCENE --width 64 --height 64 --spp 8 --steps 100

Programs are kept in the folder that `XDG_CACHE_HOME` says. Prints one line of JSON: seconds of the start, of the
target, of the first step, of the others and from the start of the process, and how far the albedos are off at the end.
"""

import argparse
import json
import os
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from benchmarks.adam_task import adam_parser

BEGIN = time.perf_counter()


def arguments() -> argparse.Namespace:
    """Return the parsed command line."""
    parser = adam_parser()
    parser.add_argument("--cores", type=int, default=os.cpu_count())
    return parser.parse_args()


def step_of(scene: Any, target: Any, options: argparse.Namespace) -> Callable[..., Any]:
    """Return (albedo, first and second moment, number of the step) -> these after a step of Adam, compiled once."""
    import jax
    import jax.numpy as jnp

    import jaxrt

    def loss(albedo: Any, key: Any) -> Any:
        colored = jaxrt.with_parameters(scene, {"materials.albedo": albedo})
        return jnp.mean((jaxrt.render(colored, key, spp=options.spp, max_depth=options.max_depth) - target) ** 2)

    @jax.jit
    def step(albedo: Any, mean: Any, square: Any, i: Any) -> Any:
        slope = jax.grad(loss)(albedo, i)
        mean, square = 0.9 * mean + 0.1 * slope, 0.999 * square + 0.001 * slope**2
        move = (mean / (1 - 0.9**i)) / (jnp.sqrt(square / (1 - 0.999**i)) + 1e-8)
        return jnp.clip(albedo - options.rate * move, 0.01, 0.99), mean, square

    return step


def main() -> None:
    """Fit, and print."""
    options = arguments()
    import jax.numpy as jnp
    import numpy as np

    import jaxrt

    jaxrt.use_cpu_cores(options.cores)
    jaxrt.keep_programs()
    scene = jaxrt.load_scene(options.scene)
    scene = replace(scene, camera=replace(scene.camera, width=options.width, height=options.height))
    times = {"start": time.perf_counter() - BEGIN}
    target = jaxrt.render(scene, 2**31, spp=options.target_spp, max_depth=options.max_depth).block_until_ready()
    times["target"] = time.perf_counter() - BEGIN - times["start"]
    truth = jaxrt.parameters(scene)["materials.albedo"]
    state = jnp.full_like(truth, 0.5), jnp.zeros_like(truth), jnp.zeros_like(truth)
    step, begin = step_of(scene, target, options), time.perf_counter()
    for i in range(1, options.steps + 1):
        state = step(*state, np.uint32(i))
        if i == 1:
            state[0].block_until_ready()
            times["first"] = time.perf_counter() - begin
    error = float(jnp.abs(state[0] - truth).mean())
    times["others"] = time.perf_counter() - begin - times["first"]
    print(json.dumps(times | {"error": error, "total": time.perf_counter() - BEGIN}))


if __name__ == "__main__":
    main()
