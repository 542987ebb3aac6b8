"""What several checks ask of a scene."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from jaxrt.description import Glass, MeshDescription, SceneDescription, SphereDescription
from jaxrt.description.box_tree import Floats, Ints
from jaxrt.description.mesh_facts import count_edges


class Body:
    """A mesh of the scene, and what takes a while to find out about it."""

    def __init__(self, number: int, mesh: MeshDescription, scene: SceneDescription) -> None:
        self.mesh, self.vertices, self.faces = mesh, mesh.world, mesh.faces[mesh.kept]
        self.name = f"meshes[{number}]"
        self.title = self.name + (f" ({mesh.file})" if mesh.file else "")
        self.kinds = [scene.materials[name] for name in mesh.names]

    @property
    def corners(self) -> Floats:
        """Corners (n, 3, 3) of the faces kept."""
        return self.vertices[self.faces]

    @cached_property
    def box(self) -> tuple[Floats, Floats]:
        """Least and largest coordinates (3,) of the vertices."""
        return self.vertices.min(axis=0), self.vertices.max(axis=0)

    @cached_property
    def closed(self) -> bool:
        """Whether no edge has one face only."""
        return not count_edges(self.vertices, self.faces).open

    def has(self, kind: type) -> bool:
        """Return whether any material of the mesh is of this kind."""
        return any(isinstance(material, kind) for material in self.kinds)

    def faces_of(self, kind: type) -> Ints:
        """Return the faces (m, 3) of that kind of material."""
        return self.faces[np.array([isinstance(material, kind) for material in self.kinds])[self.mesh.rows]]


def bodies_of(scene: SceneDescription) -> list[Body]:
    """Return the meshes of a scene."""
    return [Body(i, mesh, scene) for i, mesh in enumerate(scene.meshes)]


def spheres_of(scene: SceneDescription, *, glass: bool) -> list[int]:
    """Return the numbers of the spheres that are, or are not, of glass."""
    return [i for i, s in enumerate(scene.spheres) if isinstance(scene.materials[s.material], Glass) == glass]


def centers_and_radii(spheres: Sequence[SphereDescription]) -> tuple[Floats, Floats]:
    """Return the centres (n, 3) and radii (n,) as arrays."""
    return np.array([s.center for s in spheres], float).reshape(-1, 3), np.array([s.radius for s in spheres], float)


def inside(point: Floats, centers: Floats, radii: Floats) -> NDArray[np.bool_]:
    """Return for each sphere (n,) whether it holds `point`."""
    return np.linalg.norm(centers - point, axis=-1) < radii


def more(count: int, what: str) -> str:
    """Return what a line that tells of the first of several things ends with."""
    return f" (and {count - 1} more {what})" if count > 1 else ""
