"""Cameras as OpenCV has them, K, R, t and distortion, and back.

OpenCV's camera looks along +z with +y down, takes a point p of the world to R p + t, and counts pixels from the middle
of the upper left one, where jaxrt's picture has (0.5, 0.5).
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jaxrt.cameras.looking import axes_of
from jaxrt.description import SceneError, show
from jaxrt.description.pose import rotation_matrix
from jaxrt.scene.record import Scene, check_scene

Floats = NDArray[np.float64]

CORNER = -0.5  # column and row of the picture's upper left corner, as OpenCV counts
COEFFICIENTS = "k1", "k2", "p1", "p2", "k3"
ORTHONORMAL = 1e-4  # by so much R Rᵀ may differ from 1


class OpenCV(NamedTuple):
    """A camera as OpenCV has it."""

    K: Floats  # (3, 3) in pixels
    R: Floats  # (3, 3) from the world's axes to the camera's
    t: Floats  # (3,) scene units
    distortion: Floats  # (5,) k1, k2, p1, p2, k3


def camera_from_opencv(
    K: ArrayLike,
    R: ArrayLike,
    t: ArrayLike,
    distortion: ArrayLike | None = None,
    width: int | None = None,
    height: int | None = None,
    *,
    corner: float = CORNER,
) -> dict[str, Any]:
    """Return the `camera` table, of type "calibrated", of a camera that OpenCV has calibrated.

    K: (3, 3). R: (3, 3), or the rotation vector (3,) in radians. t: (3,) in scene units. distortion: up to five of k1,
    k2, p1, p2, k3, by default none; those that are 0 are left out. width, height: of its pictures; by default such that
    the axis goes through their middle. corner: column and row of the upper left corner, 0 for tools that count from
    there, as COLMAP. Raises SceneError for shapes, skew, further coefficients, an R that is no rotation, and what is
    not finite.
    """
    matrix, place = _array("K", K, (3, 3)), _array("t", t, (3,))
    focal, middle = matrix[[0, 1], [0, 1]], matrix[:2, 2] - corner
    if (
        np.abs(matrix - [[focal[0], 0, matrix[0, 2]], [0, focal[1], matrix[1, 2]], [0, 0, 1]]).max()
        > 1e-6 * focal.max()
    ):
        raise SceneError(
            f"K: {show(matrix.tolist())} has skew or another last row than 0, 0, 1: cameras here have none"
        )
    bent = np.ravel(np.asarray(() if distortion is None else distortion, float))
    if not np.isfinite(bent).all():
        raise SceneError(f"distortion: {show(bent.tolist())} is not finite: leave it out for none")
    if np.any(bent[len(COEFFICIENTS) :]):
        raise SceneError(
            f"distortion: {show(bent.tolist())} has more than {', '.join(COEFFICIENTS)}: calibrate with these"
        )
    turn = _rotation(R)
    position = -turn.T @ place
    far = max(1.0, float(np.linalg.norm(position)))  # so that float32 keeps its direction
    size = [int(n or max(1, round(2 * x))) for n, x in zip((width, height), middle, strict=True)]
    return {
        "type": "calibrated",
        "position": position.tolist(),
        "target": (position + far * turn[2]).tolist(),
        "up": (-turn[1]).tolist(),
        "width": size[0],
        "height": size[1],
        **dict(zip(("fx", "fy", "cx", "cy"), [*focal.tolist(), *middle.tolist()], strict=True)),
        **{name: x for name, x in zip(COEFFICIENTS, bent.tolist(), strict=False) if x},
    }


def camera_to_opencv(scene: Scene, *, corner: float = CORNER) -> OpenCV:
    """Return (K, R, t, distortion) of a scene's camera, a pinhole or calibrated, for pictures of its size.

    corner: as for `camera_from_opencv`. Raises SceneError for other cameras.
    """
    check_scene(scene)
    camera = scene.camera
    if camera.kind.name not in ("pinhole", "calibrated"):
        raise SceneError(
            f"camera: is {camera.kind.name!r}, which OpenCV's K cannot tell: use a pinhole or calibrated one"
        )
    size = np.array([camera.width, camera.height])
    if camera.kind.name == "pinhole":
        focal, middle = np.full(2, size[1] / 2 / np.tan(np.radians(float(camera.fov)) / 2)), size / 2
    else:
        scale = size / camera.size
        focal = scale * [float(camera.fx), float(camera.fy)]
        middle = scale * [float(camera.cx), float(camera.cy)]
    right, up, forward = (np.asarray(axis, float) for axis in axes_of(camera))
    left_vectors, _, right_vectors = np.linalg.svd(np.stack([right, -up, forward]))
    turn = left_vectors @ right_vectors  # the nearest rotation: float32's is one to seven digits
    origin = np.zeros(3) if scene.origin is None else np.asarray(scene.origin, float)
    K = np.diag([*focal, 1.0])
    K[:2, 2] = middle + corner
    bent = np.array([float(getattr(camera, name, None) or 0) for name in COEFFICIENTS])
    return OpenCV(K, turn, -turn @ (np.asarray(camera.position, float) + origin), bent)


def _array(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Floats:
    array = np.asarray(value, float)
    if array.size != np.prod(shape) or not np.isfinite(array).all():
        raise SceneError(f"{name}: {show(array.tolist())} is not {shape} finite numbers")
    return array.reshape(shape)


def _rotation(R: ArrayLike) -> Floats:
    """Return the matrix (3, 3) of a rotation, given so or as its vector."""
    if np.size(np.asarray(R, float)) == 3:
        x, y, z = np.degrees(_array("R", R, (3,))).tolist()
        return rotation_matrix((x, y, z))
    turn = _array("R", R, (3, 3))
    if np.abs(turn @ turn.T - np.eye(3)).max() > ORTHONORMAL or np.linalg.det(turn) < 0:
        raise SceneError(f"R: {show(turn.tolist())} is no rotation: give world-to-camera, with +y down and +z ahead")
    return turn
