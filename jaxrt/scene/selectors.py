"""Names of parameters with a row: `lights.position[0]`, `materials.albedo[white]`."""

from collections.abc import Sequence
from typing import NamedTuple

from jax import Array

from jaxrt.description import SceneDescription, SceneError, nearest
from jaxrt.description.kinds import LIGHTS, MATERIALS
from jaxrt.scene.measures import has_rows
from jaxrt.scene.names import rows_called
from jaxrt.scene.parameters import parameters
from jaxrt.scene.record import Scene


class Selector(NamedTuple):
    """One row of a parameter, or a parameter that has none."""

    name: str
    row: int | None

    def __str__(self) -> str:
        return self.name if self.row is None else f"{self.name}[{self.row}]"

    def pick(self, value: Array) -> Array:
        """Return the row of a parameter's value."""
        return value if self.row is None else value[self.row]


def parse_selector(text: str, scene: Scene) -> Selector:
    """Return the parameter and row that a text such as `lights.position[0]` names.

    A row may go by its name; a single row may be left out. Raises SceneError for unknown names and rows.
    """
    name, row = rows_called(scene.names, text, parameters(scene))
    if isinstance(row, slice):
        raise SceneError(f"{text}: has {row.stop - row.start} rows: choose one, from {name}[{row.start}] on")
    return select(scene, name, row)


def select(scene: Scene, name: str, row: int | None = None) -> Selector:
    """Return the selector of a parameter's row, which may be None where there is but one. Raises SceneError."""
    values = parameters(scene)
    if name not in values:
        raise SceneError(f"{name}: the scene has no such parameter{nearest(name, values)}")
    if not has_rows(name):
        if row is not None:
            raise SceneError(f"{name}[{row}]: {name} has no rows: write {name}")
        return Selector(name, None)
    n = values[name].shape[0]
    if row is None and n > 1:
        raise SceneError(f"{name}: has {n} rows: choose one, {name}[0] to {name}[{n - 1}]")
    if not 0 <= (row or 0) < n:
        raise SceneError(f"{name}[{row}]: no such row: use {name}[0]" + (f" to {name}[{n - 1}]" if n > 1 else ""))
    return Selector(name, row or 0)


def material_names(description: SceneDescription, name: str) -> Sequence[str]:
    """Return the names of a parameter's rows in order: materials have names, others none."""
    owner, _, field = name.partition(".")
    materials = description.materials.items() if owner == "materials" else ()
    return [key for key, material in materials if field in MATERIALS.kind_of(material).parameters]


def place_in_file(description: SceneDescription, selector: Selector) -> int:
    """Return which table of its sort in the scene file a row belongs to: kinds without the field have no rows."""
    owner, _, field = selector.name.partition(".")
    assert selector.row is not None
    if owner != "lights":
        return selector.row
    return [i for i, light in enumerate(description.lights) if field in LIGHTS.kind_of(light).parameters][selector.row]
