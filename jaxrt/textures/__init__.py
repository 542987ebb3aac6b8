"""All textures of a scene behind `painted`: rows of colours, of which a place on a surface takes some, weighted.

An image's rows are its texels, a checker's its two colours, and those of vertex colours the vertices of meshes. All
stand in one table, so that a ray reads at most four rows of it whatever the number of textures and their sorts.
"""

from dataclasses import replace
from itertools import zip_longest
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxrt.core.pytree import pytree, static
from jaxrt.core.records import Chart
from jaxrt.kernels.gather import take
from jaxrt.textures import checker, image
from jaxrt.textures.recording import Tap, mix, read

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
    layout, own, white = textures.layout, jnp.maximum(number, 0), number < 0
    taps: list[Tap] = []
    sort = take(layout.sort, own)
    for name in textures.sorts:
        here = sort == SORTS.index(name)
        found = _taps(name, layout, own, chart or Chart())
        if found is None:
            white = white | here
        else:
            taps = [_chosen(here, *pair) for pair in zip_longest(found, taps, fillvalue=(0, 0))] if taps else found
    if not taps:
        return jnp.ones(3, textures.texels.dtype)
    first = take(layout.first, own)
    # Who has no texture reads the same few rows as all such, which are in the cache
    taps = [(jnp.where(white, 0, first + row), weight) for row, weight in taps]
    color = mix(textures.texels, taps) if mark is None else read(textures.texels, taps, mark)
    return jnp.where(white, 1, color)


def _chosen(here: Array, own: Any, other: Any) -> Tap:
    """Return one of two rows, each with its weight. A sort that takes fewer rows has 0s in their places."""
    return jnp.where(here, own[0], other[0]), jnp.where(here, own[1], other[1])


def _taps(sort: str, layout: Layout, number: Array, chart: Chart) -> list[Tap] | None:
    """Return rows of a texture and their weights, None on surfaces that have no place for its sort."""
    if sort == "vertex_colors":
        if chart.vertices is None or chart.shares is None:
            return None
        return list(zip(chart.vertices, chart.shares, strict=True))
    if chart.uv is None:
        return None
    uv = chart.uv * take(layout.scale, number)
    if sort == "checker":
        return [(checker.row(uv), jnp.ones((), uv.dtype))]
    height, width = take(layout.size, number)
    return image.taps(uv, (height, width), take(layout.clamp, number))
