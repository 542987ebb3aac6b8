"""The parameters of a scene: what derivatives can be taken of, by dotted name."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, overload

import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.typing import ArrayLike

from jaxrt.description import SceneError
from jaxrt.kernels.native import local
from jaxrt.scene.lights import light_parameters, with_light_parameters
from jaxrt.scene.materials import (
    material_parameters,
    texture_parameters,
    with_material_parameters,
    with_texture_parameters,
)
from jaxrt.scene.measures import measure
from jaxrt.scene.names import Row, rows_called
from jaxrt.scene.poses import POSES, place, pose_parameters, shapes_with, with_pose_parameters
from jaxrt.scene.record import Scene, check_scene, with_poses


def names(scene: Scene) -> dict[str, tuple[str, ...]]:
    """Return what rows of the scene's parameters can be called, by parameter: those that have names, in file order.

    So `materials.albedo` has the names of the materials with an albedo, `meshes.vertices` those of meshes, each for all
    of its vertices. Names are kept beside what is computed: a renamed scene compiles nothing, and inside of a function
    under `jax.jit` that takes a scene as an argument the names are those of the first scene.
    """
    check_scene(scene)
    return {name: called for name in parameters(scene) if (called := tuple(scene.names.of(name)))}


@overload
def parameters(scene: Scene) -> dict[str, Array]:
    """Return all parameters by name."""


@overload
def parameters(scene: Scene, selector: str) -> Array:
    """Return the values that a selector names."""


def parameters(scene: Scene, selector: str | None = None) -> dict[str, Array] | Array:
    """Return the scene's parameters by name, in the user's coordinates and the order of the scene file.

    lights.position (n, 3), lights.intensity (n, 3), lights.radius (n,), materials.albedo (m, 3) of diffuse and mirror
    materials, materials.ior (g,), and so on, one for each field of materials, spheres.center (s, 3), spheres.radius
    (s,), meshes.vertices (v, 3), camera.position (3,), camera.target (3,), camera.fov () in degrees,
    environment.radiance (3,). Only what the scene has is there: no `lights.radius` where every light is a point. Other
    cameras have other fields (docs/cameras.md). There only if the scene file has them, or if a name here or in
    `with_parameters` asks for them, are `camera.roll` and `camera.rotate` (3,), in degrees, and poses: meshes.translate
    (m, 3), meshes.rotate (m, 3) rotation vectors in degrees, meshes.scale (m,), and those of groups.

    selector: return the values that it names instead: `camera.fov`, `lights.position[0]` (3,), or by name (see
    `jaxrt.names`) `materials.albedo[ball]` (3,) and `meshes.vertices[mug]` (v, 3). Raises SceneError for what is not
    there.
    """
    check_scene(scene)
    scene = asked(local(scene), [selector or ""])
    p: dict[str, Array] = {}
    p |= light_parameters(scene)
    p |= material_parameters(scene)
    p |= texture_parameters(scene.materials)
    spheres, triangles = place(scene.poses, scene.spheres, scene.triangles)
    if spheres is not None:
        p |= {"spheres.center": spheres.center, "spheres.radius": spheres.radius}
    if triangles is not None:
        p["meshes.vertices"] = triangles.vertices
    p |= pose_parameters(scene.poses)
    own = {f"camera.{field}": getattr(scene.camera, field) for field in scene.camera.kind.parameters}
    p |= {name: value for name, value in own.items() if value is not None}
    if scene.environment is not None:
        p["environment.radiance"] = scene.environment
    values = {name: value + _shift(scene, name, value) for name, value in p.items()}
    if selector is None:
        return values
    name, row = rows_called(scene.names, selector, values)
    return values[name] if row is None else values[name][row]


def with_parameters(scene: Scene, changes: Mapping[str, ArrayLike]) -> Scene:
    """Return the scene with some parameters changed: pure, and differentiable in the new values.

    changes: by name, or by selector as for `parameters`: `{"materials.albedo[ball]": [0.8, 0.2, 0.2]}`. Values are not
    checked for range: they may be tracers. Raises SceneError for unknown names and rows, wrong shapes, and what is
    changed twice. A pose that is new places what else is new as the old one: vertices are where the old pose has them.
    """
    check_scene(scene)
    scene = asked(local(scene), changes)
    old = parameters(scene)
    new: dict[str, Array] = {}
    seen: dict[str, list[range]] = {}
    for text, value in changes.items():
        name, row = rows_called(scene.names, text, old)
        wanted = old[name] if row is None else old[name][row]
        if np.shape(value) != wanted.shape:
            raise SceneError(f"{text}: shape {np.shape(value)}, want {wanted.shape} as in parameters(scene)")
        rows = _rows(row, old[name])
        if any(max(rows.start, other.start) < min(rows.stop, other.stop) for other in seen.setdefault(name, [])):
            raise SceneError(f"{text}: is changed twice: name each row of {name} once")
        seen[name].append(rows)
        changed = jnp.asarray(value, scene.dtype)
        new[name] = changed if row is None else new.get(name, old[name]).at[row].set(changed)
    return _assign(scene, {name: value - _shift(scene, name, value) for name, value in new.items()})


def _rows(row: Row | None, value: Array) -> range:
    """Return the rows of a parameter's value that are meant; what has no rows counts as one."""
    if isinstance(row, int):
        return range(row, row + 1)
    return range(row.start, row.stop) if row else range(value.shape[0] if value.ndim else 1)


