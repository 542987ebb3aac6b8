"""The materials of a scene by kind, and the rows in which `parameters` lists their fields: those of the scene file.

Kinds share a parameter where they share a field's name: `materials.albedo` has a row for each material that has one.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import DTypeLike

from jaxrt.description import SceneDescription
from jaxrt.description.kinds import MATERIALS
from jaxrt.materials import Materials
from jaxrt.scene.measures import TEXTURES
from jaxrt.scene.record import Scene
from jaxrt.textures.stack import textures_of


class Listed(NamedTuple):
    """The materials by kind; the row that shapes have of each name; and what `parameters` lists, by field."""

    materials: Materials
    rows: dict[str, int]
    idle: dict[str, Array]
    order: dict[str, Array]


def list_materials(scene: SceneDescription, dtype: DTypeLike, origin: np.ndarray) -> Listed:
    """Return the materials that something is made of as rows, and the parameters of all."""
    made: dict[str, list[str]] = {}
    for name in filter(scene.used.__contains__, scene.materials):
        made.setdefault(MATERIALS.kind_of(scene.materials[name]).name, []).append(name)
    tables = {kind: [scene.materials[name] for name in names] for kind, names in made.items()}
    stacks = {kind: MATERIALS.kinds[kind].stack(own, dtype, origin) for kind, own in tables.items()}
    materials = Materials.of(textures_of(scene, tables, dtype), **stacks)
    numbered = [name for kind in materials.kinds for name in made[kind.kind.name]]
    fields = scene.material_fields
    idle, order = {}, {}
    for field in {field: None for own in fields.values() for field in own}:
        owners = [name for name, own in fields.items() if field in own]
        spare = [name for name in owners if name not in scene.used]
        listed = [name for name in [*numbered, *spare] if name in owners]
        order[field] = jnp.asarray([listed.index(name) for name in owners], jnp.int32)
        if spare:
            values = np.asarray([getattr(scene.materials[name], field) for name in spare], float)
            measure = fields[spare[0]][field]
            idle[field] = jnp.asarray(values - origin if measure.range == "place" else values, dtype)
    return Listed(materials, {name: row for row, name in enumerate(numbered)}, idle, order)


def material_parameters(scene: Scene) -> Iterator[tuple[str, Array]]:
    """Yield name and value of each parameter of materials, rows in the order of the scene file."""
    order = scene.order or {}
    for name in MATERIALS.parameters:
        if (field := name.split(".")[1]) in order:
            yield name, jnp.concatenate(_parts(scene, field))[order[field]]


def with_material_parameters(scene: Scene, new: Mapping[str, Array]) -> tuple[Materials, dict[str, Array] | None]:
    """Return the materials and the idle rows with new values of some fields."""
    materials, idle, order = scene.materials, scene.idle or {}, scene.order or {}
    for field, value in new.items():
        ends = np.cumsum([len(part) for part in _parts(scene, field)])
        rows = iter(jnp.split(value[jnp.argsort(order[field])], ends[:-1]))
        for kind in _owners(scene, field):
            changed = replace(getattr(materials, kind), **{field: next(rows)})
            materials = replace(materials, **{kind: changed})
        if field in idle:
            idle = {**idle, field: next(rows)}
    return materials, None if scene.idle is None else idle


def _owners(scene: Scene, field: str) -> list[str]:
    """Return the kinds that have a parameter, in the order of their rows."""
    kinds = scene.materials.kinds
    return [k.kind.name for k in kinds if field in k.kind.parameters and getattr(k, field) is not None]


def _parts(scene: Scene, field: str) -> list[Array]:
    """Return the rows of a field, kind by kind, and then those of materials that nothing is made of."""
    parts = [getattr(getattr(scene.materials, kind), field) for kind in _owners(scene, field)]
    return [*parts, scene.idle[field]] if scene.idle and field in scene.idle else parts


def texture_parameters(materials: Materials) -> dict[str, Array]:
    """Return the texels of each texture by the name of its parameter."""
    textures = materials.textures
    return {} if textures is None else {TEXTURES + name: texels for name, texels in textures.named().items()}


def with_texture_parameters(materials: Materials, new: Mapping[str, Array]) -> Materials:
    """Return the materials with new texels of some textures."""
    own = {name.removeprefix(TEXTURES): texels for name, texels in new.items() if name.startswith(TEXTURES)}
    if not own:
        return materials
    return replace(materials, textures=materials.textures.with_named(own))
