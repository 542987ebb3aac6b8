"""`map_Kd` of MTL files: the picture that a material's Kd is multiplied by."""

import re
from pathlib import Path
from typing import Any

from jaxrt.description import SceneError, show
from jaxrt.io.folders import Folders, named_file
from jaxrt.io.textures import read_texture

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)
# Options before the file's name, and how many words each takes at most; those of many take numbers alone
_OPTIONS = {"-blendu": 1, "-blendv": 1, "-bm": 1, "-boost": 1, "-cc": 1, "-clamp": 1, "-imfchan": 1, "-mm": 2}
_OPTIONS |= {"-o": 3, "-s": 3, "-t": 3, "-texres": 1, "-type": 1}
_READ = {"-clamp", "-s"}


def read_map(text: str, file: Path, allow_folders: Folders) -> tuple[dict[str, Any] | None, list[str]]:
    """Return the texture that a `map_Kd` names, None where it cannot be had, and notes of what is not read of it.

    file: the MTL file that says so.
    """
    name, options = _parts(text)
    if not name:
        return None, ["map_Kd names no picture"]
    # Programs write the separators of their own system
    name = name.replace("\\", "/")
    try:
        table = read_texture(named_file(name, file, "map_Kd", allow_folders))
    except SceneError as error:
        return None, [f"map_Kd {show(name)} is left out ({error})"]
    notes = [f"options {', '.join(sorted(options.keys() - _READ))} of map_Kd are not read"]
    scale = [float(word) for word in options.get("-s", [])[:2]]
    if scale and min(scale) > 0:
        table["scale"] = [scale[0], (*scale, 1.0)[1]]
    if [word.lower() for word in options.get("-clamp", [])] == ["on"]:
        table["wrap"] = "clamp"
    return table, notes if options.keys() - _READ else []


def _parts(text: str) -> tuple[str, dict[str, list[str]]]:
    """Return the file's name, which may have spaces, and the words of each option."""
    words, options = text.split(), dict[str, list[str]]()
    while words and words[0] in _OPTIONS:
        option, taken = words.pop(0), list[str]()
        most = _OPTIONS[option]
        while words and len(taken) < most and (most == 1 or _NUMBER.fullmatch(words[0])):
            taken.append(words.pop(0))
        options[option] = taken
    # Spaces within the name are kept as they stand
    return text[text.index(words[0]) :].strip().strip("\"'") if words else "", options
