"""From the textures of a description to one table of texels."""

from collections.abc import Mapping, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import DTypeLike

from jaxrt.description import SceneDescription
from jaxrt.description.textures import CheckerTexture, ImageTexture, painted_fields, texture_of, textures_used
from jaxrt.textures import SORTS, Layout, Textures


def textures_of(scene: SceneDescription, made: Mapping[str, Sequence[Any]], dtype: DTypeLike) -> Textures | None:
    """Return the textures of the materials that something is made of; None where there are none.

    made: tables of the materials by kind, in the order of their rows.
    """
    names = textures_used(scene)
    if not names:
        return None
    rows = {name: _rows(scene, name) for name in names}
    first = np.cumsum([0] + [texels.size // 3 for texels in rows.values()])[:-1]
    tables = [scene.textures[name] for name in names]
    texels = np.concatenate([texels.reshape(-1, 3) for texels in rows.values()])
    shapes = tuple(tuple(texels.shape[:-1]) for texels in rows.values())
    sizes = [shape if isinstance(table, ImageTexture) else (1, 1) for table, shape in zip(tables, shapes, strict=True)]
    layout = Layout(
        first=jnp.asarray(first, jnp.int32),
        size=jnp.asarray(sizes, jnp.int32),
        clamp=jnp.asarray([getattr(table, "wrap", None) == "clamp" for table in tables]),
        scale=jnp.asarray([getattr(table, "scale", (1.0, 1.0)) for table in tables], dtype),
        sort=jnp.asarray([SORTS.index(table.type) for table in tables], jnp.int32),
    )
    sorts = tuple(sort for sort in SORTS if any(table.type == sort for table in tables))
    return Textures(jnp.asarray(texels, dtype), layout, _maps(made, names), shapes, sorts, tuple(names))


def _rows(scene: SceneDescription, name: str) -> np.ndarray:
    """Return the rows of colours (…, 3) of a texture."""
    table = scene.textures[name]
    if isinstance(table, ImageTexture):
        texels: np.ndarray = table.texels
        return texels
    if isinstance(table, CheckerTexture):
        return np.asarray(table.colors, float)
    colors = [np.ones((len(m.vertices), 3)) if m.colors is None else m.colors for m in scene.meshes]
    return np.concatenate([*colors, np.ones((3 * len(scene.triangles), 3))])


def _maps(made: Mapping[str, Sequence[Any]], names: Sequence[str]) -> dict[str, dict[str, Array]]:
    maps: dict[str, dict[str, Array]] = {}
    for kind, tables in made.items():
        for field in sorted({field for table in tables for field, _ in painted_fields(table)}):
            own = [texture_of(getattr(table, field)) for table in tables]
            numbers = [-1 if name is None else names.index(name) for name in own]
            maps.setdefault(kind, {})[field] = jnp.asarray(numbers, jnp.int32)
    return maps


def asks(scene: SceneDescription, materials: Sequence[str]) -> tuple[bool, bool]:
    """Return whether textures of some materials ask for places uv, and whether for vertices."""
    found = {scene.textures[texture].type for name in materials for _, texture in painted_fields(scene.materials[name])}
    return bool(found - {"vertex_colors"}), "vertex_colors" in found
