"""Where meshes and groups stand: parameters of scenes that were asked for them, and nothing of what is compiled.

Such a scene holds the vertices of its meshes, and the spheres of its groups, as they are before their poses place them;
`place` places them, in one small program of its own, before a picture is drawn.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import DTypeLike
from numpy.typing import NDArray

from jaxrt.core.maths import turn_less_one, turned_by
from jaxrt.core.pytree import pytree, static
from jaxrt.description import SceneDescription
from jaxrt.description.pose import PoseTable, euler_matrix
from jaxrt.shapes import Spheres, Triangles

DEGREE = np.pi / 180
FIELDS = ("translate", "rotate", "scale")
POSES = {f"{owner}.{field}": (owner, field) for owner in ("meshes", "groups") for field in FIELDS}  # parameters


@pytree
class Pose:
    """Where things stand, one a row: x is placed at scale · R (turn x + pivot) − pivot + translate."""

    translate: Array  # (n, 3) scene units
    rotate: Array  # (n, 3) rotation vectors, degrees: of R
    scale: Array  # (n,)
    turn: Array | None = None  # (n, 3, 3) the scene file's own rotation; None: vertices have it already
    pivot: Array | None = None  # (n, 3) where it takes the scene's origin, in the user's coordinates; None: 0


@pytree
class Poses:
    """The poses of a scene's meshes and groups."""

    meshes: Pose | None
    groups: Pose | None
    first: Array | None  # (m + 1,) int32 first vertex of each mesh, then of single triangles; None without meshes
    of_meshes: Array | None  # (m,) int32 group of each mesh, −1 for none; None without groups
    of_spheres: Array | None  # (s,) int32 group of each sphere, −1 for none
    asked: bool = static(default=False)  # whether poses are parameters, and shapes not yet placed


Floats = NDArray[np.float64]
Shapes = tuple[Spheres | None, Triangles | None]


def poses_of(scene: SceneDescription, origin: np.ndarray, dtype: DTypeLike) -> Poses | None:
    """Return the poses in a description, not asked for; None where nothing has one."""
    if not scene.meshes and not scene.groups:
        return None
    numbers = {name: i for i, name in enumerate(scene.groups)}

    def groups_of(members: Any) -> Array | None:
        rows = [-1 if member.group is None else numbers[member.group] for member in members]
        return jnp.asarray(rows, jnp.int32) if rows and numbers else None

    first = np.cumsum([0] + [len(mesh.vertices) for mesh in scene.meshes])
    return Poses(
        _rows(scene.meshes, -origin, dtype) if scene.meshes else None,
        _group_rows(list(scene.groups.values()), origin, dtype) if scene.groups else None,
        jnp.asarray(first, jnp.int32) if scene.meshes else None,
        groups_of(scene.meshes),
        groups_of(scene.spheres),
    )


def _rows(tables: Any, shift: np.ndarray, dtype: DTypeLike) -> Pose:
    values = ([getattr(table, field) for table in tables] for field in ("translate", "rotate_vector", "scale"))
    translate, rotate, scale = (np.asarray(value, float) for value in values)
    return Pose(*(jnp.asarray(value, dtype) for value in (translate + shift, rotate, scale)))


def _group_rows(groups: list[PoseTable], origin: np.ndarray, dtype: DTypeLike) -> Pose:
    """Return the poses of groups. What they turn about, the user's origin, may be far from the scene's."""
    turn = np.stack([euler_matrix(group.rotate) for group in groups])
    pivot = np.sum(turn * origin, axis=-1)
    pose = _rows(groups, pivot - origin, dtype)
    return replace(pose, turn=jnp.asarray(turn, dtype), pivot=jnp.asarray(pivot, dtype) if origin.any() else None)


def asking(poses: Poses | None, spheres: Spheres | None, triangles: Triangles | None) -> tuple[Poses | None, Shapes]:
    """Return the poses as parameters, and the shapes as they are before these place them."""
    if poses is None or poses.asked:
        return poses, (spheres, triangles)
    return replace(poses, asked=True), _moved(poses, spheres, triangles, back=True)


def place(poses: Poses | None, spheres: Spheres | None, triangles: Triangles | None) -> Shapes:
    """Return the shapes where they stand."""
    return _moved(poses, spheres, triangles, back=False) if poses and poses.asked else (spheres, triangles)


