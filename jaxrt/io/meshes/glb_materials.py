"""Materials of GLB files: base colours, by number, picture or vertex, become diffuse materials; the rest is told.

Or `principled` ones, with metal and roughness, where these are asked for.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jaxrt.description import SceneError, show
from jaxrt.description.mesh_facts import Ints
from jaxrt.description.textures import name_of_picture
from jaxrt.io.decode import PNG_START
from jaxrt.io.meshes.accessors import Accessors, Broken, extensions_of, item
from jaxrt.io.textures import texels_in
from jaxrt.materials.facets import SMOOTHEST

Table = dict[str, Any]
_CLAMP, _REPEAT = 33071, 10497
_SHINE = {"metallic": 2, "roughness": 1}  # channels of `metallicRoughnessTexture`
_LOOKS = ("normalTexture", "occlusionTexture", "emissiveTexture")


def glb_materials(
    accessors: Accessors, path: Path, parts: Sequence[tuple[int | None, int]], places: bool, colors: bool, shiny: bool
) -> tuple[Table, list[str]]:
    """Return `materials`, `textures` and `face_materials` (n,) of a GLB file, and notes of what is not read.

    parts: number of the material, None for none, and of faces of each part. places, colors: whether vertices have
    places on textures, and colours, by which base colours are multiplied. shiny: whether materials are principled.
    """
    for number, _ in parts:
        if number is not None:
            item(accessors.document, "materials", number)
    numbers = list(dict.fromkeys(number for number, _ in parts))
    if numbers == [None]:
        return {}, []
    palette, names = _Palette(accessors, path, places, colors, shiny), list[str]()
    for number in numbers:
        name = f"{path.name}:{_called(accessors, number)}"
        names.append(name if name not in names else f"{name}{number}")
    materials = {name: palette.material(number) for name, number in zip(names, numbers, strict=True)}
    rows: Ints = np.repeat([numbers.index(number) for number, _ in parts], [count for _, count in parts])
    table: Table = {"materials": materials, "face_materials": rows}
    return table | ({"textures": palette.textures} if palette.textures else {}), palette.told()


def _called(accessors: Accessors, number: int | None) -> str:
    """Return the name of a material, or what stands for it."""
    if number is None:
        return "none"
    name = item(accessors.document, "materials", number).get("name")
    return name if isinstance(name, str) and name and name.isprintable() else f"material{number}"


class _Palette:
    """The materials of a file, and the textures that these name."""

    def __init__(self, accessors: Accessors, path: Path, places: bool, colors: bool, shiny: bool):
        self.accessors, self.path, self.places, self.colors, self.shiny = accessors, path, places, colors, shiny
        self.textures: dict[str, Table] = {}
        self.names: dict[tuple[int, str | None], str] = {}  # of textures, by their numbers and fields in the file
        self.notes: dict[str, None] = {}
        self.unread: dict[str, None] = {}

    def told(self) -> list[str]:
        """Return what is not read."""
        read = "base colours, metal and roughness" if self.shiny else "base colours"
        words = f"materials and textures are not read but for {read}: {', '.join(self.unread)} are left out"
        return [*([words] if self.unread else []), *self.notes]

    def material(self, number: int | None) -> Table:
        """Return what stands in a scene file as a material."""
        material = {} if number is None else item(self.accessors.document, "materials", number)
        shine = material.get("pbrMetallicRoughness", {})
        shine = shine if isinstance(shine, dict) else {}
        if number is not None:
            self.unread |= dict.fromkeys(_unread(material, shine, self.shiny))
        albedo = self._albedo(shine, number)
        if not self.shiny:
            return {"type": "diffuse", "albedo": albedo}
        fields = {field: self._share(shine, field, number) for field in _SHINE}
        return {"type": "principled", "albedo": albedo, **fields}

    def _albedo(self, shine: Table, number: int | None) -> Any:
        factor = _factor(shine.get("baseColorFactor", [1.0, 1.0, 1.0]))
        if factor is None:
            self.notes[f"baseColorFactor of materials[{number}] is not three or four numbers in [0, 1]"] = None
            factor = [1.0, 1.0, 1.0]
        name = self._texture(shine, "baseColorTexture")
        if name is None and self.colors:
            name = f"{name_of_picture(self.path.name)}_colors"
            self.textures[name] = {"type": "vertex_colors"}
        return factor if name is None else {"texture": name, "factor": factor}

    def _share(self, shine: Table, field: str, number: int | None) -> Any:
        """Return what stands in a scene file as `metallic` or `roughness`: 1 where the file does not say."""
        factor = shine.get(f"{field}Factor", 1.0)
        if not isinstance(factor, int | float) or not 0 <= factor <= 1:
            self.notes[f"{field}Factor of materials[{number}] is not a number in [0, 1], and taken as 1"] = None
            factor = 1.0
        if field == "roughness" and factor < SMOOTHEST:
            self.notes[f"roughness below {SMOOTHEST} is taken as {SMOOTHEST}"] = None
            factor = SMOOTHEST
        name = self._texture(shine, "metallicRoughnessTexture", field) if factor else None
        return float(factor) if name is None else {"texture": name, "factor": float(factor)}

    def _texture(self, shine: Table, key: str, field: str | None = None) -> str | None:
        """Return the name of a texture, None where it cannot be had. field: which part it is."""
        if key not in shine:
            return None
        said = shine[key]
        try:
            if not self.places:
                raise Broken("the mesh has no TEXCOORD_0")
            if not isinstance(said, dict) or said.get("texCoord", 0) != 0:
                raise Broken("it does not lie by TEXCOORD_0")
            if extensions_of(said):
                self.notes[f"{show(', '.join(extensions_of(said)))} of {key} is not read"] = None
            number: Any = said.get("index")
            texture = item(self.accessors.document, "textures", number)
            if (number, field) not in self.names:
                self.names[number, field] = self._add(texture, field)
            return self.names[number, field]
        except (Broken, SceneError) as error:
            self.notes[f"{key} is left out ({error})"] = None
            return None

    def _add(self, texture: Table, field: str | None) -> str:
        """Return the name of a new texture, after the file and its image, of colours or of the numbers of a field."""
        if "source" not in texture:
            raise Broken("its picture is neither PNG nor JPG")
        number = texture["source"]
        image = item(self.accessors.document, "images", number)
        data = self.accessors.image(number)
        kind = ".png" if data.startswith(PNG_START[:8]) else ".jpg" if data.startswith(b"\xff\xd8") else None
        if kind is None:
            raise Broken(f"images[{number}] is neither PNG nor JPG")
        texels = texels_in(self.path, kind, data, "linear" if field else None)
        table: Table = {"texels": texels[..., _SHINE[field]] if field else texels}
        sampler = item(self.accessors.document, "samplers", texture["sampler"]) if "sampler" in texture else {}
        ways = [sampler.get(key, _REPEAT) for key in ("wrapS", "wrapT")]
        if ways == [_CLAMP, _CLAMP]:
            table["wrap"] = "clamp"
        elif ways != [_REPEAT, _REPEAT]:
            self.notes["textures that are mirrored, or repeated one way, are repeated"] = None
        said = image.get("name") or image.get("uri")
        plain = said if isinstance(said, str) and not said.startswith("data:") else f"image{number}"
        name = f"{name_of_picture(self.path.name)}_{name_of_picture(plain) or number}"[:80]
        name = f"{name}_{field}" if field else name
        while name in self.textures:
            name += "_"
        self.textures[name] = table
        return name


def _factor(value: Any) -> list[float] | None:
    """Return three numbers in [0, 1], None for anything else."""
    if not isinstance(value, list) or len(value) not in (3, 4):
        return None
    if not all(isinstance(x, int | float) and 0 <= x <= 1 for x in value):
        return None
    return [float(x) for x in value[:3]]


def _unread(material: Table, shine: Table, shiny: bool) -> Iterator[str]:
    """Yield what a material says that is not read, if that changes its look."""
    # By default it is metal
    if not shiny and (shine.get("metallicFactor", 1) != 0 or shine.get("roughnessFactor", 1) != 1):
        yield "metal and roughness"
    yield from (key for key in _LOOKS if key in material)
    if material.get("emissiveFactor", [0, 0, 0]) != [0, 0, 0]:
        yield "emissiveFactor"
    if material.get("alphaMode", "OPAQUE") != "OPAQUE":
        yield "alpha"
    yield from (show(name) for name in extensions_of(material)[:3])
