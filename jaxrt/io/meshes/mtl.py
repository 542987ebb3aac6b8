"""MTL files beside OBJ files: `Kd`, with `map_Kd`, becomes a diffuse material; what else they say is told."""

import difflib
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxrt.description import SceneError, nearest, show
from jaxrt.description.textures import name_of_picture
from jaxrt.io.files import SCENE_BYTES, read_bytes
from jaxrt.io.folders import Folders, folders_of, named_file
from jaxrt.io.meshes.maps import read_map
from jaxrt.io.meshes.obj import Library, Obj, Use
from jaxrt.io.meshes.text import BadRow, decode, floats, number_hint

OVERRIDE = "name a material in the scene file (in Python: materials=False)"
ROUNDING = 1e-5  # that a decimal in a file may be beyond [0, 1]
SOUGHT, LISTED, LONGEST = 1000, 10, 120  # names among which the nearest is sought, that are told; letters of files
_COMMENT = re.compile(r"(?:^|\s)#.*$")
_ONE_FILE = re.compile(r"\S.*?\.mtl(?=\s|$)", re.IGNORECASE)


class Paint(NamedTuple):
    """A material of an MTL file, its values by keyword in lower case."""

    name: str
    file: Path
    line: int
    values: dict[str, str]


def materials_of(obj: Obj, path: Path, allow_folders: Folders) -> dict[str, Any]:
    """Return `materials`, `textures`, `face_materials` (n,) and notes of an OBJ file.

    Raises SceneError for what is missing.
    """
    if not obj.uses:
        return {}
    if not obj.libraries:
        names = ", ".join(dict.fromkeys(show(use.name) for use in obj.uses[:3]))
        return {"notes": [f"materials are named ({names}), but no mtllib says what they are"]}
    first = obj.uses[0].polygon
    if first > 0:
        raise SceneError(f"{path}: the first {first} faces come before any usemtl: {OVERRIDE}")
    paints, notes = _read_libraries(obj.libraries, path, allow_folders)
    # The last of several usemtl before a face counts
    starts = np.array([use.polygon for use in obj.uses])
    use_of_face = np.searchsorted(starts, obj.sources, side="right") - 1
    used = np.unique(use_of_face)
    found = [_find(obj.uses[int(i)], paints, obj, path) for i in used]
    by_name = {paint.name: paint for paint in found}
    row_of_name = {name: row for row, name in enumerate(by_name)}
    row_of_use = np.zeros(len(obj.uses), np.int64)
    row_of_use[used] = [row_of_name[paint.name] for paint in found]
    palette = _Palette(obj, path, allow_folders)
    materials = {f"{path.name}:{name}": {"type": "diffuse", "albedo": palette.albedo(p)} for name, p in by_name.items()}
    notes += [*palette.notes, *_unread(list(by_name.values()))]
    told = {"materials": materials, "face_materials": row_of_use[use_of_face], "notes": notes}
    return told | ({"textures": palette.textures} if palette.textures else {})


class _Palette:
    """The albedos of materials, and the textures that these name."""

    def __init__(self, obj: Obj, path: Path, allow_folders: Folders):
        self.obj, self.path = obj, path
        self.allow_folders = (path.parent, *folders_of(allow_folders))
        self.textures: dict[str, dict[str, Any]] = {}
        self.names: dict[tuple[Path, str], str | None] = {}  # of textures, by MTL file and what this says
        self.notes: list[str] = []

    def albedo(self, paint: Paint) -> Any:
        """Return what stands in a scene file as the albedo of a material."""
        name = self._texture(paint) if "map_kd" in paint.values else None
        if "kd" not in paint.values and name is None:
            raise SceneError(
                f"{paint.file}: material {show(paint.name)} has no Kd, and no texture that is read: add it, or "
                f"{OVERRIDE}"
            )
        factor = _albedo(paint) if "kd" in paint.values else [1.0, 1.0, 1.0]
        return factor if name is None else {"texture": name, "factor": factor}

    def _texture(self, paint: Paint) -> str | None:
        """Return the name of a material's texture, None where it has none that is read."""
        text = paint.values["map_kd"]
        if self.obj.mesh.uv is None:
            self._note(paint, "map_Kd is left out, since the mesh has no places on textures (vt)")
            return None
        key = paint.file, text
        if key not in self.names:
            table, notes = read_map(text, paint.file, self.allow_folders)
            for note in notes:
                self._note(paint, note)
            self.names[key] = None if table is None else self._add(table)
        return self.names[key]

    def _add(self, table: dict[str, Any]) -> str:
        """Return the name of a new texture, after both files: other meshes may have other pictures of that name."""
        name = f"{name_of_picture(self.path.name)}_{name_of_picture(table['file'])}"
        while name in self.textures:
            name += "_"
        self.textures[name] = table
        return name

    def _note(self, paint: Paint, note: str) -> None:
        self.notes.append(f"material {show(paint.name)}: {note}")


def _find(use: Use, paints: dict[str, Paint], obj: Obj, path: Path) -> Paint:
    """Return what a usemtl names, with or without what may be a comment behind it."""
    paint = paints.get(use.name) or paints.get(_bare(use.name))
    if paint is None or not {"kd", "map_kd"} & paint.values.keys():
        libraries = ", ".join(library.names for library in obj.libraries)[:LONGEST]
        libraries = libraries if libraries.isprintable() else show(libraries)
        raise SceneError(
            f"{path}: line {use.line}: {libraries} has no Kd for material {show(_bare(use.name))}"
            f"{_like(_bare(use.name), [n for n, other in paints.items() if 'kd' in other.values])}: "
            f"add it, or {OVERRIDE}"
        )
    return paint


