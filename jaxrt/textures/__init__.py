"""All textures of a scene behind `painted`: rows of colours, of which a place on a surface takes some, weighted.

An image's rows are its texels, a checker's its two colours, and those of vertex colours the vertices of meshes. All
stand in one table, so that a ray reads four rows of it whatever the number of textures and their sorts.
"""

from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxrt.core.pytree import pytree, static
from jaxrt.core.records import Chart
from jaxrt.kernels.gather import take
from jaxrt.textures import checker, image
from jaxrt.textures.recording import mix, read

SORTS = ("image", "checker", "vertex_colors")


@pytree
class Layout:
    """Where each texture's rows are, and how they are found. Without derivative."""

    first: Array  # (t,) int32 the first row
    size: Array  # (t, 2) int32 rows and columns of an image
    clamp: Array  # (t,) bool, whether an image's border goes on
    scale: Array  # (t, 2) how often it repeats along u and v
    sort: Array  # (t,) int32 number in SORTS


@pytree
class Textures:
    """The textures of a scene, and which of them each material's fields are multiplied by."""

    texels: Array  # (n, 3) linear, in [0, 1]
    layout: Layout
    maps: dict[str, dict[str, Array]]  # by kind and field: (m,) int32 texture of each of the kind's materials, or −1
    shapes: tuple[tuple[int, ...], ...] = static()  # of each texture's rows
    sorts: tuple[str, ...] = static()  # those that there are
    names: tuple[str, ...] = static()  # for parameters alone
    marks: Array | None = None  # (slots, 15) zeros, by whose derivative a lookup tells what it read; see `recording`

    @property
    def slots(self) -> list[tuple[str, str]]:
        """Kind and field of each lookup that a surface may take."""
        return [(kind, field) for kind in sorted(self.maps) for field in sorted(self.maps[kind])]

    def named(self) -> dict[str, Array]:
        """Return the texels of each texture by its name: images (h, w, 3), checkers (2, 3), vertices (v, 3)."""
        ends = np.cumsum([int(np.prod(shape)) for shape in self.shapes])
        parts = zip(self.names, self.shapes, ends, strict=True)
        return {name: self.texels[end - int(np.prod(shape)) : end].reshape(*shape, 3) for name, shape, end in parts}

    def with_named(self, new: dict[str, Array]) -> "Textures":
        """Return the textures with new texels of some."""
        texels = [value.reshape(-1, 3) for value in (self.named() | new).values()]
        return replace(self, texels=texels[0] if len(texels) == 1 else jnp.concatenate(texels))


def painted(textures: Textures, kind: str, one: Any, row: Array, chart: Chart | None, again: bool = False) -> Any:
    """Return one material of a kind with its fields multiplied by their textures.

    row: () int32 of the material among those of its kind. A single number is multiplied by the channels' mean.
    again: whether this is the second lookup at a point.
    """
    new = {}
    for field, numbers in textures.maps.get(kind, {}).items():
        slot = textures.slots.index((kind, field)) + (len(textures.slots) if again else 0)
        mark = None if textures.marks is None else textures.marks[slot]
        value, color = getattr(one, field), color_at(textures, take(numbers, row), chart, mark)
        new[field] = value * (color if value.ndim else jnp.mean(color))
    return replace(one, **new)


def color_at(textures: Textures, number: Array, chart: Chart | None, mark: Array | None = None) -> Array:
    """Return the colour (3,) of a texture at a place of a surface: white of texture −1, and where it has no place.

    mark: (15,) as in `recording.read`.
    """
    chart = chart or Chart()
    layout, own = textures.layout, jnp.maximum(number, 0)
    rows, weights = jnp.zeros(4, jnp.int32), jnp.zeros(4, textures.texels.dtype)
    white = number < 0
    sort = take(layout.sort, own)
    for name in textures.sorts:
        here = sort == SORTS.index(name)
        found = _taps(name, layout, own, chart)
        if found is None:
            white = white | here
        elif len(textures.sorts) == 1:
            rows, weights = found
        else:
            rows, weights = (jnp.where(here, a, b) for a, b in zip(found, (rows, weights), strict=True))
    # Who has no texture reads the same few rows as all such, which are in the cache
    rows = jnp.where(white, 0, take(layout.first, own) + rows)
    color = mix(take(textures.texels, rows), weights) if mark is None else read(textures.texels, rows, weights, mark)
    return jnp.where(white, 1, color)


def _taps(sort: str, layout: Layout, number: Array, chart: Chart) -> tuple[Array, Array] | None:
    """Return rows (4,) of a texture and their weights (4,), None on surfaces that have no place for its sort."""
    if sort == "vertex_colors":
        if chart.vertices is None or chart.shares is None:
            return None
        return jnp.append(chart.vertices, 0), jnp.append(chart.shares, 0)
    if chart.uv is None:
        return None
    uv = chart.uv * take(layout.scale, number)
    if sort == "checker":
        row = checker.row(uv)
        return jnp.stack([row, *[jnp.zeros_like(row)] * 3]), lax.stop_gradient(jnp.asarray([1, 0, 0, 0], uv.dtype))
    height, width = take(layout.size, number)
    return image.taps(uv, (height, width), take(layout.clamp, number))
