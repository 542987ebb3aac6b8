"""jaxrt's half of the comparison, one measurement per process: prints one line of JSON.

    python -m benchmarks.jaxrt_side time  SCENE --repeat N                 seconds of first and later calls
    python -m benchmarks.jaxrt_side image SCENE --out STACK.npz --seeds N  one image per seed

The cold start is measured on the command line program itself, `jaxrt render`.
"""

import argparse
import json
import math
import os
import resource
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np


def load(path: str, width: int | None, height: int | None) -> Any:
    """Return the scene of a file, with another picture size where one is given."""
    import jaxrt

    scene = jaxrt.load_scene(path)
    size = {"width": width or scene.camera.width, "height": height or scene.camera.height}
    return replace(scene, camera=replace(scene.camera, **size))


def renderer(options: argparse.Namespace) -> tuple[Callable[[int], Any], int]:
    """Return (seed -> finished image, camera paths of an image)."""
    import jaxrt

    scene = load(options.scene, options.width, options.height)
    spp = options.spp or scene.defaults.spp

    def render(seed: int) -> Any:
        image = jaxrt.render(scene, seed, spp=spp, max_depth=options.max_depth, sampler=options.sampler)
        return image.block_until_ready()

    return render, scene.camera.width * scene.camera.height * spp


def clocked(action: Callable[[], object]) -> dict[str, float]:
    """Return {"wall", "cpu"} seconds of one call; cpu counts every thread of this process."""
    wall, cpu = time.perf_counter(), time.process_time()
    action()
    return {"wall": time.perf_counter() - wall, "cpu": time.process_time() - cpu}


def run_time(options: argparse.Namespace) -> dict[str, Any]:
    """Return seconds of the first call, which compiles, and of `repeat` later ones."""
    render, paths = renderer(options)
    first = clocked(lambda: render(options.seed))
    seeds = range(options.seed + 1, options.seed + 1 + options.repeat)
    later = [clocked(lambda seed=seed: render(seed)) for seed in seeds]
    compile_wall = first["wall"] - statistics.median(call["wall"] for call in later)
    return {"paths": paths, "compile": compile_wall, "first": first, "calls": later}


def run_image(options: argparse.Namespace) -> dict[str, Any]:
    """Save images (seeds, H, W, 3) float32, one for each seed from `seed` on."""
    render, _ = renderer(options)
    seeds = range(options.seed, options.seed + options.seeds)
    images = np.stack([np.asarray(render(seed)) for seed in seeds])
    np.savez_compressed(options.out, images=images, seeds=list(seeds))
    return {"out": options.out, "mean": images.mean(axis=(0, 1, 2)).tolist()}


def use_separable_masking() -> None:
    """Let facets mask and shadow as if these were unrelated, which peers do: for comparisons alone."""
    from jaxrt.materials import conductor, facets, rough_glass

    def separable(alpha: Any, h: Any, cos_o: Any, cos_i: Any) -> Any:
        _, density, squared = correlated(alpha, h, cos_o, cos_i)
        far = (alpha * alpha + (1 - alpha * alpha) * cos_i * cos_i) ** 0.5
        return 2 * density * cos_i / (cos_i + far), density, squared

    correlated = facets.facets
    conductor.facets = rough_glass.facets = separable
    use_rough_passages()


def use_rough_passages() -> None:
    """Let light into plastic and out of it as facets refract it once, which peers do: for comparisons alone.

    Of what is rougher than the smoothest, and of an index of 1.5.
    """
    import jax.numpy as jnp

    from benchmarks.passages import STEPS, tables
    from jaxrt.kernels.gather import take
    from jaxrt.materials.facets import SMOOTHEST
    from jaxrt.materials.plastic import Plastic

    smooth = Plastic.facts

    def facts(self: Any, o: Any, i: Any) -> Any:
        passed, thrown_back = tables(1.5)
        (coat, beneath, inner), pdf = smooth(self, o, i)
        row = jnp.round(self.roughness * STEPS).astype(jnp.int32)

        def passage(cos: Any) -> Any:
            place = jnp.clip(cos, 0, 1) * passed.shape[1]
            cell = jnp.minimum(place.astype(jnp.int32), passed.shape[1] - 1)
            low, rise = take(jnp.asarray(passed.reshape(-1, 2), jnp.float32), row * passed.shape[1] + cell)
            return low + rise * (place - cell)

        even = jnp.maximum(i[2], 0) / math.pi
        through = passage(o[2]) * passage(i[2]) / (self.ior * self.ior) * even
        (back,) = take(jnp.asarray(thrown_back[:, None], jnp.float32), row)
        rough = self.roughness > SMOOTHEST
        return (coat, jnp.where(rough, through, beneath), jnp.where(rough, back, inner)), pdf

    Plastic.facts = facts


def use_cores(cores: int) -> None:
    """Pin this process to `cores` cores, and let JAX have as many devices."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:cores])
    import jaxrt

    jaxrt.use_cpu_cores(cores)


def arguments() -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(description="Measure jaxrt in a process of its own.")
    parser.add_argument("command", choices=["time", "image"])
    parser.add_argument("scene")
    parser.add_argument("--sampler", default="sobol")
    parser.add_argument("--cores", type=int, default=os.cpu_count())
    for name in ("width", "height", "spp", "max-depth"):
        parser.add_argument(f"--{name}", type=int, help="default: the scene's")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seeds", type=int, default=16, help="number of images of `image`")
    parser.add_argument("--masking", choices=["correlated", "separable"], default="correlated", help="of rough facets")
    parser.add_argument("--repeat", type=int, default=3, help="timed calls of `time` after the first")
    parser.add_argument("--out", help="file of `image` (.npz)")
    return parser.parse_args()


def main() -> None:
    """Run one command and print its JSON."""
    options = arguments()
    use_cores(options.cores)
    if options.masking == "separable":
        use_separable_masking()
    report = {"time": run_time, "image": run_image}[options.command](options)
    kilobyte = 1 if sys.platform == "darwin" else 1024
    report["peak_bytes"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * kilobyte
    print(json.dumps(report))


if __name__ == "__main__":
    main()
