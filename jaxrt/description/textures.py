"""Textures: what a field of a material may be in place of one value, and how they stand in a scene file."""

import re
from collections.abc import Iterator, Mapping
from pathlib import PurePath
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, TypeAdapter, ValidationError, model_validator

from jaxrt.core.messages import nearest, show
from jaxrt.description.values import (
    Albedo,
    Measure,
    Name,
    Size,
    Table,
    complaint,
    plain,
    require,
    string,
    told,
)

if TYPE_CHECKING:
    from jaxrt.description import SceneDescription

MOST_TEXELS = 2**24  # of all textures of a scene together: 4096 x 4096, as many as float32 can count
PICTURES = (".png", ".jpg", ".jpeg", ".exr")


def name_of_picture(file: str) -> str:
    """Return the name of the texture that a picture's file is."""
    return re.sub(r"[^\w-]", "_", PurePath(file.replace("\\", "/")).stem)


class PaintedColor(tuple[float, ...]):
    """A colour that is multiplied by a texture; to who does not ask, three numbers as any."""

    texture: str


class PaintedNumber(float):
    """A number that is multiplied by a texture."""

    texture: str


def texture_of(value: Any) -> str | None:
    """Return the name of the texture that a field's value is multiplied by, None for none."""
    return getattr(value, "texture", None)


def paintable(measure: Measure, is_delta: bool) -> bool:
    """Return whether a field may be a texture: one that scales light, or a share where no single direction turns."""
    return measure.tints or (measure.range == "fraction" and not is_delta)


def painted(measure: Measure, value: Any, validate: Any) -> Any:
    """Return a field's value as its own validator does, or with the texture that a name or a table names."""
    if isinstance(value, PaintedColor | PaintedNumber):
        return value
    if isinstance(value, str):
        value = {"texture": value}
    if not isinstance(value, Mapping):
        return validate(value)
    for key in value:
        if key not in ("texture", "factor"):
            raise complaint(f"unknown key {show(key)}{nearest(str(key), ('texture', 'factor'))}")
    if "texture" not in value:
        raise complaint('"texture" is missing: add texture = "wood"')
    factor = validate(value.get("factor", [1.0] * len(measure.axes) if measure.axes else 1.0))
    made: Any = PaintedColor(factor) if measure.axes else PaintedNumber(factor)
    made.texture = string(value["texture"])
    return made


def as_written(value: Any) -> Any:
    """Return a field's value as it stands in a scene file."""
    if texture_of(value) is None:
        return plain(value)
    factor = list(value) if isinstance(value, tuple) else float(value)
    if np.all(np.equal(factor, 1)):
        return texture_of(value)
    return {"texture": texture_of(value), "factor": factor}


def _texels(value: Any) -> NDArray[np.float32]:
    """Return rows of colours (h, w, 3); numbers (h, w) are greys."""
    try:
        array = np.asarray(value)
    except ValueError:
        raise complaint(f"{show(value)} has rows of different lengths: write (h, w, 3) numbers") from None
    if array.ndim == 2:
        array = np.repeat(array[..., None], 3, axis=-1)
    if array.ndim != 3 or array.shape[2] != 3 or not array.size or array.dtype.kind not in "fiu":
        raise complaint(f"an array {array.shape} of {array.dtype} does not fit: write (h, w, 3) numbers in [0, 1]")
    array = array.astype(np.float32)
    # A NaN is not within either
    wrong = ~((array >= 0) & (array <= 1))
    if wrong.any():
        i, j, _ = (int(n) for n in np.argwhere(wrong)[0])
        raise complaint(f"texel [{i}][{j}] {show(array[i, j].tolist())} is outside [0, 1]: scale the picture down")
    return array


def _pair(value: Any) -> tuple[Any, Any]:
    value = plain(value)
    pair = (value, value) if isinstance(value, int | float) else value
    if not isinstance(pair, list | tuple) or len(pair) != 2:
        raise complaint(f"{show(value)} is not one number or two: write how often it repeats along u and v")
    return tuple(pair)


def _two(value: Any) -> tuple[Any, ...]:
    value = plain(value)
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise complaint(f"{show(value)} are not two colours: write [[0.8, 0.8, 0.8], [0.1, 0.1, 0.1]]")
    return tuple(value)


Often = Annotated[Size, require(lambda x: x > 0, "is not > 0: use a positive number")]
Scale = Annotated[tuple[Often, Often], BeforeValidator(_pair)]
Texels = Annotated[Any, BeforeValidator(_texels)]


def _one_of(*words: str) -> Any:
    def check(value: Any) -> Any:
        if value not in words:
            raise complaint(f"{show(value)} is unknown{nearest(str(value), words)}")
        return value

    return BeforeValidator(check)


