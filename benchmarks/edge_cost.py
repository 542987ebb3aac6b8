"""What gradients of moving shapes cost, in renders and in memory: under a sky, where edges are seen from everywhere.

    python -m benchmarks.edge_cost NAME SPP        one gradient, for its peak of memory

An L2 loss and its gradient in reverse mode, in CPU time of this process; ratios are taken within a round. Memory is
the peak of a process of its own, which includes Python, JAX and its compiler.
"""

import statistics
import sys
import tempfile
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from rich.console import Console
from rich.table import Table

import jaxrt
from benchmarks.clock import cpu_seconds
from benchmarks.edge_scenes import CAMERA, GROUND, SCENES, Description, scene
from benchmarks.ladder import build
from benchmarks.mesh_rays import bumpy_sphere
from benchmarks.processes import run_child

SIZE, SPP, DEPTH, ROUNDS = 96, 16, 3, 5
SAMPLES = 4  # boundary samples a pixel
MEMORY_SPP = (16, 1024)
SUBDIVISIONS = 5  # 20,480 faces
# What moves, and how many renders a gradient may cost
SUBJECTS = {"ball": ("spheres.center", 6), "mesh": ("meshes.vertices", 12)}


def description(name: str) -> Description:
    """Return a ball, or a mesh of 20,480 faces, over a floor under a sky."""
    if name == "ball":
        return SCENES["ball over floor"]
    vertices, faces = bumpy_sphere(SUBDIVISIONS)
    mesh = {"vertices": vertices, "faces": faces, "material": "grey", "scale": 0.7, "translate": [0, 1, 0]}
    return scene(CAMERA, sky=1, meshes=[mesh], spheres=[GROUND])


def programs(name: str, spp: int = SPP, samples: int = SAMPLES) -> tuple[Array, dict[str, Callable[..., Array]]]:
    """Return where the parameter is, and the programs of it: picture, interior gradient, gradient with edges."""
    here = build(description(name), width=SIZE, height=SIZE)
    parameter, _ = SUBJECTS[name]

    def picture(value: Array, boundary_samples: int = 0) -> Array:
        moved = jaxrt.with_parameters(here, {parameter: value})
        return jaxrt.render(moved, 0, spp=spp, max_depth=DEPTH, boundary_samples=boundary_samples)

    def gradient(boundary_samples: int) -> Callable[..., Array]:
        return jax.jit(jax.value_and_grad(lambda v: jnp.mean((picture(v, boundary_samples) - 0.5) ** 2)))

    edges = gradient(samples * SIZE * SIZE)
    return jaxrt.parameters(here, parameter), {"render": jax.jit(picture), "interior": gradient(0), "edges": edges}


def ratios(name: str) -> dict[str, list[float]]:
    """Return what each gradient costs in renders, round by round."""
    start, subjects = programs(name)
    for program in subjects.values():
        cpu_seconds(program, start)
    times = [{title: cpu_seconds(f, start)[1] for title, f in subjects.items()} for _ in range(ROUNDS)]
    return {title: [one[title] / one["render"] for one in times] for title in subjects}


def peak(name: str, spp: int) -> int:
    """Return the bytes of a process that takes one gradient."""
    with tempfile.TemporaryDirectory() as cache:
        return run_child([sys.executable, "-m", "benchmarks.edge_cost", name, str(spp)], cache).peak_bytes


def main(console: Console) -> int:
    """Print the table; return 1 where a bound is passed."""
    table = Table("moves", "interior, renders", "with edges (range)", "bound", *(f"MB, {n} spp" for n in MEMORY_SPP))
    within = True
    for name, (_, bound) in SUBJECTS.items():
        peaks = [peak(name, spp) for spp in MEMORY_SPP]
        found = ratios(name)
        interior, edges = (statistics.median(found[title]) for title in ("interior", "edges"))
        within &= edges <= bound and abs(peaks[1] / peaks[0] - 1) <= 0.1
        told = f"{edges:.2f} ({min(found['edges']):.2f}–{max(found['edges']):.2f})"
        table.add_row(name, f"{interior:.2f}", told, str(bound), *(f"{p / 1e6:.0f}" for p in peaks))
    console.print(f"{SIZE}×{SIZE}, {SPP} spp, depth {DEPTH}, {SAMPLES} boundary samples a pixel")
    console.print(table)
    return int(not within)


if __name__ == "__main__":
    one, many = programs(sys.argv[1], int(sys.argv[2]))
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(many["edges"](one)))
