"""Meshes: vertices and faces as NumPy arrays, and where they stand in the scene."""

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, ConfigDict, Field, model_validator

from jaxrt.description.mesh_facts import Floats, Ints, faces_with_area
from jaxrt.description.pose import Boolean, PoseTable
from jaxrt.description.values import LONGEST, Name, complaint, show


def _array(kind: type, shape: tuple[int, ...], example: str) -> Callable[[Any], NDArray[Any]]:
    """Return a validator that makes an array of `kind` and of `shape`, where 0 stands for any number of rows."""

    def check(value: Any) -> NDArray[Any]:
        try:
            array = np.asarray(value)
        except ValueError:
            raise complaint(f"{show(value)} has rows of different lengths: write {example}") from None
        fits = array.ndim == len(shape) and all(b in (0, a) for a, b in zip(array.shape, shape, strict=True))
        numeric = np.issubdtype(array.dtype, np.integer) or (kind is float and np.issubdtype(array.dtype, np.floating))
        if not (fits and numeric and array.size):
            raise complaint(f"an array {array.shape} of {array.dtype} does not fit: write {example}")
        return array.astype(np.float64 if kind is float else np.int64)

    return check


Vertices = Annotated[Any, BeforeValidator(_array(float, (0, 3), "(v, 3) numbers, such as [[0, 0, 0], …]"))]
Faces = Annotated[Any, BeforeValidator(_array(int, (0, 3), "(n, 3) rows of the vertices, such as [[0, 1, 2], …]"))]
Uv = Annotated[Any, BeforeValidator(_array(float, (0, 2), "(k, 2) numbers, such as [[0, 0], …]"))]
Colors = Annotated[Any, BeforeValidator(_array(float, (0, 3), "(v, 3) numbers in [0, 1], one row a vertex"))]
Rows = Annotated[Any, BeforeValidator(_array(int, (0,), "(n,) whole numbers, one a face"))]


class MeshDescription(PoseTable):
    """A mesh: `scale`, then `rotate`, `rotate_vector` and `translate` place its vertices."""

    model_config = ConfigDict(frozen=True, extra="forbid", arbitrary_types_allowed=True)

    name: Name | None = None  # by which its vertices may be called
    file: Name | None = None  # where the arrays come from, if from a file
    notes: Name | None = None  # what the file holds and the arrays do not, in one line
    vertices: Vertices = Field(default=None)  # (v, 3) float64
    faces: Faces = Field(default=None)  # (n, 3) int64 rows of `vertices`, counter-clockwise seen from outside
    material: Name | None = None  # of all faces
    materials: dict[str, Any] | None = None  # those that the file brings along, where `material` names none
    face_materials: Rows | None = None  # (n,) row of `materials` of each face
    smooth: Boolean = False
    group: Name | None = None  # with which it is placed, once it is placed itself
    uv: Uv | None = None  # (k, 2) places on textures
    face_uv: Faces | None = None  # (n, 3) rows of `uv` of each face's corners; None: those of its vertices
    colors: Colors | None = None  # (v, 3) linear, in [0, 1]
    textures: dict[str, Any] | None = None  # those that the file's materials bring along

    @model_validator(mode="before")
    @classmethod
    def _check_parts(cls, value: Any) -> Any:
        if not isinstance(value, Mapping):
            return value
        if "vertices" not in value and "file" in value:
            raise complaint(
                f"{show(value['file'])} has not been read: take load_scene, or **jaxrt.load_mesh({value['file']!r})",
                "file",
            )
        for key, example in (("vertices", "vertices = [[0, 0, 0], …] or file"), ("faces", "faces = [[0, 1, 2], …]")):
            if key not in value and "file" not in value:
                raise complaint(f"{show(key)} is missing: add {example}")
        if "material" not in value and "materials" not in value:
            raise complaint('"material" is missing: add material = "white"')
        return value

    @model_validator(mode="after")
    def _check_indices(self) -> Self:
        wrong = (self.faces < 0) | (self.faces >= len(self.vertices))
        if wrong.any():
            face, corner = (int(i) for i in np.argwhere(wrong)[0])
            text = f"vertex {self.faces[face, corner]} does not exist: use 0 to {len(self.vertices) - 1}"
            raise complaint(text, "faces", face, corner)
        if self.materials is not None and self.material is None:
            rows = self.face_materials
            if rows is None or len(rows) != len(self.faces) or rows.min() < 0 or rows.max() >= len(self.materials):
                raise complaint("do not name one of materials for each face: write (n,) rows", "face_materials")
        return self

    @model_validator(mode="after")
    def _check_corners(self) -> Self:
        if self.uv is not None:
            if self.face_uv is None and len(self.uv) != len(self.vertices):
                text = f"has {len(self.uv)} rows for {len(self.vertices)} vertices: write one each, or face_uv"
                raise complaint(text, "uv")
            if not (np.abs(self.uv) <= LONGEST).all():
                raise complaint("is not finite, or beyond ±1e15: repair the mesh", "uv")
        if self.face_uv is not None:
            rows = 0 if self.uv is None else len(self.uv)
            if self.face_uv.shape != self.faces.shape or not ((0 <= self.face_uv) & (self.face_uv < rows)).all():
                text = f"is not three rows of uv, 0 to {rows - 1}, for each of {len(self.faces)} faces: write them"
                raise complaint(text, "face_uv")
        if self.colors is not None:
            if len(self.colors) != len(self.vertices):
                text = f"has {len(self.colors)} rows for {len(self.vertices)} vertices: write one each"
                raise complaint(text, "colors")
            if not ((self.colors >= 0) & (self.colors <= 1)).all():
                raise complaint("is outside [0, 1]: divide it by its largest value, such as 255", "colors")
        return self

    @model_validator(mode="after")
    def _check_places(self) -> Self:
        with np.errstate(over="ignore", invalid="ignore"):
            far = ~(np.abs(self.world) <= LONGEST)
        if far.any():
            vertex = int(np.argwhere(far)[0, 0])
            raise complaint(f"{show(self.vertices[vertex].tolist())} {self._trouble(vertex)}", "vertices", vertex)
        if not len(self.kept):
            raise complaint("no face has an area that float32 can hold: scale it up or repair it", "faces")
        return self

    def _trouble(self, vertex: int) -> str:
        if not np.isfinite(self.vertices[vertex]).all():
            return "is not finite: repair the mesh"
        return f"stands at {show(self.world[vertex].tolist())}, too far out for float32: stay within ±1e15"

    @cached_property
    def world(self) -> Floats:
        """Vertices (v, 3) in the scene's coordinates, float64."""
        with np.errstate(over="ignore", invalid="ignore"):
            return self.placed(self.vertices)

    @cached_property
    def kept(self) -> Ints:
        """Numbers of the faces that have an area; the others are dropped."""
        return np.flatnonzero(faces_with_area(self.world, self.faces))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the materials, in the order of `rows`."""
        return tuple(self.materials or ()) if self.material is None else (self.material,)

    @cached_property
    def corners_uv(self) -> Floats | None:
        """Places on textures (n, 3, 2) of the corners of the faces kept."""
        if self.uv is None:
            return None
        uv: Floats = self.uv[(self.faces if self.face_uv is None else self.face_uv)[self.kept]]
        return uv

    @cached_property
    def rows(self) -> Ints:
        """Row of `names` for each of the faces kept."""
        if self.material is not None or self.face_materials is None:
            return np.zeros(len(self.kept), np.int64)
        rows: Ints = self.face_materials[self.kept]
        return rows
