"""Are roughness and colour of three metal balls found from one picture, and do the standard errors hold?

    python -m benchmarks.rough_recovery [--seeds 20]

Each fit starts from grey balls of one roughness, and has a target of another seed. Of its numbers, 95 % should be
within 2 of their standard errors of the truth, and all within .02.
"""

import argparse
import time

import jax.numpy as jnp
import numpy as np

import jaxrt
from benchmarks.processes import cpu_model
from jaxrt.fit import Machine, Problem, sought
from jaxrt.fit.descent import descend

TRUTH = {"red": ([0.9, 0.3, 0.2], 0.25), "green": ([0.4, 0.8, 0.3], 0.45), "blue": ([0.3, 0.4, 0.9], 0.65)}
DEPTH = 2
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
    """Print a line for each seed, and at the end how many numbers are within their standard errors."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--spp", type=int, default=512)
    parser.add_argument("--target-spp", type=int, default=2048)
    options = parser.parse_args()
    print(cpu_model())
    start, right = scene_of(dict.fromkeys(TRUTH, ([0.5, 0.5, 0.5], 0.4))), scene_of(TRUTH)
    unknowns = sought(start, NAMES)
    truth = np.concatenate([np.ravel(jaxrt.parameters(right, name)) for name in NAMES])
    machine, off, scores = None, [], []
    for seed in range(options.seeds):
        clock = time.process_time()
        target = jaxrt.render(right, 1000 + seed, spp=options.target_spp, max_depth=DEPTH)
        machine = machine or Machine(Problem(start, unknowns, target, jnp.ones_like(target), DEPTH))
        found = descend(machine.again(target=target), options.spp, seed)
        values = np.concatenate([np.ravel(value) for value in unknowns.values(found.vector).values()])
        errors = found.verdict.errors * unknowns.slopes(found.vector)
        off.append(values - truth)
        scores.append(off[-1] / errors)
        within, size = np.abs(scores[-1]) <= 2, np.mean(scores[-1] ** 2)
        print(
            f"seed {seed}: off by at most {np.abs(off[-1]).max():.4f}, largest standard error {errors.max():.4f}, "
            f"{np.sum(within)} of {len(errors)} within 2 of theirs, mean z² {size:.2f}, {found.verdict.word}, "
            f"{time.process_time() - clock:.0f} CPU seconds",
            flush=True,
        )
    scores = np.array(scores)
    inside, alone = 100 * np.mean(np.abs(scores) <= 2), own_share(scores) * scores.size
    print(
        f"{scores.size} numbers: off by at most {np.abs(off).max():.4f}, {inside:.1f} % within 2 standard errors, "
        f"mean z² {np.mean(scores**2):.2f}; they vary as {alone:.0f} would that have nothing to do with each other"
    )


def own_share(scores: np.ndarray) -> float:
    """Return the share of a fit's numbers (seeds, k) that vary by themselves: (Σλ)²/kΣλ², λ of their correlations."""
    spread = np.linalg.eigvalsh(np.corrcoef(scores.T))
    return float(spread.sum() ** 2 / np.sum(spread**2) / len(spread))


if __name__ == "__main__":
    main()
