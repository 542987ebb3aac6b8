"""Which faces of a mesh share an edge: integers, found once on the host, where the scene is built."""

import math

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxrt.core.pytree import pytree
from jaxrt.description.mesh_facts import cross, weld


@pytree
class MeshEdges:
    """The edges of a mesh, each once. As many rows for each mesh of so many faces; the surplus is not `used`."""

    vertices: Array  # (e, 2) int32 rows of the vertices of both ends
    opposite: Array  # (e, 2) int32 the third vertex of each of its two faces; twice the same where there is one face
    faces: Array  # (e, 2) int32 rows of these faces
    used: Array  # (e,) bool


def mesh_edges(vertices: np.ndarray, faces: np.ndarray) -> MeshEdges:
    """Return the edges of faces (n, 3) of vertices (v, 3) as they stand: those at the same place count as one.

    Faces without area, to the rounding of the vertices' own dtype, count as absent. Two faces share an edge whatever
    their winding. Of three faces at one edge the third has it for itself.
    """
    present, together = np.flatnonzero(_has_area(vertices[faces])), weld(vertices)
    rows, n = faces[present], len(faces)
    # One row for each side of each face, sorted so that equal ones meet
    start, end, tip = (np.roll(rows, -k, axis=1).ravel() for k in range(3))
    face = np.repeat(present, 3)
    a, b = together[start], together[end]
    key = np.minimum(a, b) * len(vertices) + np.maximum(a, b)
    order = np.argsort(key, kind="stable")
    key, start, end, tip, face = (x[order] for x in (key, start, end, tip, face))
    real = a[order] != b[order]
    # Pair each row with the next one of the same edge
    fresh = np.append(True, key[1:] != key[:-1])
    number = np.arange(len(key))
    rank = number - np.maximum.accumulate(np.where(fresh, number, 0))
    first = np.flatnonzero(real & (rank % 2 == 0))
    second = np.where(np.append(~fresh[1:], False), number + 1, number)[first]
    # A closed surface has 1.5 edges a face, an open one those of its rim besides; no mesh has more than 3
    room = math.ceil(1.5 * n + 4 * math.sqrt(n))
    room = room if len(first) <= room < 3 * n else 3 * n

    def filled(*columns: np.ndarray) -> Array:
        return jnp.asarray(np.pad(np.stack(columns, -1), ((0, room - len(first)), (0, 0))), jnp.int32)

    return MeshEdges(
        vertices=filled(start[first], end[first]),
        opposite=filled(tip[first], tip[second]),
        faces=filled(face[first], face[second]),
        used=jnp.asarray(np.arange(room) < len(first)),
    )


def _has_area(corners: np.ndarray) -> np.ndarray:
    """Return for each face of corners (n, 3, 3) whether it has an area that is more than rounding."""
    edge1, edge2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    rounding = 2 * np.finfo(corners.dtype).eps * np.abs(edge1).max(-1) * np.abs(edge2).max(-1)
    return np.abs(cross(edge1, edge2)).max(-1) > rounding
