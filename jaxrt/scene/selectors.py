"""Names of parameters with a row: `lights.position[0]`, `materials.albedo[white]`."""

from typing import NamedTuple

from jax import Array

from jaxrt.description import SceneDescription, SceneError
from jaxrt.description.kinds import LIGHTS
from jaxrt.scene.measures import has_rows
from jaxrt.scene.names import rows_called
from jaxrt.scene.parameters import asked, parameters
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
    values = parameters(asked(scene, [text]))
    name, row = rows_called(scene.names, text, values)
    if isinstance(row, slice):
        raise SceneError(f"{text}: has {row.stop - row.start} rows: choose one, from {name}[{row.start}] on")
    if not has_rows(name):
        return Selector(name, None)
    n = values[name].shape[0]
    if row is None and n > 1:
        raise SceneError(f"{name}: has {n} rows: choose one, {name}[0] to {name}[{n - 1}]")
    return Selector(name, row or 0)


def select(scene: Scene, name: str, row: int | None = None) -> Selector:
    """Return the selector of a parameter's row, which may be None where there is but one. Raises SceneError."""
    return parse_selector(name if row is None else f"{name}[{row}]", scene)


def place_in_file(description: SceneDescription, selector: Selector) -> str | int:
    """Return which table of its sort in the scene file a row belongs to: the name of a material or group, or a number.

    Kinds without the field have no rows.
    """
    owner, _, field = selector.name.partition(".")
    assert selector.row is not None
    if owner == "materials":
        return [name for name, own in description.material_fields.items() if field in own][selector.row]
    if owner == "lights":
        lights = enumerate(description.lights)
        return [i for i, table in lights if field in LIGHTS.kind_of(table).parameters][selector.row]
    if owner == "groups":
        return list(description.groups)[selector.row]
    return selector.row
