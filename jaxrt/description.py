"""What a scene is, in words and plain numbers: the validated form of a scene file or of a dict."""

import difflib
import json
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)
from pydantic_core import PydanticCustomError

FLOAT32_MAX = float(np.finfo(np.float32).max)
FLOAT32_TINY = float(np.finfo(np.float32).tiny)
LONGEST = 1e15  # lengths are squared in float32, which ends at 3.4e38
SHORTEST = 1e-15  # and begins at 1.2e-38
COUNT_MAX = 2**31 - 1  # sample numbers and pixels are int32
PARALLEL = 1e-6  # sine of the angle between up and view below which the camera's frame is noise in float32
COLLINEAR = 1e-12  # twice the area over the square of the longest side, rounding of float64 included

EXAMPLES = {
    "camera": "a table [camera] with position = [0, 0, 55]",
    "position": "position = [0, 0, 55]",
    "center": "center = [0, 0, 0]",
    "radius": "radius = 10",
    "material": 'material = "white"',
    "vertices": "vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]",
    "intensity": "intensity = 3000",
    "radiance": "radiance = [1, 1, 1]",
    "albedo": "albedo = [0.8, 0.8, 0.8]",
    "ior": "ior = 1.5",
    "type": 'type = "diffuse", "mirror" or "glass"',
}


class SceneError(ValueError):
    """A scene that cannot be rendered: one line with source, place, culprit and remedy."""


class SceneWarning(UserWarning):
    """A scene that can be rendered, but hardly means what it says."""


def show(value: object) -> str:
    """Return `value` as it would stand in a scene file, on one line of at most 60 characters."""
    quoted = isinstance(value, str | bool)
    text = json.dumps(value, ensure_ascii=False) if quoted else repr(value).replace("\n", " ")
    return text if len(text) <= 60 else text[:57] + "..."


def nearest(name: str, known: Iterable[str]) -> str:
    """Return ` (did you mean "x"?)` with the nearest of `known`, or all of them where none is near."""
    choices = list(known)
    near = difflib.get_close_matches(name, choices, n=1)
    if near:
        return f" (did you mean {show(near[0])}?)"
    return f" (known: {', '.join(choices)})" if choices else " (none is defined)"


def _error(text: str, *place: str | int) -> PydanticCustomError:
    """Return the error `text` at `place`, relative to the value being validated."""
    return PydanticCustomError("scene", "{text}", {"text": text, "place": place})


def _plain(value: Any) -> Any:
    """Return arrays and array scalars as lists and numbers."""
    return value.tolist() if hasattr(value, "tolist") else value


def _number(value: Any) -> float:
    value = _plain(value)
    if isinstance(value, bool) or not isinstance(value, int | float):
        hint = "write it without quotes" if isinstance(value, str) else "write a number"
        raise _error(f"{show(value)} is not a number: {hint}")
    if not (math.isfinite(value) if isinstance(value, float) else True):
        raise _error(f"{show(value)} is not finite: write a finite number")
    if abs(value) > FLOAT32_MAX:
        raise _error(f"{show(value)} is too large for float32: stay within ±3.4e38")
    return float(value)


def _count(value: Any) -> int:
    value = _plain(value)
    if isinstance(value, bool) or not isinstance(value, int):
        raise _error(f"{show(value)} is not a whole number: write an integer >= 1")
    if not 1 <= value <= COUNT_MAX:
        raise _error(f"{show(value)} is out of range: write an integer from 1 to {COUNT_MAX}")
    return value


def _string(value: Any) -> str:
    if not isinstance(value, str):
        raise _error(f"{show(value)} is not a name: write a string in quotes")
    return value


def _three(value: Any) -> tuple[Any, ...]:
    value = _plain(value)
    if not isinstance(value, list | tuple):
        raise _error(f"{show(value)} is not a list: write three values in brackets")
    if len(value) != 3:
        raise _error(f"{show(value)} has {len(value)} values: write 3")
    return tuple(value)


def _tables(value: Any, info: ValidationInfo) -> tuple[Any, ...]:
    if isinstance(value, Mapping):
        raise _error(f"a single table where many can be: write [[{info.field_name}]] with two brackets")
    if not isinstance(value, list | tuple):
        raise _error(f"{show(value)} is not a list of tables: write [[{info.field_name}]]")
    return tuple(value)


