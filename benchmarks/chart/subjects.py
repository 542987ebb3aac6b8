"""The scenes of the charts, and jaxrt's ways to draw them."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import jaxrt
from benchmarks.clock import cpu_seconds
from jaxrt.io import read_description
from jaxrt.render import draw_sum, prepare
from jaxrt.transport.film import Plan, Run

Drawn = dict[int, tuple[np.ndarray, float]]  # spp -> image (H, W, 3) float64 and the CPU seconds it took
Draw = Callable[[int, Sequence[int]], Drawn]  # (seed, rising numbers of samples wanted) -> images


class Subject(NamedTuple):
    """A scene of the charts."""

    title: str
    path: str
    files: tuple[str, ...] = ()  # that the scene file names
    size: int = 64

    def scene(self, dtype: Any = jnp.float32) -> jaxrt.Scene:
        """Return the scene as a square picture, its meshes flat: other renderers shade smooth ones differently."""
        scene = jaxrt.build(read_description(self.path), dtype)
        triangles = None if scene.triangles is None else replace(scene.triangles, smooth=None)
        return replace(scene, camera=replace(scene.camera, width=self.size, height=self.size), triangles=triangles)

    def contents(self) -> list[Path]:
        """Return the files that say what is in it."""
        return [Path(self.path), *map(Path, self.files)]


POINT = Subject("room with a point light, direct light", "scenes/seed/ball_in_room_hard_shadow.toml")
SPHERE = Subject("room with a spherical light, indirect light", "scenes/seed/soft_shadow_indirect.toml")
GLASS = Subject("room with mirror and glass, spherical light", "scenes/room.toml")
MESH = Subject("room with a mesh of 26,000 faces", "scenes/seed/mesh_in_room.toml", ("scenes/cat.obj",))
SHADOW = Subject("ball on a floor, point light", "scenes/ball_on_floor.toml")


def picture_method(scene: jaxrt.Scene, **options: Any) -> Draw:
    """Return how `jaxrt.render` draws a scene: one call for each number of samples."""

    def draw(seed: int, lengths: Sequence[int]) -> Drawn:
        drawn = {}
        for spp in lengths:
            image, seconds = cpu_seconds(partial(jaxrt.render, scene, seed, spp=spp, **options))
            drawn[spp] = np.asarray(image, np.float64), seconds
        return drawn

    return draw


def draw_as_render(scene: jaxrt.Scene, run: Run, plan: Plan) -> Any:
    """Return the sum of the samples of `run` by the very program that `jaxrt.render` calls."""
    return draw_sum(scene, run, plan, run)


def prefix_method(
    scene: jaxrt.Scene, program: Callable[[jaxrt.Scene, Run, Plan], Any] = draw_as_render, **options: Any
) -> Draw:
    """Return the same for samplers whose first samples do not depend on how many follow: all lengths from one run.

    A length's time is that of the run up to there.
    """

    def draw(seed: int, lengths: Sequence[int]) -> Drawn:
        drawn, total, spent, first = {}, np.zeros(()), 0.0, 0
        for spp in lengths:

            def rest(first: int = first, spp: int = spp) -> Any:
                return program(*prepare(scene, seed, first, spp - first, spp, **options))

            image, seconds = cpu_seconds(rest)
            total, spent, first = total + np.asarray(image, np.float64), spent + seconds, spp
            drawn[spp] = total / spp, spent
        return drawn

    return draw


def jaxrt_method(scene: jaxrt.Scene, sampler: str = "sobol", **options: Any) -> Draw:
    """Return the cheapest of the two above that draws the same pictures."""
    method = picture_method if sampler == "stratified" else prefix_method
    return method(scene, sampler=sampler, **options)


def in_float64(draw: Draw) -> Draw:
    """Return a method that runs with JAX's 64-bit types on."""

    def wide(seed: int, lengths: Sequence[int]) -> Drawn:
        with jax.enable_x64(True):
            return draw(seed, lengths)

    return wide
