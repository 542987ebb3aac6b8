"""What the rows of parameters can be called: `materials.albedo[ball]`, `meshes.vertices[mug]`.

Names are no part of what is computed. They compare equal whatever they say, so that a renamed scene has the structure
of the one before, and finds its programs.
"""

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

from jaxrt.description import SceneDescription, SceneError, nearest, show
from jaxrt.description.kinds import LIGHTS
from jaxrt.scene.measures import has_rows

SELECTOR = re.compile(r"(?P<name>[^\[\]]+)(\[(?P<row>.+)\])?")
DIGITS = 18  # of a row's number, at most
SINGULAR = {"materials": "material", "lights": "light", "spheres": "sphere", "meshes": "mesh", "groups": "group"}
Row = int | slice


class Material(NamedTuple):
    """A material that something is made of."""

    row: int
    number: int  # in the scene file


class Things(NamedTuple):
    """What can be seen, by name, and where meshes begin and end."""

    spheres: Mapping[str, int] = {}
    lights: Mapping[str, int] = {}  # number among those that are balls or points
    meshes: Mapping[str, tuple[int, int]] = {}  # first and end of its faces
    materials: Mapping[str, Material] = {}
    faces: tuple[int, ...] = ()  # of each mesh


class Names:
    """The rows that have names: parameter, or owner of parameters, to name to row, or rows; and the things."""

    def __init__(self, rows: Mapping[str, Mapping[str, Row]] | None = None, things: Things | None = None) -> None:
        self.rows, self.things = rows or {}, things or Things()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Names)

    def __hash__(self) -> int:
        return 0

    def __repr__(self) -> str:
        return "Names()"  # a program's key holds it

    def of(self, parameter: str) -> Mapping[str, Row]:
        """Return the named rows of a parameter."""
        owner = parameter.partition(".")[0]
        return self.rows.get(parameter) or self.rows.get(owner) or {}


def names_of(scene: SceneDescription, materials: Mapping[str, int]) -> Names:
    """Return the names in a description: of materials and groups, of spheres, lights and meshes that have one.

    materials: the row of each that something is made of.

    A mesh without one goes by its file's name without suffix where no other does, or else by `mesh0`, `mesh1`, ….
    """
    fields: dict[str, list[str | None]] = {"spheres": [sphere.name for sphere in scene.spheres]}
    fields["groups"] = list(scene.groups)
    for name, own in scene.material_fields.items():
        for field in own:
            fields.setdefault(f"materials.{field}", []).append(name)
    for light in scene.lights:
        for field in LIGHTS.kind_of(light).parameters:
            fields.setdefault(f"lights.{field}", []).append(getattr(light, "name", None))
    numbered = {key: {name: i for i, name in enumerate(names) if name is not None} for key, names in fields.items()}
    rows: dict[str, Mapping[str, Row]] = {**numbered}
    counts = [len(mesh.vertices) for mesh in scene.meshes], [len(mesh.kept) for mesh in scene.meshes]
    vertices, faces = ([0, *np.cumsum(each).tolist()] for each in counts)
    meshes = dict(_meshes(scene))
    rows["meshes.vertices"] = {name: slice(vertices[i], vertices[i + 1]) for name, i in meshes.items()}
    rows["meshes"] = meshes
    lamps = [light for light in scene.lights if light.type == LIGHTS.default]
    numbers = {name: i for i, name in enumerate(scene.materials)}
    things = Things(
        spheres=numbered["spheres"],
        lights={light.name: i for i, light in enumerate(lamps) if light.name is not None},
        meshes={name: (faces[i], faces[i + 1]) for name, i in meshes.items()},
        materials={name: Material(row, numbers[name]) for name, row in materials.items()},
        faces=tuple(counts[1]),
    )
    return Names(rows, things)


def _meshes(scene: SceneDescription) -> Iterator[tuple[str, int]]:
    """Yield each mesh's name and number."""
    given = [mesh.name for mesh in scene.meshes]
    stems = [None if mesh.file is None else Path(mesh.file).stem for mesh in scene.meshes]
    count = Counter([*given, *(stem for name, stem in zip(given, stems, strict=True) if name is None)])
    for i, stem in enumerate(stems):
        name = given[i] or (stem if stem and count[stem] == 1 else f"mesh{i}")
        if given[i] or name not in given:
            yield name, i


def rows_called(names: Names, text: str, parameters: Mapping[str, jax.Array]) -> tuple[str, Row | None]:
    """Return the parameter and the row, or rows, that a text such as `lights.position[0]` or `[lamp]` names.

    None for all of a parameter. parameters: those of the scene. Raises SceneError for what is not there.
    """
    match = SELECTOR.fullmatch(text.strip()) if isinstance(text, str) else None
    if match is None:
        raise SceneError(f"{show(text)}: is no parameter: write NAME or NAME[ROW], as in lights.position[0]")
    name, row = match["name"], match["row"]
    if name not in parameters:
        raise SceneError(f"{name}: the scene has no such parameter{nearest(name, parameters)}")
    if row is None:
        return name, None
    if not has_rows(name):
        raise SceneError(f"{name}[{row}]: {name} has no rows: write {name}")
    called, n = names.of(name), parameters[name].shape[0]
    # A number is one, also where a thing goes by it
    if re.fullmatch(r"[+-]?\d+", row):
        # Python reads no number of thousands of digits
        if len(row) > DIGITS or not 0 <= int(row) < n:
            raise SceneError(f"{name}[{row}]: no such row: use {name}[0]" + (f" to {name}[{n - 1}]" if n > 1 else ""))
        return name, int(row)
    if row in called:
        return name, called[row]
    if not called:
        raise SceneError(f"{name}[{row}]: {show(row)} is not a row number: write {name}[0]")
    owner = name.partition(".")[0]
    raise SceneError(f"{name}[{row}]: no {SINGULAR[owner]} of that name{nearest(row, called)}")