def _require(test: Callable[[np.float32], object], text: str) -> AfterValidator:
    """Return a validator that refuses numbers which, once in float32, fail `test`."""

    def check(value: float) -> float:
        if not test(np.float32(value)):
            raise _error(f"{show(value)} {text}")
        return value

    return AfterValidator(check)


_not_too_long = _require(lambda x: abs(x) <= LONGEST, "is too far out for float32: stay within ±1e15")
_not_too_short = _require(lambda x: x == 0 or x >= SHORTEST, "is too small for float32: use 1e-15 or more")

Count = Annotated[int, BeforeValidator(_count)]
Name = Annotated[str, BeforeValidator(_string)]
Number = Annotated[float, BeforeValidator(_number)]
Coordinate = Annotated[Number, _not_too_long]
Reflectance = Annotated[Number, _require(lambda x: 0 <= x <= 1, "is outside [0, 1]: choose an albedo within")]
Power = Annotated[Number, _require(lambda x: x >= 0, "is negative: light cannot be, use 0 or more")]
Radius = Annotated[
    Number, _require(lambda x: x > 0, "is not > 0: use a positive radius"), _not_too_long, _not_too_short
]
LightRadius = Annotated[
    Number, _require(lambda x: x >= 0, "is negative: use 0 for a point light"), _not_too_long, _not_too_short
]
Ior = Annotated[Number, _require(lambda x: x > 0, "is not > 0: glass has about 1.5")]
Fov = Annotated[Number, _require(lambda x: 0 < x < 180, "is not between 0 and 180: choose degrees, such as 60")]
Vector = Annotated[tuple[Coordinate, Coordinate, Coordinate], BeforeValidator(_three)]
Albedo = Annotated[tuple[Reflectance, Reflectance, Reflectance], BeforeValidator(_three)]
Rgb = Annotated[tuple[Power, Power, Power], BeforeValidator(_three)]


