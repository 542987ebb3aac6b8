"""What several checks ask of a scene."""

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from jaxrt.description import MeshDescription, SceneDescription, SphereDescription
from jaxrt.description.box_tree import Floats, Ints
from jaxrt.description.kinds import MATERIALS
from jaxrt.description.mesh_facts import count_edges
from jaxrt.description.values import Table


def transmits(material: Table) -> bool:
    """Return whether light passes through what is of this material, as through glass."""
    return MATERIALS.kind_of(material).cls.transmits


def is_lit(material: Table) -> bool:
    """Return whether light samples light it: it does not only reflect in single directions."""
    return not MATERIALS.kind_of(material).cls.is_delta


class Body:
    """A mesh of the scene, and what takes a while to find out about it."""

    def __init__(self, number: int, mesh: MeshDescription, scene: SceneDescription) -> None:
        self.mesh, self.vertices, self.faces = mesh, mesh.world, mesh.faces[mesh.kept]
        self.name = f"meshes[{number}]"
        self.title = self.name + (f" ({mesh.file})" if mesh.file else "")
        self.materials = [scene.materials[name] for name in mesh.names]

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

    def has(self, test: Callable[[Table], bool]) -> bool:
        """Return whether any material of the mesh passes a test."""
        return any(map(test, self.materials))

    def faces_of(self, test: Callable[[Table], bool]) -> Ints:
        """Return the faces (m, 3) whose material passes a test."""
        return self.faces[np.array([test(material) for material in self.materials])[self.mesh.rows]]


def bodies_of(scene: SceneDescription) -> list[Body]:
    """Return the meshes of a scene."""
    return [Body(i, mesh, scene) for i, mesh in enumerate(scene.meshes)]


def spheres_of(scene: SceneDescription, *, opaque: bool) -> list[int]:
    """Return the numbers of the spheres that light does not, or does, pass through."""
    return [i for i, s in enumerate(scene.spheres) if transmits(scene.materials[s.material]) != opaque]


def centers_and_radii(spheres: Sequence[SphereDescription]) -> tuple[Floats, Floats]:
    """Return the centres (n, 3) and radii (n,) as arrays."""
    return np.array([s.center for s in spheres], float).reshape(-1, 3), np.array([s.radius for s in spheres], float)


def inside(point: tuple[float, float, float], centers: Floats, radii: Floats) -> NDArray[np.bool_]:
    """Return for each sphere (n,) whether it holds `point`."""
    return np.linalg.norm(centers - np.array(point), axis=-1) < radii


def more(count: int, what: str) -> str:
    """Return what a line that tells of the first of several things ends with."""
    return f" (and {count - 1} more {what})" if count > 1 else ""
