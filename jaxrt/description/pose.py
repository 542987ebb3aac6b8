"""Where things stand: scaled, turned and moved. NumPy, float64."""

from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator

from jaxrt.description.mesh_facts import Floats
from jaxrt.description.values import Number, Size, Table, Vector, complaint, require, show, three

Angles = Annotated[tuple[Number, Number, Number], BeforeValidator(three)]
Scale = Annotated[Size, require(lambda x: x > 0, "is not > 0: use a positive scale")]


def _boolean(value: Any) -> bool:
    if not isinstance(value, bool | np.bool_):
        raise complaint(f"{show(value)} is not a truth value: write true or false")
    return bool(value)


Boolean = Annotated[bool, BeforeValidator(_boolean)]


class PoseTable(Table):
    """What `scale`, then `rotate`, then `rotate_vector`, then `translate` place, all about its own origin."""

    scale: Scale = 1.0
    rotate: Angles = (0.0, 0.0, 0.0)  # degrees about x, then y, then z
    rotate_vector: Angles = (0.0, 0.0, 0.0)  # the axis, as long as the angle in degrees
    translate: Vector = (0.0, 0.0, 0.0)
    pose: Boolean = False  # scale, rotate_vector and translate are parameters

    def placed(self, points: Floats) -> Floats:
        """Return points (n, 3) where they are placed."""
        return turned(self.scale * points, self.rotate, self.rotate_vector) + np.array(self.translate)

    def unplaced(self, places: NDArray[np.floating]) -> NDArray[np.floating]:
        """Return the points (n, 3) that are placed there."""
        moved = places - np.array(self.translate)
        return (moved @ rotation_matrix(self.rotate_vector) @ euler_matrix(self.rotate)) / self.scale


class GroupDescription(PoseTable):
    """Spheres and meshes that name the group are placed in it first, and then with it."""


def joined(inner: PoseTable, outer: PoseTable) -> dict[str, Any]:
    """Return the fields of the pose that places as `inner` does and then `outer`."""
    turn = rotation_matrix(outer.rotate_vector) @ euler_matrix(outer.rotate)
    turn = turn @ rotation_matrix(inner.rotate_vector) @ euler_matrix(inner.rotate)
    same = not any((*outer.rotate, *outer.rotate_vector))
    return {
        "scale": outer.scale * inner.scale,
        "rotate": inner.rotate if same else (0.0, 0.0, 0.0),
        "rotate_vector": inner.rotate_vector if same else rotation_vector(turn),
        "translate": tuple(outer.placed(np.array(inner.translate)[None])[0].tolist()),
    }


def turned(points: Floats, rotate: tuple[float, float, float], vector: tuple[float, float, float]) -> Floats:
    """Return points (n, 3), turned about x, y and z and then about a vector, in degrees."""
    if any(rotate):
        points = points @ euler_matrix(rotate).T
    return points @ rotation_matrix(vector).T if any(vector) else points


def euler_matrix(degrees: tuple[float, float, float]) -> Floats:
    """Return the matrix that turns about x, then y, then z."""
    total = np.eye(3)
    for axis, angle in enumerate(np.radians(degrees)):
        turn = np.eye(3)
        i, j = (axis + 1) % 3, (axis + 2) % 3
        turn[[i, j], [i, j]] = np.cos(angle)
        turn[j, i], turn[i, j] = np.sin(angle), -np.sin(angle)
        total = turn @ total
    return total


def rotation_matrix(degrees: tuple[float, float, float]) -> Floats:
    """Return the matrix of a rotation vector in degrees."""
    x, y, z = np.radians(degrees)
    angle = float(np.hypot(np.hypot(x, y), z))
    axis = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sinc(angle / np.pi) * axis + np.sinc(angle / (2 * np.pi)) ** 2 / 2 * axis @ axis


def rotation_vector(matrix: Floats) -> tuple[float, float, float]:
    """Return the rotation vector, in degrees, of a matrix (by way of the quaternion: Shepperd 1978)."""
    m = matrix
    # Four times q qᵀ, of q = (w, x, y, z): its longest row loses nothing
    products = np.array(
        [
            [1 + m[0, 0] + m[1, 1] + m[2, 2], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], 1 + m[0, 0] - m[1, 1] - m[2, 2], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0]],
            [m[0, 2] - m[2, 0], m[0, 1] + m[1, 0], 1 - m[0, 0] + m[1, 1] - m[2, 2], m[1, 2] + m[2, 1]],
            [m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], 1 - m[0, 0] - m[1, 1] + m[2, 2]],
        ]
    )
    q = products[np.argmax(np.diag(products))]
    q = q / np.linalg.norm(q) * (1 if q[0] >= 0 else -1)
    sine = float(np.linalg.norm(q[1:]))
    if sine == 0:
        return (0.0, 0.0, 0.0)
    x, y, z = np.degrees(2 * np.arctan2(sine, q[0])) * q[1:] / sine
    return float(x), float(y), float(z)
