"""From a description to a scene.

`build` is the only place where names become indices, and the only one that can refuse a scene.
"""

import warnings
from collections.abc import Mapping
from dataclasses import replace
from os import PathLike
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import DTypeLike

from jaxrt.description import SHARES, SceneDescription, SceneWarning, parse_description, show
from jaxrt.description.kinds import CAMERAS
from jaxrt.description.mesh_facts import weld
from jaxrt.kernels.native import default_devices, everywhere
from jaxrt.lights import lights_of
from jaxrt.scene.checks import check_memory, warnings_of
from jaxrt.scene.lights import order_of_lights
from jaxrt.scene.materials import list_materials
from jaxrt.scene.names import names_of
from jaxrt.scene.poses import poses_of
from jaxrt.scene.record import NoSceneError, Scene, with_poses
from jaxrt.shapes import FaceChart, Spheres, Triangles, lost_digits, mesh_edges, sphere_topology, topology_of
from jaxrt.textures.stack import asks

WIDE = 1e3  # from that ratio on, rays lose a triangle over 1/3000 of the smallest thing's size


def build(description: SceneDescription | Mapping[str, Any], dtype: DTypeLike = jnp.float32) -> Scene:
    """Return the scene that a description, or a mapping shaped like a scene file, tells of.

    dtype: float32, or float64 under `jax_enable_x64`. A far-off scene is moved to the origin in float64 first, since
    float32 coordinates near 1e6 are 1/16 apart. Raises SceneError; warns SceneWarning of what is probably a mistake.
    """
    if isinstance(description, str | PathLike):
        raise NoSceneError(f"build: {show(description)} is the name of a file: use jaxrt.load_scene")
    if not isinstance(description, SceneDescription):
        description = parse_description(description)
    check_memory(description.camera.width, description.camera.height)
    for message in warnings_of(description):
        warnings.warn(message, SceneWarning, stacklevel=2)
    described, description = description, description.flat
    origin = description.origin
    listed = list_materials(description, dtype, origin)
    environment = description.environment
    lights = lights_of(description.lights, dtype, origin)
    poses = poses_of(described, origin, dtype)
    scene = Scene(
        camera=CAMERAS.kind_of(description.camera).single(description.camera, dtype, origin),
        spheres=_spheres(description, listed.rows, origin, dtype),
        triangles=_triangles(description, listed.rows, origin, dtype),
        materials=listed.materials,
        lights=lights,
        environment=None if environment is None else jnp.asarray(environment.radiance, dtype),
        idle=listed.idle,
        order=listed.order | order_of_lights(description.lights, lights),
        origin=jnp.asarray(origin, dtype) if origin.any() else None,
        poses=poses,
        defaults=description.render,
        names=names_of(described, listed.rows),
    )
    if any(table.pose for table in (*described.meshes, *described.groups.values())):
        scene = with_poses(scene)
    devices = default_devices()
    return scene if len(devices) == 1 else everywhere(scene, devices)


def views_of(scene: Scene, description: SceneDescription) -> tuple[Scene, ...]:
    """Return for each camera of a description the scene as it sees it; all else is shared. scene: what was built."""
    origin = description.origin
    others = (CAMERAS.kind_of(table).single(table, scene.dtype, origin) for table in description.views[1:])
    devices = default_devices()
    placed = (camera if len(devices) == 1 else everywhere(camera, devices) for camera in others)
    return (scene, *(replace(scene, camera=camera) for camera in placed))


def _spheres(scene: SceneDescription, rows: dict[str, int], origin: np.ndarray, dtype: DTypeLike) -> Spheres | None:
    if not scene.spheres:
        return None
    center = np.asarray([s.center for s in scene.spheres], float) - origin
    radius = np.asarray([s.radius for s in scene.spheres], float)
    material = jnp.asarray([rows[s.material] for s in scene.spheres], jnp.int32)
    c, r, lost = (jnp.asarray(x, dtype) for x in (center, radius, lost_digits(center, radius, dtype)))
    tree, outside = sphere_topology(center, radius) or (None, None)
    charted, _ = asks(scene, [s.material for s in scene.spheres])
    return Spheres(c, r, lost, material, tree, outside, charted)


