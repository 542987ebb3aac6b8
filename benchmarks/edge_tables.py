"""Derivatives of moving shadows and outlines against finite differences, with and without the edge terms.

    python -m benchmarks.edges --tables [--output docs/derivatives.png] [--peer-python PATH]

Two errors are printed, both relative L2 distances to finite differences: of the derivative picture averaged over 4×4
pixels, and of 16 smooth functionals. `noise` is half the distance of two independent finite differences: no error can
be seen below it. Draws the derivative pictures: finite differences, without edges, with edges.
"""

import argparse
import json
import subprocess
import tomllib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from rich.console import Console
from rich.table import Table

import jaxrt
from benchmarks.processes import HERE, find_peer
from jaxrt.core.writing import write_whole

SCENE = "scenes/shadows.toml"
SAMPLES = (1024, 4096, 16384)
SPP = 256  # of the derivative inside of edges
KEYS = (1000, 2000)  # of the finite differences
BOX = slice(6, 42)  # vertices of the box: the floor's two triangles come first
Changes = dict[str, Any]


class Case(NamedTuple):
    """One row of the table."""

    table: str
    name: str
    scene: str  # "point", "huge" or "sphere"
    changes: Changes  # direction in parameter space
    step: float
    absolute: bool = False  # the derivative is nearly 0: errors are relative to the one in the row above


class Errors(NamedTuple):
    """How far a derivative picture is from finite differences."""

    cells: float
    bumps: float

    def __str__(self) -> str:
        return f"{self.cells:.3f}/{self.bumps:.4f}"


def scene_of(kind: str) -> jaxrt.Scene:
    """Return the scene with a point light, on a huge sphere for a floor, or under a sphere light."""
    description = tomllib.loads(Path(SCENE).read_text())
    if kind == "sphere":
        description["lights"][0]["radius"] = 0.5
    if kind == "huge":
        description["triangles"] = description["triangles"][2:]
        description["spheres"].append({"center": [0, -1000, 0], "radius": 1000, "material": "white"})
    return jaxrt.build(description)


def cases() -> list[Case]:
    """Return the rows of the tables."""
    axes = dict(zip("xyz", np.eye(3), strict=True))
    vertices = np.zeros((scene_of("point").triangles.vertices.shape[0], 3))
    lifted, corner = vertices.copy(), vertices.copy()
    lifted[BOX, 1] = 1
    corner[_same_corner(), 1] = 1
    wider = {"lights.radius": np.ones(1), "lights.intensity": np.full((1, 3), 2 * 30 / 0.5)}
    rows = [Case("A", f"light {k}", "point", {"lights.position": v[None]}, 0.02) for k, v in axes.items()]
    rows += [Case("A", "light x, floor of radius 1000", "huge", {"lights.position": axes["x"][None]}, 0.02)]
    rows += [Case("B", f"light {k}", "sphere", {"lights.position": v[None]}, 0.03) for k, v in axes.items()]
    rows += [Case("B", "radius, radiance fixed", "sphere", wider, 0.03)]
    rows += [Case("B", "radius, intensity fixed", "sphere", {"lights.radius": np.ones(1)}, 0.03, absolute=True)]
    rows += [Case("C", f"ball {k}", "point", {"spheres.center": axes[k][None]}, 0.02) for k in "xz"]
    rows += [Case("C", "ball radius", "point", {"spheres.radius": np.ones(1)}, 0.02)]
    rows += [Case("C", "box y", "point", {"meshes.vertices": lifted}, 0.02)]
    rows += [Case("C", "one vertex y", "point", {"meshes.vertices": corner}, 0.02)]
    return [*rows, Case("C", "camera x", "point", {"camera.position": axes["x"]}, 0.02)]


def _same_corner() -> np.ndarray:
    """Return the rows of one corner of the box: its triangles share none."""
    vertices = np.asarray(scene_of("point").triangles.vertices)
    return BOX.start + np.flatnonzero(np.all(vertices[BOX] == vertices[BOX.start], axis=-1))


class Renderer:
    """Compiled programs of one scene and group of parameters."""

    def __init__(self, kind: str, names: tuple[str, ...]) -> None:
        self.scene = scene_of(kind)
        parameters = jaxrt.parameters(self.scene)
        self.start = {name: parameters[name] for name in names if name in parameters}
        self.picture = jax.jit(partial(self._picture, boundary_samples=0), static_argnames="spp")
        self.slope = jax.jit(self._slope, static_argnames=("spp", "boundary_samples"))

    def _picture(self, p: Changes, key: int, spp: int, boundary_samples: int) -> Array:
        scene = jaxrt.with_parameters(self.scene, p)
        return jaxrt.render(scene, key, spp=spp, max_depth=1, boundary_samples=boundary_samples)

    def _slope(self, changes: Changes, key: int, spp: int, boundary_samples: int) -> Array:
        picture = partial(self._picture, key=key, spp=spp, boundary_samples=boundary_samples)
        return jax.jvp(picture, (self.start,), (changes,))[1]

    def derivative(self, changes: Changes, samples: int) -> np.ndarray:
        """Return the derivative picture (H, W, 3) with so many edge samples."""
        return np.asarray(self.slope(self._dense(changes), 7, SPP, samples), float)

    def difference(self, changes: Changes, step: float, key: int, spp: int) -> np.ndarray:
        """Return the central difference, both pictures drawn with the same random numbers."""
        ends = [
            self.picture(jax.tree.map(lambda p, d, h=h: p + h * d, self.start, self._dense(changes)), key, spp)
            for h in (step, -step)
        ]
        return (np.asarray(ends[0], float) - np.asarray(ends[1], float)) / (2 * step)

    def _dense(self, changes: Changes) -> Changes:
        zeros = jax.tree.map(jnp.zeros_like, self.start)
        return zeros | {name: jnp.asarray(value, jnp.float32) for name, value in changes.items()}