def _like(name: str, known: list[str]) -> str:
    """Return the hint of a name that is meant, first one that differs in capitals alone."""
    twins = [other for other in known if other.lower() == name.lower()]
    near = twins or difflib.get_close_matches(name, known[:SOUGHT], n=1)
    return f" (did you mean {show(near[0])}?)" if near else nearest(name, known[:LISTED])


def _bare(name: str) -> str:
    return _COMMENT.sub("", name).strip()


def _read_libraries(libraries: list[Library], path: Path, allow_folders: Folders) -> tuple[dict[str, Paint], list[str]]:
    """Return the materials of all libraries by name, and what is doubtful about them."""
    paints: dict[str, Paint] = {}
    twins: list[Paint] = []
    files = {file: library.line for library in libraries for file in _files(library, path, allow_folders)}
    for file, line in files.items():
        try:
            data = read_bytes(file, (".mtl",), remedy=f"correct mtllib, or {OVERRIDE}", limit=SCENE_BYTES)
        except SceneError as error:
            raise SceneError(f"{path}: line {line}: mtllib: {error}") from None
        for paint in _paints(decode(data), file):
            twin = paints.get(paint.name)
            if twin and twin.values.get("kd") != paint.values.get("kd"):
                twins.append(paint)
            paints[paint.name] = paint
    # A name may hold what looks like a comment, so the whole of it goes first
    for name in list(paints):
        paints.setdefault(_bare(name), paints[name]._replace(name=_bare(name)))
    if not twins:
        return paints, []
    last, others = twins[0], f", and {len(twins) - 1} more" if len(twins) > 1 else ""
    where = f"on line {last.line} of {last.file.name}"
    return paints, [f"material {show(last.name)} is defined twice, and drawn as {where}{others}"]


def _files(library: Library, path: Path, allow_folders: Folders) -> list[Path]:
    """Return the files that one mtllib names: a single one, whose name may have spaces, or several."""
    names = library.names.replace("\\", "/")
    for name in (names, _bare(names), _bare(names).strip("\"'")):
        if name and os.path.exists(os.path.join(path.parent, name)):
            return [named_file(name, path, f"line {library.line}", allow_folders)]
    several = _ONE_FILE.findall(_bare(names)) or [_bare(names)]
    return [named_file(name.strip("\"'"), path, f"line {library.line}", allow_folders) for name in several]


def _paints(text: str, file: Path) -> Iterator[Paint]:
    """Yield the materials of an MTL file."""
    paint = None
    for number, line in enumerate(text.split("\n"), 1):
        key, _, rest = line.replace("\t", " ").strip().partition(" ")
        if key.lower() == "newmtl":
            if paint:
                yield paint
            paint = Paint(rest.strip(), file, number, {})
        elif paint and key and not key.startswith("#"):
            paint.values[key.lower()] = _bare(rest)
    if paint:
        yield paint


def _albedo(paint: Paint) -> list[float]:
    """Return Kd as three numbers in [0, 1]; one number is a grey."""
    text = paint.values["kd"]
    place = f"{paint.file}: material {show(paint.name)}"
    words = text.split()
    try:
        (color,) = floats([text], 1 if len(words) == 1 else 3).tolist()
    except BadRow:
        hint = number_hint(text, "write Kd r g b")
        raise SceneError(f"{place}: Kd {show(text)} is not three numbers in [0, 1]: {hint}, or {OVERRIDE}") from None
    if not all(-ROUNDING <= value <= 1 + ROUNDING for value in color):
        hint = "divide it by 255" if all(0 <= value <= 255 for value in color) and max(color) > 2 else "correct it"
        raise SceneError(f"{place}: Kd {show(color)} is not three numbers in [0, 1]: {hint}")
    return [min(max(value, 0.0), 1.0) for value in color * (3 // len(color))]


def _unread(paints: list[Paint]) -> Iterator[str]:
    """Tell in one line what materials ask for besides Kd and map_Kd."""
    asked = {word: [p.name for p in paints if word in _asks(p.values)] for word in _WORDS}
    parts = [f"{word} ({', '.join(map(show, names[:3]))})" for word, names in asked.items() if names]
    if parts:
        yield f"of the materials only Kd and map_Kd are read, not {', '.join(parts)}"


_WORDS = ("other textures", "Ke", "d", "Tr", "Ni", "illum")


def _asks(values: dict[str, str]) -> set[str]:
    """Return what changes the look of a material. Ni counts where light is said to pass, or where nothing is said."""
    maps = ("map_", "bump", "disp", "decal", "refl")
    asks = {"other textures"} if any(key.startswith(maps) and key != "map_kd" for key in values) else set()
    model = _number(values.get("illum"), 2)
    if any(_number(word, 0) > 0 for word in values.get("ke", "").split()):
        asks.add("Ke")
    if _number(values.get("d", "").replace("-halo", "").split(), 1) < 1:
        asks.add("d")
    if _number(values.get("tr"), 0) > 0:
        asks.add("Tr")
    if model >= 3:
        asks.add("illum")
    if _number(values.get("ni"), 1) != 1 and ("illum" not in values or model >= 3 or asks & {"d", "Tr"}):
        asks.add("Ni")
    return asks


def _number(words: str | list[str] | None, otherwise: float) -> float:
    """Return the first number of a value, `otherwise` where there is none."""
    words = words.split() if isinstance(words, str) else words or []
    try:
        return float(words[0]) if words else otherwise
    except ValueError:
        return otherwise
