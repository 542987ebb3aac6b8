"""What a scene is, in words and plain numbers: the validated form of a scene file or of a dict."""

import re
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, NamedTuple, Self

import numpy as np
from pydantic import (
    BaseModel,
    BeforeValidator,
    PlainValidator,
    ValidationError,
    model_validator,
)

from jaxrt.core.messages import SceneError, SceneWarning, nearest, show
from jaxrt.description.kinds import CAMERAS, LIGHTS, MATERIALS
from jaxrt.description.mesh import MeshDescription
from jaxrt.description.mesh_facts import COLLINEAR
from jaxrt.description.pose import GroupDescription, joined
from jaxrt.description.textures import check_places, check_textures
from jaxrt.description.values import (
    FLOAT32_TINY,
    LONGEST,
    SHORTEST,
    Count,
    Measure,
    Name,
    Number,
    Pair,
    Radius,
    Rgb,
    Table,
    Vector,
    complaint,
    tables,
    three,
    told,
)
from jaxrt.filters import BOX, filter_of

__all__ = [
    "EnvironmentDescription",
    "GroupDescription",
    "MaterialDescription",
    "MeshDescription",
    "RenderDefaults",
    "SceneDescription",
    "SceneError",
    "SceneWarning",
    "Solid",
    "SphereDescription",
    "TriangleDescription",
    "nearest",
    "parse_description",
    "show",
]


class RenderDefaults(Table):
    """What `render` uses where it is not told otherwise."""

    spp: Count = 64
    max_depth: Count = 5
    filter: Name = BOX
    filter_width: Number | None = None  # pixels, from end to end

    @model_validator(mode="after")
    def _check_filter(self) -> Self:
        try:
            filter_of(self.filter, self.filter_width)
        except ValueError as error:
            key, told = str(error).split(": ", 1)
            raise complaint(told, key) from None
        return self


class EnvironmentDescription(Table):
    """A constant environment, W·sr⁻¹·m⁻²."""

    radiance: Rgb


MaterialDescription = Annotated[Table, PlainValidator(MATERIALS.validate)]  # of the kind that its type names


SHARES = ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))  # what corners have, for places to be those of the second and the third


class SphereDescription(Table):
    """A sphere."""

    center: Vector
    radius: Radius
    material: Name
    name: Name | None = None
    group: Name | None = None  # with which it is placed


class TriangleDescription(Table):
    """A triangle, two-sided where its material is."""

    vertices: Annotated[tuple[Vector, Vector, Vector], BeforeValidator(three)]
    material: Name
    uv: Annotated[tuple[Pair, Pair, Pair], BeforeValidator(three)] = SHARES

    @model_validator(mode="after")
    def _check_area(self) -> Self:
        a, b, c = np.array(self.vertices)
        doubled = np.linalg.norm(np.cross(b - a, c - a))
        longest = max(np.linalg.norm(b - a), np.linalg.norm(c - a), np.linalg.norm(c - b))
        if doubled <= COLLINEAR * longest**2:
            raise complaint(f"{show(self.vertices)} has no area: move a vertex or remove it", "vertices")
        if doubled**2 < FLOAT32_TINY:
            raise complaint(f"area {doubled / 2:.2g} is too small for float32: scale the scene up", "vertices")
        return self


Solid = SphereDescription | TriangleDescription


def _check_types(value: Any) -> Any:
    """Refuse materials without a known type, before the type picks their model."""
    if not isinstance(value, Mapping):
        raise complaint(f"{show(value)} is not a table: write [materials.NAME]")
    for name, material in value.items():
        if isinstance(material, BaseModel):
            continue
        if not isinstance(material, Mapping):
            raise complaint(f"{show(material)} is not a table: write [materials.{name}]", str(name))
        MATERIALS.check_type(material, str(name))
    return value


def _check_groups(value: Any) -> Any:
    if not isinstance(value, Mapping):
        raise complaint(f"{show(value)} is not a table: write [groups.NAME]")
    return value


class Lamp(NamedTuple):
    """A light that shines from a place."""

    number: int  # in the scene file
    position: np.ndarray  # (3,)
    radius: float  # 0 for a point