def asked(scene: Scene, texts: Iterable[str]) -> Scene:
    """Return the scene with those parameters that texts name and that are only there if asked for.

    Such are the poses of meshes and groups; and, at 0, `camera.roll`, `camera.rotate`, and a distortion's coefficients.
    """
    named = {text.partition("[")[0].strip() for text in texts if isinstance(text, str)}
    if any(name in POSES for name in named):
        scene = with_poses(scene)
    kind, camera = scene.camera.kind, scene.camera
    fields = {name.removeprefix("camera.") for name in named}
    absent = [field for field in sorted(kind.optional & fields) if getattr(camera, field) is None]
    new = {field: jnp.zeros(kind.measures[field].shape, scene.dtype) for field in absent}
    return replace(scene, camera=replace(camera, **new)) if new else scene


def _shift(scene: Scene, name: str, value: Array) -> Array:
    """Return what each row of a parameter is counted from: the origin for places, mostly."""
    if scene.origin is None:
        return jnp.zeros_like(value)
    if name == "groups.translate":
        assert scene.poses is not None and scene.poses.groups is not None and scene.poses.groups.pivot is not None
        return lax.stop_gradient(jnp.broadcast_to(scene.origin, value.shape) - scene.poses.groups.pivot)
    if measure(name).range != "place":
        return jnp.zeros_like(value)
    return jnp.broadcast_to(lax.stop_gradient(scene.origin), value.shape)


def _fields(new: Mapping[str, Array], owner: str) -> dict[str, Any]:
    """Return what has changed of one owner, by field name."""
    names = [name.split(".") for name in new]
    return {field: new[f"{first}.{field}"] for first, field in names if first == owner}


def _assign(scene: Scene, new: Mapping[str, Array]) -> Scene:
    spheres, triangles = shapes_with(scene.poses, scene.spheres, scene.triangles, new)
    materials, idle = with_material_parameters(scene, _fields(new, "materials"))
    return replace(
        scene,
        camera=replace(scene.camera, **_fields(new, "camera")),
        lights=with_light_parameters(scene, _fields(new, "lights")),
        spheres=spheres,
        triangles=triangles,
        poses=with_pose_parameters(scene.poses, new),
        materials=with_texture_parameters(materials, new),
        idle=idle,
        environment=new.get("environment.radiance", scene.environment),
    )