def moved_by(
    poses: Poses, name: str, row: int | None, spheres: int, vertices: int
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which spheres (s,) and vertices (v,) move with a row of a pose's parameter, None for any row."""

    def named(rows: Array | None, count: int) -> NDArray[np.bool_]:
        numbers = np.full(count, -1) if rows is None else np.asarray(rows)
        return numbers >= 0 if row is None else numbers == row

    if name not in POSES:
        return np.zeros(spheres, bool), np.zeros(vertices, bool)
    count = 0 if poses.first is None else len(poses.first) - 1
    meshes = named(jnp.arange(count), count) if POSES[name][0] == "meshes" else named(poses.of_meshes, count)
    balls = named(None if POSES[name][0] == "meshes" else poses.of_spheres, spheres)
    sizes = np.diff(np.asarray(poses.first if count else [0]), append=vertices)
    return balls, np.repeat(np.append(meshes, False) if count else [False], sizes)


def pivot_of(poses: Poses | None, name: str, row: int | None) -> Floats:
    """Return the place (3,) about which a row of a pose's parameter turns and scales, as the mesh's group has it."""
    assert poses is not None
    owner, row = POSES[name][0], row or 0
    pose = getattr(poses, owner)
    group = poses.of_meshes[row : row + 1] if owner == "meshes" and poses.of_meshes is not None else None
    place = pose.translate[row : row + 1] - (0 if pose.pivot is None else pose.pivot[row : row + 1])
    if group is not None and poses.groups is not None:
        place = _forth(poses.groups, group, place)
    return np.asarray(place, float)[0]


def pose_parameters(poses: Poses | None) -> dict[str, Array]:
    """Return the poses by the names of parameters, where they were asked for."""
    if poses is None or not poses.asked:
        return {}
    owners = {name: (getattr(poses, owner), field) for name, (owner, field) in POSES.items()}
    return {name: getattr(pose, field) for name, (pose, field) in owners.items() if pose is not None}


def with_pose_parameters(poses: Poses | None, new: Mapping[str, Array]) -> Poses | None:
    """Return the poses with new values of some parameters."""
    for name, (owner, field) in POSES.items():
        if name in new:
            assert poses is not None
            poses = replace(poses, **{owner: replace(getattr(poses, owner), **{field: new[name]})})
    return poses


def shapes_with(
    poses: Poses | None, spheres: Spheres | None, triangles: Triangles | None, new: Mapping[str, Array]
) -> Shapes:
    """Return the shapes with new values, placed, of some parameters."""
    changes: dict[str, dict[str, Any]] = {
        owner: {name.split(".")[1]: new[name] for name in names if name in new}
        for owner, names in (("spheres", ("spheres.center", "spheres.radius")), ("meshes", ("meshes.vertices",)))
    }
    if not any(changes.values()):
        return spheres, triangles
    spheres, triangles = place(poses, spheres, triangles)
    spheres = spheres and replace(spheres, **changes["spheres"])
    triangles = triangles and replace(triangles, **changes["meshes"])
    return _moved(poses, spheres, triangles, back=True) if poses and poses.asked else (spheres, triangles)


def _moved(poses: Poses, spheres: Spheres | None, triangles: Triangles | None, back: bool) -> Shapes:
    """Return the shapes, taken to where their poses place them, or back."""
    if triangles is not None and poses.meshes is not None:
        triangles = replace(triangles, vertices=_vertices(poses, triangles.vertices, back))
    if spheres is not None and poses.of_spheres is not None:
        center, radius, lost = _balls(poses, spheres.center, spheres.radius, spheres.lost, back)
        spheres = replace(spheres, center=center, radius=radius, lost=lost)
    return spheres, triangles


@partial(jax.jit, static_argnames="back")
def _vertices(poses: Poses, vertices: Array, back: bool) -> Array:
    assert poses.meshes is not None and poses.first is not None
    count = len(poses.first) - 1
    mesh = jnp.searchsorted(poses.first, jnp.arange(len(vertices), dtype=jnp.int32), side="right").astype(jnp.int32) - 1
    mesh = jnp.where(mesh < count, mesh, -1)  # single triangles
    steps = [(poses.meshes, mesh)]
    if poses.groups is not None and poses.of_meshes is not None:
        steps.append((poses.groups, jnp.where(mesh < 0, -1, poses.of_meshes[mesh])))
    for pose, rows in reversed(steps) if back else steps:
        vertices = (_back if back else _forth)(pose, rows, vertices)
    return vertices


@partial(jax.jit, static_argnames="back")
def _balls(poses: Poses, center: Array, radius: Array, lost: Array, back: bool) -> tuple[Array, Array, Array]:
    groups, rows = poses.groups, poses.of_spheres
    assert groups is not None and rows is not None
    scale = jnp.where(rows < 0, 1, groups.scale[rows])
    if back:
        return _back(groups, rows, center), radius / scale, lost / scale
    return _forth(groups, rows, center), radius * scale, lost * scale


def _forth(pose: Pose, rows: Array, points: Array) -> Array:
    """Return points (n, 3) where the poses of their rows place them; those of row −1 stay."""
    more, scale = turn_less_one(pose.rotate * DEGREE)[rows], pose.scale[rows][:, None]
    x = points if pose.turn is None else turned_by(pose.turn[rows], points)
    turned = x + turned_by(more, x)
    if pose.pivot is None:
        placed = scale * turned
    else:  # of large numbers only the differences
        pivot = pose.pivot[rows]
        placed = scale * (turned + turned_by(more, pivot)) + (scale - 1) * pivot
    return jnp.where((rows < 0)[:, None], points, placed + pose.translate[rows])


def _back(pose: Pose, rows: Array, places: Array) -> Array:
    """Return the points (n, 3) that `_forth` places there."""
    more, scale = turn_less_one(pose.rotate * DEGREE)[rows], pose.scale[rows][:, None]
    x = places - pose.translate[rows]
    if pose.pivot is None:
        x = x / scale
    else:
        pivot = pose.pivot[rows]
        x = (x - (scale - 1) * pivot) / scale - turned_by(more, pivot)
    x = x + turned_by(jnp.swapaxes(more, -1, -2), x)
    x = x if pose.turn is None else turned_by(jnp.swapaxes(pose.turn[rows], -1, -2), x)
    return jnp.where((rows < 0)[:, None], places, x)