def cells(picture: np.ndarray) -> np.ndarray:
    """Return means over 4 × 4 pixels."""
    h, w = picture.shape[:2]
    return picture.reshape(h // 4, 4, w // 4, 4, -1).mean((1, 3))


def bumps(picture: np.ndarray) -> np.ndarray:
    """Return 16 means weighted by Gaussians of 6 pixels."""
    h, w = picture.shape[:2]
    y, x = np.mgrid[:h, :w] + 0.5
    places = [((i + 0.5) * h / 4, (j + 0.5) * w / 4) for i in range(4) for j in range(4)]
    weights = np.stack([np.exp(-((y - a) ** 2 + (x - b) ** 2) / 72) for a, b in places])
    return np.einsum("khw,hwc->kc", weights, picture)


def errors(value: np.ndarray, reference: np.ndarray, scale: np.ndarray) -> Errors:
    """Return the distances of `value` to the reference, relative to the size of `scale`."""

    def relative(reduce: Callable[[np.ndarray], np.ndarray]) -> float:
        return float(np.linalg.norm(reduce(value) - reduce(reference)) / np.linalg.norm(reduce(scale)))

    return Errors(relative(cells), relative(bumps))


GROUPS = {
    "lights": ("lights.position", "lights.intensity", "lights.radius"),
    "spheres": ("spheres.center", "spheres.radius"),
    "meshes": ("meshes.vertices",),
    "camera": ("camera.position",),
}


def measure(fd_spp: int) -> tuple[list[list[str]], list[tuple[str, np.ndarray, np.ndarray, np.ndarray]], np.ndarray]:
    """Return the table's rows, the pictures (name, reference, without, with), and the reference of light x, y, z."""
    renderers: dict[tuple[str, str], Renderer] = {}
    rows, pictures, lights = [], [], []
    scale = np.zeros(0)
    for case in cases():
        group = next(iter(case.changes)).split(".")[0]
        key = case.scene, group
        renderer = renderers.setdefault(key, Renderer(case.scene, GROUPS[group]))
        first, second = (renderer.difference(case.changes, case.step, k, fd_spp) for k in KEYS)
        reference = (first + second) / 2
        scale = scale if case.absolute else reference
        found = [renderer.derivative(case.changes, n) for n in (0, *SAMPLES)]
        noise = errors(first, second, scale)
        row = [case.table, case.name, str(Errors(noise.cells / 2, noise.bumps / 2))]
        rows.append(row + [str(errors(value, reference, scale)) for value in found])
        pictures.append((f"{case.table}: {case.name}", reference, found[0], found[-1]))
        if case.table == "A" and case.scene == "point":
            lights.append(reference)
    return rows, pictures, np.stack(lights)


def peer_rows(python: str, reference: np.ndarray) -> list[list[str]]:
    """Return Mitsuba's answers for light x, y, z of table A."""
    command = [python, str(HERE / "mitsuba_gradients.py"), SCENE]
    output = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    rows = []
    for name, answer in json.loads(output.strip().splitlines()[-1]).items():
        told = [answer] * 3
        if not isinstance(answer, str):
            told = [str(errors(np.asarray(v), r, r)) for v, r in zip(answer, reference, strict=True)]
        rows.append([name, *told])
    return rows


def draw(path: str, pictures: list[tuple[str, np.ndarray, np.ndarray, np.ndarray]]) -> None:
    """Save the derivative pictures, red where the picture brightens and blue where it darkens."""
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(3, len(pictures), figsize=(1.7 * len(pictures), 5.4), layout="constrained")
    for column, (title, *maps) in enumerate(pictures):
        limit = np.percentile(np.abs(maps[0].mean(-1)), 99.5)
        for row, picture in enumerate(maps):
            axes[row, column].imshow(picture.mean(-1), cmap="RdBu_r", vmin=-limit, vmax=limit)
            axes[row, column].set(xticks=[], yticks=[])
        axes[0, column].set_title(title.replace(", ", ",\n"), fontsize=7)
    for row, label in enumerate(("finite differences", "without edges", f"{SAMPLES[-1]} edge samples")):
        axes[row, 0].set_ylabel(label, fontsize=8)
    write_whole(Path(path), lambda file: figure.savefig(file, format="png", dpi=110))


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `main`."""
    parser.add_argument("--output", default="docs/derivatives.png", help="where --tables draws its pictures")
    parser.add_argument("--fd-spp", type=int, default=1024, help="of the finite differences of --tables")
    parser.add_argument("--peer-python", help="a Python that has Mitsuba, for both kinds of tables")


def main(options: argparse.Namespace, console: Console) -> int:
    """Print the tables and draw the pictures."""
    python, peer = find_peer(options.peer_python)
    console.print(peer)
    rows, pictures, lights = measure(options.fd_spp)
    table = Table(
        "", "d/d", "noise", "without edges", *(f"n={n}" for n in SAMPLES), title="4×4 cells / smooth functionals"
    )
    for row in rows:
        table.add_row(*row)
    console.print(table)
    if python:
        table = Table("Mitsuba", "light x", "light y", "light z", title="the same errors, table A")
        for row in peer_rows(python, lights):
            table.add_row(*row)
        console.print(table)
    draw(options.output, pictures)
    return 0
