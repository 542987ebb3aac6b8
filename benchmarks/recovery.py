"""From how many of 100 random starts is a point light found, with edge derivatives and without?

    python -m benchmarks.recovery [--starts 100] [--scene scenes/hanging_ball.toml]

Starts lie in a box above the floor, the target has another seed and 16 times the samples, all starts are one compiled
call of Levenberg-Marquardt, and a light within 1 % of the floor's diagonal counts as found.
"""

import argparse
import time

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx

import jaxrt
from benchmarks.processes import cpu_model

SCENES = ("scenes/ball_on_floor.toml", "scenes/hanging_ball.toml")
LOW, HIGH = (-6.0, 7.5, -6.0), (6.0, 12.0, 6.0)  # above the balls
DIAGONAL = 16 * 2**0.5
SPP, STEPS = 16, 40


def found_from(path: str, starts: jax.Array, boundary_samples: int) -> jax.Array:
    """Return the distance (n,) from the light at which each start ends."""
    scene = jaxrt.load_scene(path)
    truth = jaxrt.parameters(scene)["lights.position"]
    target = jaxrt.render(scene, 1, spp=16 * SPP)

    @jaxrt.jacobian_once
    def residual(position: jax.Array, args: None) -> jax.Array:
        lit = jaxrt.with_parameters(scene, {"lights.position": position})
        return (jaxrt.render(lit, 0, spp=SPP, boundary_samples=boundary_samples) - target).ravel()

    def solve(position: jax.Array) -> jax.Array:
        method = optx.LevenbergMarquardt(rtol=1e-4, atol=1e-4)
        return optx.least_squares(residual, method, position, max_steps=STEPS, throw=False).value

    return jnp.linalg.norm(jax.jit(jax.vmap(solve))(starts) - truth[None], axis=(1, 2))


def main() -> None:
    """Print a line for each scene and kind of derivative."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--starts", type=int, default=100)
    parser.add_argument("--scene", nargs="+", default=SCENES)
    options = parser.parse_args()
    print(cpu_model())
    places = np.random.default_rng(0).uniform(LOW, HIGH, (options.starts, 1, 3))
    for path in options.scene:
        for name, samples in {"with edges": 4 * 64 * 64, "interior only": 0}.items():
            start = time.perf_counter()
            errors = found_from(path, jnp.asarray(places, jnp.float32), samples)
            found = int(jnp.sum(errors <= 0.01 * DIAGONAL))
            print(f"{path}, {name}: {found} of {options.starts}, {time.perf_counter() - start:.0f} s", flush=True)


if __name__ == "__main__":
    main()
