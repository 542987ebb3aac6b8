"""Pictures of the room and of an uneven mesh, gradients without and with edges, on the device at hand and on a CPU.

    python -m benchmarks.accelerator [--size 512] [--spp 16] [--rounds 5] [--tiles 512x128 256x64] [--only room]

Prints for each tile the seconds to trace, lower and compile, camera paths per wall second, and by how much the result
differs from the CPU's. JAX_PLATFORMS chooses the device; without an accelerator the figures are those of the CPU.
"""

import argparse
import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from rich.table import Table

import jaxrt
from benchmarks.mesh_rays import bumpy_sphere, room
from benchmarks.processes import cpu_model, wide_console
from jaxrt.render import CPU_TILE, wide_tile

Tile = tuple[int, int]
SUBDIVISIONS = 6  # 81,920 faces, about as many as scans have
EARS = np.array([[0.35, 0.9, 0.2], [-0.35, 0.9, 0.2]])
PARAMETERS = ("lights.position", "materials.albedo")


class Task(NamedTuple):
    """Something to compute from a scene's parameters, and the camera paths that it takes."""

    name: str
    scene: jaxrt.Scene
    compute: Callable[[jaxrt.Scene, dict[str, Any], Tile, jax.Device], Any]


class Measured(NamedTuple):
    """What a task took on a device, and what came out."""

    compile_seconds: float
    seconds: list[float]
    result: np.ndarray


def body() -> tuple[np.ndarray, np.ndarray]:
    """Return (vertices, faces) of a body with two thin ears, whose faces are up to forty times as long as others."""
    vertices, faces = bumpy_sphere(SUBDIVISIONS)
    directions = vertices / np.linalg.norm(vertices, axis=1, keepdims=True)
    for ear in EARS / np.linalg.norm(EARS, axis=1, keepdims=True):
        vertices = vertices + 1.2 * np.exp(60 * (directions @ ear - 1))[:, None] * ear
    # Flat at the bottom, where scans have large faces
    vertices[:, 1] = np.maximum(vertices[:, 1], -0.7)
    return vertices - [0, 0.3, 0], faces


def tasks(size: int, spp: int) -> list[Task]:
    """Return what is measured."""

    def picture(scene: jaxrt.Scene, p: dict[str, Any], tile: Tile, device: jax.Device, edges: int = 0) -> Any:
        moved = jaxrt.with_parameters(scene, p)
        return jaxrt.render(moved, 0, spp=spp, max_depth=4, tile=tile, devices=[device], boundary_samples=edges)

    def gradient(scene: jaxrt.Scene, p: dict[str, Any], tile: Tile, device: jax.Device, edges: int = 0) -> Any:
        slopes = jax.grad(lambda p: jnp.sum(picture(scene, p, tile, device, edges) ** 2))(p)
        return jnp.concatenate([slopes[name].ravel() for name in PARAMETERS])

    def sized(scene: jaxrt.Scene) -> jaxrt.Scene:
        return replace(scene, camera=replace(scene.camera, width=size, height=size))

    own_room, own_body = sized(jaxrt.example("room")), sized(jaxrt.build(room(*body())))
    return [
        Task("room", own_room, picture),
        Task(f"body of {len(own_body.triangles.faces):,} faces", own_body, picture),
        Task("gradient in the room", own_room, gradient),
        Task("the same with edges, four a pixel", own_room, partial(gradient, edges=4 * size**2)),
    ]


def measure(task: Task, tile: Tile, device: jax.Device, rounds: int) -> Measured:
    """Return what a task takes on a device by packets of a size."""
    scene = jax.device_put(task.scene, device)
    p = {name: value for name, value in jaxrt.parameters(scene).items() if name in PARAMETERS}
    start = time.perf_counter()
    program = jax.jit(lambda scene, p: task.compute(scene, p, tile, device)).lower(scene, p).compile()
    compiled = time.perf_counter() - start
    seconds = []
    for _ in range(rounds + 1):
        start = time.perf_counter()
        result = jax.block_until_ready(program(scene, p))
        seconds.append(time.perf_counter() - start)
    return Measured(compiled, seconds[1:], np.asarray(result))


def row_of(task: Task, tile: Tile, device: jax.Device, found: Measured, expected: np.ndarray, spp: int) -> list[str]:
    """Return a row of the table; the rate's range is that of the rounds."""
    camera = task.scene.camera
    rates = [camera.width * camera.height * spp / seconds / 1e6 for seconds in found.seconds]
    error = np.linalg.norm(found.result - expected) / np.linalg.norm(expected)
    rate = f"{statistics.median(rates):.3g} ({min(rates):.3g}–{max(rates):.3g})"
    return [task.name, device.device_kind, f"{tile[0]}x{tile[1]}", f"{found.compile_seconds:.1f}", rate, f"{error:.1e}"]


def tile_of(text: str) -> Tile:
    """Return the size of a packet that a text such as 512x128 tells."""
    width, height = map(int, text.split("x"))
    return width, height


def arguments() -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(description="Measure pictures and gradients on the device at hand.")
    parser.add_argument("--size", type=int, default=512, help="of the square pictures, in pixels (512)")
    parser.add_argument("--spp", type=int, default=16, help="samples per pixel (16)")
    parser.add_argument("--rounds", type=int, default=5, help="timed calls after the first (5)")
    parser.add_argument("--tiles", type=tile_of, nargs="+", help="packets in pixels (jaxrt's own for the device)")
    parser.add_argument("--only", nargs="+", default=[""], metavar="WORD", help="tasks whose names begin so")
    return parser.parse_args()


def main() -> None:
    """Print the table."""
    options, console = arguments(), wide_console()
    device, cpu = jax.devices()[0], jax.devices("cpu")[0]
    alone = device.platform == "cpu"
    console.print(f"{device.device_kind}, jax {jax.__version__}; CPU: {cpu_model()}")
    if alone:
        console.print("No accelerator is at hand: the figures are the CPU's, by its own packets and by accelerators'.")
    heads = ("task", "device", "tile", "compile s", "Mpaths/s", "differs from the CPU's by")
    table = Table(*heads, title=f"{options.size}², {options.spp} spp, depth 4; wall time, medians and ranges")
    for task in tasks(options.size, options.spp):
        if task.name.startswith(tuple(options.only)):
            expected = measure(task, CPU_TILE, cpu, 0).result
            wide = wide_tile(options.size, options.size)
            tiles = options.tiles or ([CPU_TILE, wide] if alone else [wide])
            for tile in tiles:
                found = measure(task, tile, device, options.rounds)
                table.add_row(*row_of(task, tile, device, found, expected, options.spp))
    console.print(table)


if __name__ == "__main__":
    main()
