"""Several views of one scene as one tall picture: one below the other, filled up on the right where one is narrower.

All that judges a picture then judges them together. What fills up has no weight. Cameras that are alike but in values
share one program.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxrt.description import SceneError
from jaxrt.fit.unknowns import Unknowns
from jaxrt.scene import Scene
from jaxrt.scene.parameters import parameters

STRIDE = np.uint32(2654435769)  # between the seeds of two views: their noise is not alike

Draw = Callable[[Scene, Array], Array]  # (scene, seed) -> picture (height, width, channels)


def tall(pictures: Sequence[Array]) -> Array:
    """Return the pictures (height, width, channels) one below the other, 0 where one is narrower than another."""
    if len(pictures) == 1:
        return pictures[0]
    width = max(picture.shape[1] for picture in pictures)
    return jnp.concatenate([jnp.pad(p, ((0, 0), (0, width - p.shape[1]), (0, 0))) for p in pictures])


def draw_views(draw: Draw, scene: Scene, cameras: Sequence[Any], seed: Array) -> Array:
    """Return the tall picture of what all cameras see, each with a seed of its own: differentiable in the scene."""
    groups: dict[Any, list[int]] = {}
    for i, camera in enumerate(cameras):
        groups.setdefault(jax.tree.structure(camera), []).append(i)
    pictures: dict[int, Array] = {}
    for numbers in groups.values():
        seeds = jnp.stack([seed + jnp.uint32(i) * STRIDE for i in numbers])
        stacked = jax.tree.map(lambda *values: jnp.stack(values), *(cameras[i] for i in numbers))
        drawn = lax.map(lambda view: draw(replace(scene, camera=view[0]), view[1]), (stacked, seeds))
        pictures |= dict(zip(numbers, drawn, strict=True))
    return tall([pictures[i] for i in range(len(cameras))])


def check_views(scenes: Sequence[Scene], unknowns: Unknowns) -> None:
    """Raise SceneError where views show different scenes, or cameras differ in what is sought of all of them."""
    first, structure = _all_but_camera(scenes[0])
    for i, scene in enumerate(scenes[1:], 1):
        leaves, own = _all_but_camera(scene)
        if structure != own or not all(map(_equal, first, leaves)):
            raise SceneError(f"scene[{i}]: is another than scene[0]: views of one scene differ in their cameras alone")
    for row in unknowns.rows:
        if row.selector.name.startswith("camera."):
            values = [parameters(scene).get(row.selector.name) for scene in scenes]
            if any(value is None or not _equal(values[0], value) for value in values):
                raise SceneError(
                    f"{row.text}: cameras differ in it, and one value is sought for all: set it alike, or fit it in a "
                    "program of your own"
                )


def _all_but_camera(scene: Scene) -> tuple[list[Any], Any]:
    """Return leaves and structure of all else in a scene."""
    return jax.tree.flatten(replace(scene, camera=None))


def _equal(a: Any, b: Any) -> bool:
    return a is b or np.array_equal(np.asarray(a), np.asarray(b))