class _Table(BaseModel):
    """A table of the scene file: known keys only, each required one present."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    @model_validator(mode="before")
    @classmethod
    def _check_keys(cls, value: Any) -> Any:
        if isinstance(value, BaseModel):
            return value
        if not isinstance(value, Mapping):
            raise _error(f"{show(value)} is not a table: write keys and values")
        for key in value:
            if key not in cls.model_fields:
                raise _error(f"unknown key {show(key)}{nearest(str(key), cls.model_fields)}")
        for name, field in cls.model_fields.items():
            if field.is_required() and name not in value:
                raise _error(f"{show(name)} is missing: add {EXAMPLES[name]}")
        return dict(value)


class CameraDescription(_Table):
    """A pinhole camera; `fov` is vertical, in degrees."""

    position: Vector
    target: Vector = Field(default=None, validate_default=True)
    up: Vector = (0.0, 1.0, 0.0)
    fov: Fov = 60.0
    width: Count = 512
    height: Count = 512

    @field_validator("target", mode="before")
    @classmethod
    def _look_along_minus_z(cls, value: Any, info: ValidationInfo) -> Any:
        x, y, z = info.data.get("position", (0.0, 0.0, 0.0))
        return (x, y, z - 1) if value is None else value

    @model_validator(mode="after")
    def _check_frame(self) -> Self:
        view = np.subtract(self.target, self.position)
        length, up_length = np.linalg.norm(view), np.linalg.norm(self.up)
        if length < SHORTEST:
            raise _error("is the camera's position: nothing to look along, move one of them", "target")
        if up_length < SHORTEST:
            raise _error(f"{show(self.up)} is zero: use a direction such as [0, 1, 0]", "up")
        if np.linalg.norm(np.cross(view, self.up)) <= PARALLEL * length * up_length:
            raise _error(f"{show(self.up)} is parallel to the view: choose another direction", "up")
        return self


class RenderDefaults(_Table):
    """What `render` uses where it is not told otherwise."""

    spp: Count = 64
    max_depth: Count = 5


class EnvironmentDescription(_Table):
    """A constant environment, W·sr⁻¹·m⁻²."""

    radiance: Rgb


class Diffuse(_Table):
    """A Lambertian surface."""

    type: Literal["diffuse"] = "diffuse"
    albedo: Albedo


class Mirror(_Table):
    """A perfect mirror."""

    type: Literal["mirror"] = "mirror"
    albedo: Albedo = (1.0, 1.0, 1.0)


class Glass(_Table):
    """A smooth dielectric; `ior` is inside over outside."""

    type: Literal["glass"] = "glass"
    ior: Ior


MATERIALS = ("diffuse", "mirror", "glass")
MaterialDescription = Annotated[Diffuse | Mirror | Glass, Field(discriminator="type")]


class SphereDescription(_Table):
    """A sphere."""

    center: Vector
    radius: Radius
    material: Name


class TriangleDescription(_Table):
    """A triangle, two-sided where its material is."""

    vertices: Annotated[tuple[Vector, Vector, Vector], BeforeValidator(_three)]
    material: Name

    @model_validator(mode="after")
    def _check_area(self) -> Self:
        a, b, c = np.array(self.vertices)
        doubled = np.linalg.norm(np.cross(b - a, c - a))
        longest = max(np.linalg.norm(b - a), np.linalg.norm(c - a), np.linalg.norm(c - b))
        if doubled <= COLLINEAR * longest**2:
            raise _error(f"{show(self.vertices)} has no area: move a vertex or remove it", "vertices")
        if doubled**2 < FLOAT32_TINY:
            raise _error(f"area {doubled / 2:.2g} is too small for float32: scale the scene up", "vertices")
        return self


Solid = SphereDescription | TriangleDescription


class LightDescription(_Table):
    """A point light (radius 0) or a spherical light; intensity in W/sr."""

    position: Vector
    intensity: Rgb
    radius: LightRadius = 0.0

    @field_validator("intensity", mode="before")
    @classmethod
    def _grey(cls, value: Any) -> Any:
        value = _plain(value)
        if isinstance(value, list | tuple):
            return value
        number = _number(value)
        if number < 0:
            raise _error(f"{show(value)} is negative: light cannot be, use 0 or more")
        return (number, number, number)

    @model_validator(mode="after")
    def _check_radiance(self) -> Self:
        if self.radius and max(self.intensity) / (math.pi * self.radius**2) > FLOAT32_MAX:
            raise _error(f"{self.radius} makes the radiance too large for float32: use 0", "radius")
        return self


def _check_types(value: Any) -> Any:
    """Refuse materials without a known type, before the type picks their model."""
    if not isinstance(value, Mapping):
        raise _error(f"{show(value)} is not a table: write [materials.NAME]")
    for name, material in value.items():
        if isinstance(material, BaseModel):
            continue
        if not isinstance(material, Mapping):
            raise _error(f"{show(material)} is not a table: write [materials.{name}]", str(name))
        if "type" not in material:
            raise _error(f'"type" is missing: add {EXAMPLES["type"]}', str(name))
        if material["type"] not in MATERIALS:
            hint = nearest(str(material["type"]), MATERIALS)
            raise _error(f"unknown material type {show(material['type'])}{hint}", str(name), "type")
    return value


class SceneDescription(_Table):
    """A whole scene. Rows of `spheres`, `triangles` and `lights` keep the order of the file."""

    camera: CameraDescription
    render: RenderDefaults = RenderDefaults()
    environment: EnvironmentDescription | None = None
    materials: Annotated[dict[Name, MaterialDescription], BeforeValidator(_check_types)] = {}
    spheres: Annotated[tuple[SphereDescription, ...], BeforeValidator(_tables)] = ()
    triangles: Annotated[tuple[TriangleDescription, ...], BeforeValidator(_tables)] = ()
    lights: Annotated[tuple[LightDescription, ...], BeforeValidator(_tables)] = ()

    @model_validator(mode="after")
    def _check_names(self) -> Self:
        groups: dict[str, Sequence[Solid]] = {"spheres": self.spheres, "triangles": self.triangles}
        for group, members in groups.items():
            for i, member in enumerate(members):
                if member.material not in self.materials:
                    hint = nearest(member.material, self.materials)
                    raise _error(f"unknown material {show(member.material)}{hint}", group, i, "material")
        return self


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
        first = error.errors(include_url=False)[0]
    context = first.get("ctx", {})
    location = tuple(first["loc"])
    # Drop the material's type, which pydantic puts between its name and its key
    if location[:1] == ("materials",):
        location = location[:2] + location[3:]
    place = _place(location + tuple(context.get("place", ())))
    text = context.get("text") or f"{show(first['input'])}: {first['msg']}"
    raise SceneError(": ".join(filter(None, (source, place, text))))
