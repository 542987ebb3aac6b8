"""Places on textures in OBJ files: `vt` rows, and which of them each corner of a polygon names."""

import re
from collections.abc import Sequence

import numpy as np

from jaxrt.description.mesh_facts import Floats, Ints
from jaxrt.io.meshes.text import BadRow, counts_of_words, floats, numbers

_CORNER = re.compile(r"(?<!\S)[^\s/]+(?:/([-+]?\d+))?(?:/\S*)?")


def places(rows: Sequence[str]) -> Floats | None:
    """Return the places (k, 2) of `vt` rows, None where one is no place."""
    try:
        if (counts_of_words(rows) == 1).all():  # v is 0 where it is left out
            return np.column_stack([floats(rows, 1), np.zeros(len(rows))])
        found = floats(rows, 2)
    except BadRow:
        return None
    return found if np.isfinite(found).all() else None


def rows_of_corners(words: str, sizes: Ints, before: Ints, count: int) -> tuple[Ints, list[str]] | None:
    """Return for each corner (t,) of polygons, as `7/1/3`, the row of its place, or −1; None where none has one.

    sizes: (n,) corners of each polygon. before: (n,) places that come before it. count: places in all.
    """
    if "/" not in words:
        return None
    # 0, which names none, where there is no second number; a sign stays in front
    named = re.sub(r"\b0([-+])", r"\1", _CORNER.sub(r"0\1", words))
    found = numbers(named, int(sizes.sum()), np.int64)
    if found is None or not found.any():
        return None
    found = np.where(found > 0, found - 1, np.where(found < 0, np.repeat(before, sizes) + found, -1))
    beyond = (found >= count) | (found < -1)
    notes = []
    if beyond.any():
        notes.append(f"{int(beyond.sum())} corners name places on textures (vt) that do not exist")
    return np.where(beyond, -1, found), notes
