"""Eight cameras drawn as one batch beside eight calls of one program, and a turntable of a posed mesh.

    python -m benchmarks.cameras [--size 128] [--spp 16] [--rounds 5]

Prints compilations, medians of wall and CPU seconds, and the ratio within each round, batch over calls: at most 1 is no
slower.
"""

import argparse
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

import jaxrt
from benchmarks.processes import cpu_model

VIEWS, FRAMES = 8, 12


def timed(f: Callable[..., Any], *arguments: Any) -> tuple[float, float]:
    """Return wall and CPU seconds of a call."""
    wall, cpu = time.perf_counter(), time.process_time()
    jax.block_until_ready(f(*arguments))
    return time.perf_counter() - wall, time.process_time() - cpu


def compare(title: str, draw: Callable[[Array], Array], values: Array, rounds: int) -> None:
    """Print what a batch of values costs beside a call for each."""
    one, batch = jax.jit(draw), jax.jit(jax.vmap(draw))

    def calls(values: Array) -> list[Array]:
        return [one(value) for value in values]

    compiled = [timed(f, values)[1] for f in (calls, batch)]
    seconds = np.array([[timed(f, values) for f in (calls, batch)] for _ in range(rounds)])
    (wall, cpu), (wall_batch, cpu_batch) = np.median(seconds, 0)
    ratios = np.median(seconds[:, 1] / seconds[:, 0], 0)
    print(
        f"{title}: {len(values)} calls {wall:.3f} s ({cpu:.3f} s CPU), batch {wall_batch:.3f} s ({cpu_batch:.3f} s CPU)"
    )
    print(f"  batch over calls, median of {rounds}: wall {ratios[0]:.3f}, CPU {ratios[1]:.3f}")
    sizes = [f._cache_size() for f in (one, batch)]
    print(f"  programs {sizes[0]} and {sizes[1]}, first calls {compiled[0]:.1f} and {compiled[1]:.1f} s CPU")


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description="Batches of cameras beside calls.")
    parser.add_argument("--size", type=int, default=128)
    parser.add_argument("--spp", type=int, default=16)
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    print(f"{cpu_model()}; jax {jax.__version__}")
    how: dict[str, Any] = dict(spp=options.spp, width=options.size, height=options.size)
    for file in ("scenes/room.toml", "scenes/mug.toml"):
        scene = jaxrt.load_scene(file)
        eye = jaxrt.parameters(scene, "camera.position")
        places = eye + 0.1 * jnp.stack([jnp.asarray([jnp.cos(a), 0, jnp.sin(a)]) for a in np.arange(VIEWS)])

        def view(place: Array, scene: jaxrt.Scene = scene) -> Array:
            return jaxrt.render(jaxrt.with_parameters(scene, {"camera.position": place}), 0, **how)

        compare(f"{file}, {VIEWS} cameras", view, places, options.rounds)

    def frame(turn: Array) -> Array:
        return jaxrt.render(jaxrt.with_parameters(scene, {"meshes.rotate[mug]": turn}), 0, **how)

    scene = jaxrt.load_scene("scenes/mug.toml")
    turns = jnp.asarray([[0, 360 * i / FRAMES, 0] for i in range(FRAMES)], jnp.float32)
    compare(f"scenes/mug.toml, {FRAMES} turns of the mug", frame, turns, options.rounds)


if __name__ == "__main__":
    main()
