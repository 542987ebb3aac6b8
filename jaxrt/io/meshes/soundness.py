"""What every kind of mesh file is asked: vertices that are numbers, corners that exist, polygons cut to triangles."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from jaxrt.description import SceneError, show
from jaxrt.description.mesh_facts import Floats, Ints
from jaxrt.description.values import FLOAT32_MAX
from jaxrt.io.meshes.polygons import Polygons, triangulate

Place = Callable[[int], str]  # where in the file the i-th thing stands


class Mesh(NamedTuple):
    """What a mesh file holds."""

    vertices: Floats  # (v, 3)
    faces: Ints  # (n, 3)
    notes: list[str]  # what the file holds and the mesh does not
    uv: Floats | None = None  # (k, 2)
    face_uv: Ints | None = None  # (n, 3) rows of `uv`; None: those of the vertices
    colors: Floats | None = None  # (v, 3) linear, in [0, 1]

    @property
    def table(self) -> dict[str, Any]:
        """What there is, as a table of the scene file."""
        parts = {"vertices": self.vertices, "faces": self.faces, "uv": self.uv, "face_uv": self.face_uv}
        return {key: value for key, value in (parts | {"colors": self.colors}).items() if value is not None}


def left_over(count: int, where: str) -> str:
    """Return the note of bytes that no count announces."""
    return f"{count} byte{'s are' if count > 1 else ' is'} left out after the last {where}"


def no_faces(source: str, why: str = "") -> SceneError:
    """Return the error of a file without faces."""
    return SceneError(f"{source}: no faces{why}: save the mesh with its faces")


def check_vertices(source: str, vertices: Floats, place: Place) -> None:
    """Raise SceneError for a vertex that is not finite or too large for float32."""
    wrong = np.flatnonzero(np.any(~(np.abs(vertices) <= FLOAT32_MAX), axis=-1))
    if not len(wrong):
        return
    vertex = vertices[wrong[0]]
    trouble = "is too large for float32: stay within ±3.4e38"
    if not np.isfinite(vertex).all():
        trouble = "is not finite: repair the mesh"
    raise SceneError(f"{source}: {place(int(wrong[0]))}: {show(vertex.tolist())} {trouble}")


def check_polygons(source: str, polygons: Polygons, count: int, place: Place) -> None:
    """Raise SceneError for a polygon of less than 3 corners, or of a vertex beyond `count`, counted from 0."""
    short = np.flatnonzero(polygons.sizes < 3)
    if len(short):
        size = polygons.sizes[short[0]]
        raise SceneError(f"{source}: {place(int(short[0]))}: a face of {size} vertices: name 3 or more")
    wrong = np.flatnonzero((polygons.corners < 0) | (polygons.corners >= count))
    if len(wrong):
        known = f"use 0 to {count - 1}" if count else "the file has no vertices"
        trouble = f"vertex {polygons.corners[wrong[0]]} does not exist: {known}"
        raise SceneError(f"{source}: {place(polygons.owner(int(wrong[0])))}: {trouble}")


def cut_corners(vertices: Floats, polygons: Polygons, place: Place) -> tuple[Ints, Ints, list[str]]:
    """Return what `cut` does, but the corners (n, 3) as numbers in `polygons.corners`.

    A vertex may be at several places of a texture, so that its number does not tell which.
    """
    apart = Polygons(np.arange(len(polygons.corners)), polygons.sizes)
    return cut(vertices[polygons.corners], apart, place)


def cut(vertices: Floats, polygons: Polygons, place: Place) -> tuple[Ints, Ints, list[str]]:
    """Return the triangles (n, 3) of sound polygons, the polygon (n,) of each, and what was done to crossed ones."""
    found = triangulate(vertices, polygons)
    count = len(polygons.sizes)
    notes = []
    for numbers, trouble in (
        (found.uncrossed, "corners in crossed order, which is mended"),
        (found.crossed, "outlines that cross themselves, and are cut as fans: split them into triangles"),
    ):
        if len(numbers):
            notes.append(f"{len(numbers)} of {count} polygons have {trouble} (first: {place(int(numbers[0]))})")
    return found.triangles, found.sources, notes
