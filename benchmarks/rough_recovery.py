"""Are roughness and colour of three metal balls found from one picture, and do the standard errors hold?

    python -m benchmarks.rough_recovery [--seeds 20]

Each fit starts from grey balls of one roughness, and has a target of another seed. Of its numbers, 95 % should be
within 2 of their standard errors of the truth, and all within .02.
"""

import argparse
import time

import numpy as np

import jaxrt
from benchmarks.processes import cpu_model

TRUTH = {"red": ([0.9, 0.3, 0.2], 0.25), "green": ([0.4, 0.8, 0.3], 0.45), "blue": ([0.3, 0.4, 0.9], 0.65)}
NAMES = [f"materials.{field}[{ball}]" for field in ("albedo", "roughness") for ball in TRUTH]


def scene_of(balls: dict[str, tuple[list[float], float]]) -> jaxrt.Scene:
    """Return three balls before a lamp and a sky."""
    table = {name: {"type": "conductor", "albedo": a, "roughness": r} for name, (a, r) in balls.items()}
    spheres = [
        {"center": [2.2 * i, 0, 0], "radius": 1, "material": name} for i, name in zip((-1, 0, 1), balls, strict=True)
    ]
    return jaxrt.build(
        {
            "camera": {"position": [0, 0, 9], "fov": 16, "width": 48, "height": 16},
            "materials": table,
            "spheres": spheres,
            "lights": [{"position": [-3, 5, 7], "intensity": 60, "radius": 1}],
            "environment": {"radiance": [0.3, 0.3, 0.3]},
        }
    )


def main() -> None:
    """Print a line for each seed, and how many numbers are within their standard errors."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("--target-spp", type=int, default=1024)
    options = parser.parse_args()
    print(cpu_model())
    start, right = scene_of(dict.fromkeys(TRUTH, ([0.5, 0.5, 0.5], 0.4))), scene_of(TRUTH)
    within = []
    for seed in range(options.seeds):
        clock = time.perf_counter()
        target = jaxrt.render(right, 1000 + seed, spp=options.target_spp, max_depth=2)
        answer = jaxrt.fit(start, target, NAMES, spp=options.spp, max_depth=2, seed=seed)
        truth = [np.asarray(jaxrt.parameters(right, name), float) for name in NAMES]
        off = np.concatenate([np.ravel(answer.values[n] - t) for n, t in zip(NAMES, truth, strict=True)])
        errors = np.concatenate([np.ravel(answer.errors[n]) for n in NAMES])
        within += list(np.abs(off) <= 2 * errors)
        seconds = time.perf_counter() - clock
        print(
            f"seed {seed}: off by at most {np.abs(off).max():.4f}, largest standard error {errors.max():.4f}, "
            f"{answer.verdict.word}, {seconds:.0f} s; within 2 standard errors so far: {100 * np.mean(within):.1f} %",
            flush=True,
        )


if __name__ == "__main__":
    main()
