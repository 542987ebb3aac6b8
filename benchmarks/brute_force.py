"""The seed's point, as a table: a mesh by brute force, with one bounding box, and through the BVH."""

import argparse
import statistics
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from unittest.mock import patch

import jax
import numpy as np

import jaxrt
import jaxrt.shapes
from benchmarks.alternatives.bounding_box import Box, find_in_box, occluded_in_box
from benchmarks.processes import cpu_model
from jaxrt.render import draw_sum, prepare


@contextmanager
def boxed(box: Box | None) -> Iterator[None]:
    """Look for triangles in a bounding box, where there is one."""
    if box is None:
        yield
        return
    with (
        patch.object(jaxrt.shapes, "find_triangle", partial(find_in_box, box)),
        patch.object(jaxrt.shapes, "occluded_by_triangle", partial(occluded_in_box, box)),
    ):
        yield


def box_of(scene: jaxrt.Scene) -> Box:
    """Return the box around the vertices, a little larger than they need."""
    assert scene.triangles is not None
    vertices = np.asarray(scene.triangles.vertices, float)
    pad = 1e-6 * np.abs(vertices).max()
    return Box(tuple((vertices.min(axis=0) - pad).tolist()), tuple((vertices.max(axis=0) + pad).tolist()))


def timer(scene: jaxrt.Scene, depth: int, box: Box | None) -> Callable[[], float]:
    """Return a function that draws one sample a pixel and returns its CPU seconds; compiled before."""
    arguments = prepare(scene, 0, 0, 1, 1, max_depth=depth, devices=jax.devices()[:1])
    # Forget the stages that were traced with another method
    jax.clear_caches()
    with boxed(box):
        program = (
            jax.jit(lambda scene, run: draw_sum.__wrapped__(scene, run, arguments[2])).lower(*arguments[:2]).compile()
        )

    def draw() -> float:
        start = time.process_time()
        np.asarray(program(*arguments[:2]))
        return time.process_time() - start

    return draw


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scene", default="scenes/seed/mesh_in_room.toml")
    parser.add_argument("--size", type=int, default=64, help="width and height in pixels")
    parser.add_argument("--max-depth", type=int, default=5)
    parser.add_argument("--rounds", type=int, default=5)
    args = parser.parse_args()
    scene = jaxrt.load_scene(args.scene)
    scene = replace(scene, camera=replace(scene.camera, width=args.size, height=args.size))
    assert scene.triangles is not None and scene.triangles.bvh is not None, "the scene has too few triangles for a BVH"
    few = replace(scene, triangles=replace(scene.triangles, bvh=None))
    methods = {
        "brute force": timer(few, args.max_depth, None),
        "bounding box": timer(few, args.max_depth, box_of(few)),
        "BVH": timer(scene, args.max_depth, None),
    }
    # Interleaved, so that all methods meet the same other load
    seconds = [{name: draw() for name, draw in methods.items()} for _ in range(args.rounds)]
    paths = args.size**2
    print(f"{cpu_model()}, one core; {args.scene}, {len(scene.triangles.faces)} faces, {args.size}x{args.size} pixels,")
    print(f"1 spp, max_depth {args.max_depth}; medians of {args.rounds} rounds, ratios within rounds")
    print("| method | CPU µs a camera path | times as fast as brute force |\n|---|---|---|")
    for name in methods:
        cost = statistics.median(row[name] for row in seconds) / paths
        ratios = sorted(row["brute force"] / row[name] for row in seconds)
        print(f"| {name} | {cost * 1e6:.1f} | {statistics.median(ratios):.1f} ({ratios[0]:.1f} to {ratios[-1]:.1f}) |")


if __name__ == "__main__":
    main()
