"""Faces that lie on one another, so that rounding decides which one a ray meets."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from jaxrt.description import SceneDescription
from jaxrt.description.box_tree import Floats, Ints
from jaxrt.description.mesh_facts import cross
from jaxrt.description.mesh_pairs import coincident_pairs
from jaxrt.scene.checks.common import Body, transmits


def coincident_faces(scene: SceneDescription, bodies: Sequence[Body]) -> Iterator[str]:
    """Find faces in one plane that overlap: the first pair of each two meshes.

    A closed opaque body may stand on another: there is nothing to see between them.
    """
    singles = np.array([t.vertices for t in scene.triangles], float).reshape(-1, 3, 3)
    corners = np.concatenate([*(body.corners for body in bodies), singles]) - scene.origin
    if len(corners) < 2:
        return
    own = np.repeat(np.arange(len(bodies) + 1), [*(len(body.faces) for body in bodies), len(singles)])
    numbers = np.concatenate([*(body.mesh.kept for body in bodies), np.arange(len(singles))]).astype(np.int64)
    told: set[tuple[int, int]] = set()
    for pairs in coincident_pairs(corners, own):
        kinds = np.column_stack([own[pairs], _opposed(corners, pairs)])
        # Of each two bodies and way to lie, one pair
        for row in np.unique(kinds, axis=0, return_index=True)[1]:
            first, second, opposed = (int(x) for x in kinds[row])
            if (first, second) in told or (opposed and _may_stand(bodies, (first, second))):
                continue
            told.add((first, second))
            one, other = (_name(bodies, int(own[face]), int(numbers[face])) for face in pairs[row])
            yield (
                f"{one} and {other} lie in one plane and overlap: rounding decides which one is seen, move one off "
                "the other or remove it"
            )


def _opposed(corners: Floats, pairs: Ints) -> NDArray[np.bool_]:
    """Return whether the outsides of the two faces of each pair (m, 2) are opposite ones."""
    a, b = (cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]) for c in (corners[pairs[:, 0]], corners[pairs[:, 1]]))
    return np.sum(a * b, axis=-1) < 0


def _may_stand(bodies: Sequence[Body], both: tuple[int, int]) -> bool:
    """Return whether what is between two bodies is hidden: both are opaque and one is closed."""
    meshes = [bodies[i] for i in both if i < len(bodies)]
    return not any(body.has(transmits) for body in meshes) and any(body.closed for body in meshes)


def _name(bodies: Sequence[Body], body: int, face: int) -> str:
    return f"triangles[{face}]" if body == len(bodies) else f"face {face} of {bodies[body].title}"
