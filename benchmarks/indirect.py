"""Is the part of a derivative that moving shadows have in indirect light as large as finite differences say?

    python -m benchmarks.indirect [--seeds 16]

A diffuse corner of a room under a sphere light that moves, three bounces. What direct edges, outlines and the interior
leave of finite differences is regressed on the indirect edge term, for 16 smooth functionals and for means over 4×4
pixels: the slope should be 1. All parts are drawn anew for each seed; the standard error is that of the seeds' slopes.
"""

import argparse
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

import jaxrt
from benchmarks.processes import cpu_model
from jaxrt.boundary import Plan, clearance_of, sample_edges, splat
from tests.edge_scenes import AXES, bumps, cells, corner_room

NAME, DEPTH, STEP = "lights.position", 3, 0.03
SPP, INSIDE_SPP, EDGES = 1024, 512, 65536

Picture = NDArray[np.float64]


def main() -> None:
    """Print the slopes."""
    parser = argparse.ArgumentParser(description="The slope of the indirect edge term.")
    parser.add_argument("--seeds", type=int, default=16)
    seeds = parser.parse_args().seeds
    print(cpu_model())
    scene = corner_room(0.5)
    here, along = jaxrt.parameters(scene)[NAME], jnp.asarray(AXES[0])[None]

    def picture(position: Array, key: Array, spp: int) -> Array:
        return jaxrt.render(jaxrt.with_parameters(scene, {NAME: position}), key, spp=spp, max_depth=DEPTH)

    @jax.jit
    def difference(key: Array) -> Array:
        return (picture(here + STEP * along, key, SPP) - picture(here - STEP * along, key, SPP)) / (2 * STEP)

    @jax.jit
    def inside(key: Array) -> Array:
        return jax.jvp(lambda p: picture(p, key, INSIDE_SPP), (here,), (along,))[1]

    @jax.jit
    def parts(seed: Array) -> list[Array]:
        """Return what direct edges, indirect edges and outlines add."""
        plan = Plan(EDGES, DEPTH, True, True, (jax.devices()[0],))
        tangent = jax.jvp(lambda p: jaxrt.with_parameters(scene, {NAME: p}), (here,), (along,))[1]
        moves = [
            (group, jax.jvp(partial(clearance_of, samples=group), (scene,), (tangent,))[1])
            for group in sample_edges(scene, seed, plan)
        ]
        return [splat(group, change, (64, 64)) for group, change in moves]

    missing: list[Picture] = []
    indirect: list[Picture] = []
    for seed in map(jnp.uint32, range(seeds)):
        direct, bounced, outlines = (np.asarray(part, float) for part in parts(seed + 5000))
        rest = np.asarray(difference(seed), float) - np.asarray(inside(seed + 1000), float)
        missing.append(rest - direct - outlines)
        indirect.append(bounced)
    for name, view in {"functionals": bumps, "cells": cells}.items():
        x, y = (np.array([view(p).ravel() for p in pictures]) for pictures in (indirect, missing))
        mean = x.mean(axis=0)
        slopes = y @ mean / (mean @ mean)
        error = slopes.std(ddof=1) / np.sqrt(seeds)
        print(f"slope of the indirect edge term, {name}: {slopes.mean():.3f} ± {error:.3f}")


if __name__ == "__main__":
    main()
