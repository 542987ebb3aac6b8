"""Materials of GLB files: base colours, by number, picture or vertex, become diffuse materials; the rest is told."""

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

Table = dict[str, Any]
_CLAMP, _REPEAT = 33071, 10497
_LOOKS = ("normalTexture", "occlusionTexture", "emissiveTexture")


def glb_materials(
    accessors: Accessors, path: Path, parts: Sequence[tuple[int | None, int]], places: bool, colors: bool
) -> tuple[Table, list[str]]:
    """Return `materials`, `textures` and `face_materials` (n,) of a GLB file, and notes of what is not read.

    parts: number of the material, None for none, and of faces of each part. places, colors: whether vertices have
    places on textures, and colours, by which base colours are multiplied.
    """
    for number, _ in parts:
        if number is not None:
            item(accessors.document, "materials", number)
    numbers = list(dict.fromkeys(number for number, _ in parts))
    if numbers == [None]:
        return {}, []
    palette, names = _Palette(accessors, path, places, colors), list[str]()
    for number in numbers:
        name = f"{path.name}:{_called(accessors, number)}"
        names.append(name if name not in names else f"{name}{number}")
    albedos = [palette.albedo(number) for number in numbers]
    materials = {name: {"type": "diffuse", "albedo": albedo} for name, albedo in zip(names, albedos, strict=True)}
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
    """The albedos of materials, and the textures that these name."""

    def __init__(self, accessors: Accessors, path: Path, places: bool, colors: bool):
        self.accessors, self.path, self.places, self.colors = accessors, path, places, colors
        self.textures: dict[str, Table] = {}
        self.names: dict[int, str] = {}  # of textures, by their numbers in the file
        self.notes: dict[str, None] = {}
        self.unread: dict[str, None] = {}

    def told(self) -> list[str]:
        """Return what is not read."""
        words = f"materials and textures are not read but for base colours: {', '.join(self.unread)} are left out"
        return [*([words] if self.unread else []), *self.notes]

    def albedo(self, number: int | None) -> Any:
        """Return what stands in a scene file as the albedo of a material."""
        material = {} if number is None else item(self.accessors.document, "materials", number)
        shine = material.get("pbrMetallicRoughness", {})
        shine = shine if isinstance(shine, dict) else {}
        if number is not None:
            self.unread |= dict.fromkeys(_unread(material, shine))
        factor = _factor(shine.get("baseColorFactor", [1.0, 1.0, 1.0]))
        if factor is None:
            self.notes[f"baseColorFactor of materials[{number}] is not three or four numbers in [0, 1]"] = None
            factor = [1.0, 1.0, 1.0]
        name = self._texture(shine["baseColorTexture"]) if "baseColorTexture" in shine else None
        if name is None and self.colors:
            name = f"{name_of_picture(self.path.name)}_colors"
            self.textures[name] = {"type": "vertex_colors"}
        return factor if name is None else {"texture": name, "factor": factor}

    def _texture(self, said: Any) -> str | None:
        """Return the name of a texture, None where it cannot be had."""
        try:
            if not self.places:
                raise Broken("the mesh has no TEXCOORD_0")
            if not isinstance(said, dict) or said.get("texCoord", 0) != 0:
                raise Broken("it does not lie by TEXCOORD_0")
            if extensions_of(said):
                self.notes[f"{show(', '.join(extensions_of(said)))} of baseColorTexture is not read"] = None
            number: Any = said.get("index")
            texture = item(self.accessors.document, "textures", number)
            if number not in self.names:
                self.names[number] = self._add(texture)
            return self.names[number]
        except (Broken, SceneError) as error:
            self.notes[f"baseColorTexture is left out ({error})"] = None
            return None

    def _add(self, texture: Table) -> str:
        """Return the name of a new texture, after the file and its image."""
        if "source" not in texture:
            raise Broken("its picture is neither PNG nor JPG")
        number = texture["source"]
        image = item(self.accessors.document, "images", number)
        data = self.accessors.image(number)
        kind = ".png" if data.startswith(PNG_START[:8]) else ".jpg" if data.startswith(b"\xff\xd8") else None
        if kind is None:
            raise Broken(f"images[{number}] is neither PNG nor JPG")
        table: Table = {"texels": texels_in(self.path, kind, data)}
        sampler = item(self.accessors.document, "samplers", texture["sampler"]) if "sampler" in texture else {}
        ways = [sampler.get(key, _REPEAT) for key in ("wrapS", "wrapT")]
        if ways == [_CLAMP, _CLAMP]:
            table["wrap"] = "clamp"
        elif ways != [_REPEAT, _REPEAT]:
            self.notes["textures that are mirrored, or repeated one way, are repeated"] = None
        said = image.get("name") or image.get("uri")
        plain = said if isinstance(said, str) and not said.startswith("data:") else f"image{number}"
        name = f"{name_of_picture(self.path.name)}_{name_of_picture(plain) or number}"[:80]
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


def _unread(material: Table, shine: Table) -> Iterator[str]:
    """Yield what a material says besides its base colour, if that changes its look."""
    # By default it is metal
    if shine.get("metallicFactor", 1) != 0 or shine.get("roughnessFactor", 1) != 1:
        yield "metal and roughness"
    yield from (key for key in _LOOKS if key in material)
    if material.get("emissiveFactor", [0, 0, 0]) != [0, 0, 0]:
        yield "emissiveFactor"
    if material.get("alphaMode", "OPAQUE") != "OPAQUE":
        yield "alpha"
    yield from (show(name) for name in extensions_of(material)[:3])
