"""MTL files beside OBJ files: `Kd` becomes a diffuse material."""

from pathlib import Path
from typing import Any

import numpy as np

from jaxrt.description import SceneError, nearest, show
from jaxrt.io.files import SCENE_BYTES, read_bytes
from jaxrt.io.folders import Folders, named_file
from jaxrt.io.obj import PlainObj


def materials_of(obj: PlainObj, path: Path, faces: int, allow_folders: Folders = ()) -> dict[str, Any]:
    """Return `materials` and `face_materials` (n,) of an OBJ file. Raises SceneError for what is missing or unsound."""
    colors: dict[str, list[float]] = {}
    for library in obj.libraries:
        colors |= _read_library(named_file(library, path, "mtllib", allow_folders))
    first = obj.uses[0][0]
    if first > 0:
        raise SceneError(f"{path}: the first {first} faces come before any usemtl: name a material in the scene file")
    for _, name, line in obj.uses:
        if name not in colors:
            libraries = ", ".join(obj.libraries)
            raise SceneError(
                f"{path}: line {line}: {libraries} has no Kd for material {show(name)}{nearest(name, colors)}: "
                "add it, or name a material in the scene file"
            )
    ends = [*(start for start, _, _ in obj.uses[1:]), faces]
    spans = [(name, end - start) for (start, name, _), end in zip(obj.uses, ends, strict=True) if end > start]
    used = list(dict.fromkeys(name for name, _ in spans))
    rows = np.concatenate([np.full(count, used.index(name), np.int64) for name, count in spans])
    materials = {f"{path.name}:{name}": {"type": "diffuse", "albedo": colors[name]} for name in used}
    return {"materials": materials, "face_materials": rows}


def _read_library(path: Path) -> dict[str, list[float]]:
    """Return Kd by material name."""
    from trimesh.exchange.obj import parse_mtl

    data = read_bytes(path, (".mtl",), remedy="correct mtllib, or name a material in the scene file", limit=SCENE_BYTES)
    colors = {}
    for name, values in parse_mtl(data).items():
        color = values.get("diffuse")
        if color is None:
            continue
        color = [color] * 3 if isinstance(color, float) else color[:3]
        if len(color) != 3 or not all(0 <= value <= 1 for value in color):
            raise SceneError(
                f"{path}: material {show(name)}: Kd {show(color)} is not three numbers in [0, 1]: correct it"
            )
        colors[name] = color
    return colors
