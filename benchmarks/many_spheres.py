"""What a path among many spheres costs, and from how many on a tree finds them sooner than a loop.

    python -m benchmarks.many_spheres [--counts 100 10000 100000] [--crossover 32 64 128 256]

CPU time of one core; variants alternate within rounds, ratios are formed within a round.
"""

import argparse
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console

import jaxrt
from benchmarks.interleave import Picture, interleaved, picture, ratios, spread
from benchmarks.mesh_jaxrt import LANES, searcher
from benchmarks.mesh_rays import camera_rays, incoherent_rays
from benchmarks.processes import cpu_model
from jaxrt.shapes import Spheres, geometry_of, sphere_topology

SHARE = 0.05  # of the cube, that spheres fill whatever their number


def crowd(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return centres (n, 3) and radii (n,) of small spheres in a cube of side 2."""
    rng = np.random.default_rng(count)
    usual = (8 * SHARE / count * 3 / (4 * np.pi)) ** (1 / 3)
    return rng.uniform(-1, 1, (count, 3)), usual * rng.uniform(0.7, 1.2, count)


def described(count: int) -> dict[str, Any]:
    """Return the description of small spheres in a cube under a sphere light, on a floor."""
    center, radius = crowd(count)
    white = {"type": "diffuse", "albedo": [0.8, 0.8, 0.8]}
    balls = [
        {"center": c, "radius": r, "material": "white"} for c, r in zip(center.tolist(), radius.tolist(), strict=True)
    ]
    return {
        "camera": {"position": [0, 1, 4], "width": 128, "height": 128},
        "materials": {"white": white},
        "spheres": [{"center": [0, -1001.2, 0], "radius": 1000, "material": "white"}, *balls],
        "lights": [{"position": [2, 5, 3], "intensity": [60, 60, 60], "radius": 0.5}],
        "render": {"spp": 4, "max_depth": 4},
    }


def search_ratios(count: int, rounds: int) -> dict[str, list[float]]:
    """Return, for each kind of ray, how many times as fast as the loop the tree is, in each round."""
    center, radius = crowd(count)
    tree, outside = sphere_topology(center, radius, least=1) or (None, None)
    c, r = (jnp.asarray(x, jnp.float32) for x in (center, radius))
    loop = Spheres(c, r, jnp.zeros_like(r), jnp.zeros(count, jnp.int32))
    tables = {"tree": replace(loop, bvh=tree, outside=outside), "loop": loop}
    geometries = {name: jax.jit(geometry_of)(spheres, None) for name, spheres in tables.items()}
    found, size = {}, LANES * 256
    for kind, (o, d) in {"camera": camera_rays(size), "incoherent": incoherent_rays(size)}.items():
        search, operands = searcher(False), [jax.device_put(x) for x in (o, d, np.ones(len(o), np.float32))]
        # Bound now: the loop goes on to other rays
        actions: dict[str, Callable[[], object]] = {
            name: lambda g=geometry, s=search, x=operands: jax.block_until_ready(s(g, *x))
            for name, geometry in geometries.items()
        }
        found[kind] = ratios(interleaved(actions, rounds), "loop", "tree")
    return found


def path_times(counts: list[int], rounds: int) -> dict[int, tuple[float, list[float]]]:
    """Return for each number of spheres the ns a path, and the ratios to the first number's."""
    pictures: dict[str, Picture] = {str(n): picture(jaxrt.build(described(n)), 4, 4) for n in counts}
    times = interleaved({name: p.again for name, p in pictures.items()}, rounds)
    paths = next(iter(pictures.values())).paths
    first = str(counts[0])
    return {
        int(name): (1e9 * spread(seconds).median / paths, ratios(times, name, first)) for name, seconds in times.items()
    }


def main() -> None:
    """Measure, and print both tables."""
    parser = argparse.ArgumentParser(description="Measure scenes of many spheres.")
    parser.add_argument("--counts", type=int, nargs="*", default=[100, 10_000, 100_000])
    parser.add_argument("--crossover", type=int, nargs="*", default=[32, 64, 128, 256])
    parser.add_argument("--rounds", type=int, default=5)
    options, console = parser.parse_args(), Console()
    console.print(cpu_model())
    for count in options.crossover:
        for kind, values in search_ratios(count, options.rounds).items():
            console.print(
                f"{count} spheres, {kind} rays: the tree is {spread(values).told()} times as fast as the loop"
            )
    if options.counts:
        for count, (ns, values) in path_times(options.counts, options.rounds).items():
            console.print(f"{count} spheres: {ns:.0f} ns a path, {spread(values).told()} times the first")


if __name__ == "__main__":
    main()