class SceneDescription(Table):
    """A whole scene. Rows of `spheres`, `meshes`, `triangles` and `lights` keep the order of the file."""

    # Before `camera`, so that what is wrong in the first of several is told of these
    cameras: Annotated[tuple[Annotated[Any, BeforeValidator(CAMERAS.validate)], ...], BeforeValidator(tables)] = ()
    camera: Annotated[Any, BeforeValidator(CAMERAS.validate)]
    render: RenderDefaults = RenderDefaults()
    environment: EnvironmentDescription | None = None
    textures: Annotated[dict[Name, Any], BeforeValidator(check_textures)] = {}
    materials: Annotated[dict[Name, MaterialDescription], BeforeValidator(_check_types)] = {}
    groups: Annotated[dict[Name, GroupDescription], BeforeValidator(_check_groups)] = {}
    spheres: Annotated[tuple[SphereDescription, ...], BeforeValidator(tables)] = ()
    meshes: Annotated[tuple[MeshDescription, ...], BeforeValidator(tables)] = ()
    triangles: Annotated[tuple[TriangleDescription, ...], BeforeValidator(tables)] = ()
    lights: Annotated[tuple[Annotated[Any, BeforeValidator(LIGHTS.validate)], ...], BeforeValidator(tables)] = ()

    @property
    def flat(self) -> "SceneDescription":
        """The same scene without groups: what they hold is where they place it."""
        if not self.groups:
            return self
        spheres = tuple(self._flat_sphere(sphere) for sphere in self.spheres)
        meshes = tuple(self._flat_mesh(mesh) for mesh in self.meshes)
        fields = {name: getattr(self, name) for name in type(self).model_fields}
        return type(self).model_construct(**fields | {"groups": {}, "spheres": spheres, "meshes": meshes})

    def _flat_sphere(self, sphere: SphereDescription) -> SphereDescription:
        if sphere.group is None:
            return sphere
        group = self.groups[sphere.group]
        (center,) = group.placed(np.asarray([sphere.center], float)).tolist()
        return sphere.model_copy(update={"center": tuple(center), "radius": group.scale * sphere.radius, "group": None})

    def _flat_mesh(self, mesh: MeshDescription) -> MeshDescription:
        if mesh.group is None:
            return mesh
        # Not a copy, which would bring along where the mesh stands by itself
        fields = {name: getattr(mesh, name) for name in type(mesh).model_fields}
        return type(mesh).model_construct(**fields | joined(mesh, self.groups[mesh.group]) | {"group": None})

    @property
    def eye(self) -> np.ndarray | None:
        """Where the camera is, (3,); None where it has no place."""
        place = CAMERAS.kind_of(self.camera).anchor
        return None if place is None else np.asarray(getattr(self.camera, place), float)

    @property
    def lamps(self) -> list[Lamp]:
        """The lights that shine from a place."""
        return [
            Lamp(i, np.asarray(light.position, float), getattr(light, "radius", 0.0))
            for i, light in enumerate(self.lights)
            if hasattr(light, "position")
        ]

    @property
    def used(self) -> set[str]:
        """Names of the materials that something is made of."""
        solids: list[Solid] = [*self.spheres, *self.triangles]
        from_meshes = {mesh.names[row] for mesh in self.meshes for row in np.unique(mesh.rows)}
        return from_meshes | {solid.material for solid in solids}

    @property
    def material_fields(self) -> dict[str, dict[str, Measure]]:
        """Parameters of each material: of optional ones those that it, or another that is used as it, gives."""
        used, alike, fields = self.used, dict[str, list[Any]](), {}
        for name in used:
            alike.setdefault(MATERIALS.kind_of(self.materials[name]).name, []).append(self.materials[name])
        for name, table in self.materials.items():
            kind = MATERIALS.kind_of(table)
            tables = alike[kind.name] if name in used else [table]
            fields[name] = {
                field: measure
                for field, measure in kind.parameters.items()
                if field not in kind.optional or any(getattr(each, field) is not None for each in tables)
            }
        return fields

    @property
    def origin(self) -> np.ndarray:
        """Middle (3,) of camera, lights, meshes, triangles and all but huge spheres if that is far off, else zeros.

        What is far off is computed with relative to it, since float32 coordinates near 1e6 are 1/16 apart.
        """
        eye = self.eye
        if eye is None:  # whatever it is counted from stays where it is
            return np.zeros(3)
        points = [eye, *(lamp.position for lamp in self.lamps)]
        points += [np.asarray(corner, float) for t in self.triangles for corner in t.vertices]
        points += [corner for mesh in self.meshes for corner in (mesh.world.min(axis=0), mesh.world.max(axis=0))]
        for sphere in self.spheres:
            center = np.asarray(sphere.center, float)
            if 2 * sphere.radius < np.linalg.norm(center - eye):
                points += [center - sphere.radius, center + sphere.radius]
        low, high = np.min(points, axis=0), np.max(points, axis=0)
        middle = (low + high) / 2
        return middle if np.linalg.norm(middle) > 8 * np.linalg.norm(high - low) else np.zeros(3)

    @property
    def views(self) -> tuple[Any, ...]:
        """The cameras: that of `camera`, or all of `cameras`, whose first it then is."""
        return (self.camera, *self.cameras[1:])

    @model_validator(mode="before")
    @classmethod
    def _look_through_the_first(cls, value: Any) -> Any:
        """Let the first of several cameras be that of the scene."""
        if not isinstance(value, Mapping) or "cameras" not in value:
            return value
        if "camera" in value:
            raise complaint("stand beside [camera]: write that as the first of [[cameras]]", "cameras")
        cameras = value["cameras"]
        if not isinstance(cameras, list | tuple) or not cameras:
            raise complaint("is no list of cameras: write tables [[cameras]] with position = [0, 0, 55]", "cameras")
        return {**value, "camera": cameras[0]}

    @model_validator(mode="before")
    @classmethod
    def _take_mesh_materials(cls, value: Any) -> Any:
        """Add the materials and textures that meshes bring along; one of that name in the scene wins."""
        if not isinstance(value, Mapping) or not isinstance(value.get("meshes"), list | tuple):
            return value
        value = dict(value)
        for sort in ("materials", "textures"):
            own: dict[str, Any] = {}
            for mesh in value["meshes"]:
                if isinstance(mesh, Mapping) and "material" not in mesh and isinstance(mesh.get(sort), Mapping):
                    own |= mesh[sort]
            given = value.get(sort, {})
            if own and isinstance(given, Mapping):
                value[sort] = {**given, **{k: v for k, v in own.items() if k not in given}}
        return value

    @model_validator(mode="after")
    def _check_own_names(self) -> Self:
        for group, members in (("spheres", self.spheres), ("meshes", self.meshes), ("lights", self.lights)):
            first: dict[str, int] = {}
            for i, name in enumerate(getattr(member, "name", None) for member in members):
                if name is not None and first.setdefault(name, i) != i:
                    text = f"{show(name)} is the name of {group}[{first[name]}] already: choose another"
                    raise complaint(text, group, i, "name")
        return self

    @model_validator(mode="after")
    def _check_names(self) -> Self:
        for i, mesh in enumerate(self.meshes):
            if mesh.material is not None and mesh.material not in self.materials:
                hint = nearest(mesh.material, self.materials)
                raise complaint(f"unknown material {show(mesh.material)}{hint}", "meshes", i, "material")
        groups: dict[str, Sequence[Solid]] = {"spheres": self.spheres, "triangles": self.triangles}
        for group, members in groups.items():
            for i, member in enumerate(members):
                if member.material not in self.materials:
                    hint = nearest(member.material, self.materials)
                    raise complaint(f"unknown material {show(member.material)}{hint}", group, i, "material")
        return self

    @model_validator(mode="after")
    def _check_textures(self) -> Self:
        check_places(self)
        return self

    @model_validator(mode="after")
    def _check_members(self) -> Self:
        members: dict[str, Sequence[SphereDescription | MeshDescription]]
        members = {"spheres": self.spheres, "meshes": self.meshes}
        for sort, things in members.items():
            for i, thing in enumerate(things):
                if thing.group is not None and thing.group not in self.groups:
                    hint = nearest(thing.group, self.groups) if self.groups else f": add [groups.{thing.group}]"
                    raise complaint(f"unknown group {show(thing.group)}{hint}", sort, i, "group")
        if self.groups:
            self._check_room()
        return self

    def _check_room(self) -> None:
        """Complain of what a group places where float32 has no room."""
        flat = self.flat
        sizes = {"spheres": [max(*map(abs, s.center), s.radius, SHORTEST / s.radius * LONGEST) for s in flat.spheres]}
        sizes["meshes"] = [np.abs(m.world).max() if len(m.kept) else np.inf for m in flat.meshes]
        for sort, members in sizes.items():
            for i, size in enumerate(members):
                group = getattr(self, sort)[i].group
                if group is not None and not size <= LONGEST:
                    text = f"{show(group)} makes it too large, too small or too far out for float32: scale the group"
                    raise complaint(text, sort, i, "group")


def _place(location: tuple[str | int, ...]) -> str:
    """Return `location` as a path such as `spheres[2].material`."""
    text = ""
    for part in location:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            text += ("." if text else "") + (part if re.fullmatch(r"[\w-]+", part) else show(part))
    return text


def parse_description(mapping: Mapping[str, Any], source: str = "scene") -> SceneDescription:
    """Return the validated description of a scene given as nested mappings, as in a scene file.

    Raises SceneError, one line that starts with `source`, for the first thing that is wrong.
    """
    try:
        return SceneDescription.model_validate(mapping)
    except ValidationError as error:
        text, place = told(error)
    except RecursionError:
        raise SceneError(f"{source}: nested too deeply: flatten it") from None
    raise SceneError(": ".join(filter(None, (source, _place(place), text))))