class ImageTexture(Table):
    """A picture, between whose texels colours are interpolated."""

    model_config = ConfigDict(frozen=True, extra="forbid", arbitrary_types_allowed=True)

    type: Literal["image"] = "image"
    file: Name | None = None  # where the texels come from, if from a file
    notes: Name | None = None  # what the file holds and the texels do not, in one line
    texels: Texels = Field(default=None)  # (h, w, 3) linear, the first row on top
    wrap: Annotated[Literal["repeat", "clamp"], _one_of("repeat", "clamp")] = "repeat"  # beyond [0, 1]
    scale: Scale = (1.0, 1.0)  # how often it repeats along u and v
    encoding: Annotated[Literal["srgb", "linear"] | None, _one_of("srgb", "linear", None)] = None  # of a PNG or JPG

    @model_validator(mode="before")
    @classmethod
    def _check_texels(cls, value: Any) -> Any:
        if isinstance(value, Mapping) and "texels" not in value:
            if "file" in value:
                name = show(value["file"])
                raise complaint(f"{name} has not been read: take load_scene, or texels = load_image(…)", "file")
            raise complaint('"file" is missing: add file = "wood.png"')
        return value

    @property
    def shape(self) -> tuple[int, ...]:
        """Rows and columns."""
        return tuple(self.texels.shape[:2])


class CheckerTexture(Table):
    """Squares of two colours in turn."""

    type: Literal["checker"] = "checker"
    colors: Annotated[tuple[Albedo, Albedo], BeforeValidator(_two)] = ((0.8, 0.8, 0.8), (0.1, 0.1, 0.1))
    scale: Scale = (8.0, 8.0)  # squares along a unit of u and v


class VertexColors(Table):
    """The colours that meshes have at their vertices, between which they are interpolated."""

    type: Literal["vertex_colors"] = "vertex_colors"


TextureDescription = ImageTexture | CheckerTexture | VertexColors
TYPES: dict[str, type[Table]] = {"image": ImageTexture, "checker": CheckerTexture, "vertex_colors": VertexColors}


def check_textures(value: Any) -> Any:
    """Return validated textures by name; complain, for pydantic, of what is wrong."""
    if not isinstance(value, Mapping):
        raise complaint(f"{show(value)} is not a table: write [textures.NAME]")
    return {name: _check_texture(texture, name) for name, texture in value.items()}


def _check_texture(value: Any, name: Any) -> Any:
    if not isinstance(name, str) or not re.fullmatch(r"[\w-]+", name):
        raise complaint(f"{show(name)} cannot be a texture's name: use letters, digits, - and _")
    if isinstance(value, BaseModel):
        return value
    if not isinstance(value, Mapping):
        raise complaint(f"{show(value)} is not a table: write [textures.{name}]", str(name))
    kind = value.get("type", "image")
    if not isinstance(kind, str) or kind not in TYPES:
        hint = nearest(kind if isinstance(kind, str) else show(kind), TYPES)
        raise complaint(f"unknown texture type {show(kind)}{hint}", str(name), "type")
    try:
        return TypeAdapter(TYPES[kind]).validate_python(value)
    except ValidationError as error:
        text, place = told(error)
        raise complaint(text, str(name), *place) from None


def painted_fields(material: Any) -> Iterator[tuple[str, str]]:
    """Yield the fields of a material's table that are textures, and the name of each one's."""
    for field in type(material).model_fields:
        if (texture := texture_of(getattr(material, field))) is not None:
            yield field, texture


def textures_used(scene: "SceneDescription") -> list[str]:
    """Return the names of the textures of materials that something is made of, in the scene file's order."""
    used = {texture for name in scene.used for _, texture in painted_fields(scene.materials[name])}
    return [name for name in scene.textures if name in used]


def check_places(scene: "SceneDescription") -> None:
    """Complain of textures that are not there, and of shapes that have no place for one."""
    needs: dict[str, set[str]] = {}
    for name, material in scene.materials.items():
        for field, texture in painted_fields(material):
            if texture not in scene.textures:
                hint = nearest(texture, scene.textures) if scene.textures else f": add [textures.{texture}]"
                raise complaint(f"unknown texture {show(texture)}{hint}", "materials", name, field)
            by_vertex = isinstance(scene.textures[texture], VertexColors)
            needs.setdefault(name, set()).add("colors" if by_vertex else "uv")
    texels = sum(int(np.prod(scene.textures[name].shape)) for name in textures_used(scene) if _is_image(scene, name))
    if texels > MOST_TEXELS:
        raise complaint(f"have {texels} texels together, {MOST_TEXELS} are possible: make them smaller", "textures")
    for i, mesh in enumerate(scene.meshes):
        asked = {need for row in np.unique(mesh.rows) for need in needs.get(mesh.names[row], ())}
        if "uv" in asked and mesh.uv is None:
            raise complaint("has no uv, by which its material's texture is laid on it: add uv", "meshes", i)
        if "colors" in asked and mesh.colors is None:
            raise complaint("has no colours at its vertices, which its material asks for: add colors", "meshes", i)
    for sort in ("spheres", "triangles"):
        for i, member in enumerate(getattr(scene, sort)):
            if "colors" in needs.get(member.material, ()):
                raise complaint(f"{show(member.material)} asks for colours at vertices: meshes have them", sort, i)


def _is_image(scene: "SceneDescription", name: str) -> bool:
    return isinstance(scene.textures[name], ImageTexture)