def _triangles(scene: SceneDescription, rows: dict[str, int], origin: np.ndarray, dtype: DTypeLike) -> Triangles | None:
    """Return the meshes' faces, then the single triangles; faces without area are left out."""
    if not scene.meshes and not scene.triangles:
        return None
    singles = np.asarray([t.vertices for t in scene.triangles], float).reshape(-1, 3)
    vertices = [mesh.world for mesh in scene.meshes] + [singles]
    faces = [mesh.faces[mesh.kept] for mesh in scene.meshes] + [np.arange(len(singles)).reshape(-1, 3)]
    # A mesh may bring materials along that no face, or none with an area, is made of
    material = [np.array([rows.get(name, -1) for name in mesh.names])[mesh.rows] for mesh in scene.meshes]
    material.append(np.array([rows[t.material] for t in scene.triangles], int))
    first = np.cumsum([0] + [len(v) for v in vertices])
    corners = np.concatenate(vertices) - origin
    indices = np.concatenate([f + start for f, start in zip(faces, first, strict=False)])
    chart, uv = _charts(scene, indices, dtype)
    return Triangles(
        jnp.asarray(corners, dtype),
        jnp.asarray(indices, jnp.int32),
        jnp.asarray(np.concatenate(material), jnp.int32),
        topology_of(corners, indices),
        mesh_edges(corners.astype(dtype), indices),
        _smooth(scene, corners, indices),
        chart,
        uv,
        _wide(scene),
    )


def _charts(scene: SceneDescription, faces: np.ndarray, dtype: DTypeLike) -> tuple[FaceChart | None, Array | None]:
    """Return where faces (n, 3), those of meshes and then single ones, are on textures, and where by `uv` alone.

    The first is None where no texture asks. The second (n, 3, 2) is None where the first has it, or there is none. On a
    mesh without uv the places are shares of the second and the third corner.
    """
    names = [mesh.names[row] for mesh in scene.meshes for row in np.unique(mesh.rows)]
    asked, vertices = asks(scene, [*names, *(triangle.material for triangle in scene.triangles)])
    own = [m.corners_uv is not None for m in scene.meshes] + [t.uv != SHARES for t in scene.triangles]
    uv = None
    if asked or any(own):
        plain = [np.broadcast_to(SHARES, (len(m.kept), 3, 2)) for m in scene.meshes]
        corners = [p if m.corners_uv is None else m.corners_uv for m, p in zip(scene.meshes, plain, strict=True)]
        singles = np.asarray([triangle.uv for triangle in scene.triangles], float).reshape(-1, 3, 2)
        uv = jnp.asarray(np.concatenate([*corners, singles]), dtype)
    chart = FaceChart(uv if asked else None, jnp.asarray(faces, jnp.int32) if vertices else None)
    return chart if asked or vertices else None, None if asked else uv


def _wide(scene: SceneDescription) -> bool:
    """Return whether a triangle is so wide that float32 errors on it, of 3e-7 of its width, show on something else."""
    singles = [np.asarray(t.vertices, float) for t in scene.triangles]
    corners = [mesh.world[mesh.faces[mesh.kept]] for mesh in scene.meshes] + ([np.stack(singles)] if singles else [])
    sides = [np.linalg.norm(x - np.roll(x, 1, axis=1), axis=-1).max(axis=-1) for x in corners]
    # A mesh is as large as its faces laid side by side: a floor in it does not count, if only it has few faces
    sizes = [np.median(side) * len(side) ** 0.5 for side in sides] + [s.radius for s in scene.spheres]
    return bool(max(side.max() for side in sides) > WIDE * min(sizes))


def _smooth(scene: SceneDescription, vertices: np.ndarray, faces: np.ndarray) -> Array | None:
    """Return for each corner (n, 3) the number of its normal: one for each place of a smooth mesh, one a flat face."""
    if not any(mesh.smooth for mesh in scene.meshes):
        return None
    counts = [len(mesh.kept) for mesh in scene.meshes]
    smooth = np.repeat([mesh.smooth for mesh in scene.meshes] + [False], [*counts, len(faces) - sum(counts)])
    own = np.repeat([*range(len(counts)), -1], [*counts, len(faces) - sum(counts)])
    flat = len(vertices) * (1 + len(counts)) + np.arange(len(faces))
    # Meshes share no normals, even where they touch
    numbers = np.where(smooth[:, None], weld(vertices)[faces] + len(vertices) * own[:, None], flat[:, None])
    return jnp.asarray(np.unique(numbers, return_inverse=True)[1].reshape(-1, 3), jnp.int32)
