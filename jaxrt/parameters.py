"""The parameters of a scene: what derivatives can be taken of, by dotted name."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxrt.description import SceneError, nearest
from jaxrt.materials import Materials
from jaxrt.scene import Scene, check_scene
from jaxrt.shapes.sphere import exact_power

_PLACES = {"lights.position", "spheres.center", "meshes.vertices", "camera.position", "camera.target"}


def parameters(scene: Scene) -> dict[str, Array]:
    """Return the scene's parameters by name, in the user's coordinates and the order of the scene file.

    lights.position (n, 3), lights.intensity (n, 3), lights.radius (n,), materials.albedo (m, 3) of diffuse and mirror
    materials, materials.ior (g,), spheres.center (s, 3), spheres.radius (s,), meshes.vertices (v, 3), camera.position
    (3,), camera.target (3,), camera.fov () in degrees, environment.radiance (3,). Only what the scene has is there:
    no `lights.radius` where every light is a point.
    """
    check_scene(scene)
    p: dict[str, Array] = {}
    if scene.lights is not None:
        p |= {"lights.position": scene.lights.position, "lights.intensity": scene.lights.intensity}
        if scene.lights.radius is not None:
            p["lights.radius"] = scene.lights.radius
    if scene.albedo_order.size:
        kinds = (scene.materials.diffuse, scene.materials.mirror)
        albedo = jnp.concatenate([kind.albedo for kind in kinds if kind is not None])
        p["materials.albedo"] = albedo[scene.albedo_order]
    if scene.materials.glass is not None:
        p["materials.ior"] = scene.materials.glass.ior
    if scene.spheres is not None:
        p |= {"spheres.center": scene.spheres.center, "spheres.radius": scene.spheres.radius}
    if scene.triangles is not None:
        p["meshes.vertices"] = scene.triangles.vertices
    p |= {"camera.position": scene.camera.position, "camera.target": scene.camera.target}
    p["camera.fov"] = scene.camera.fov
    if scene.environment is not None:
        p["environment.radiance"] = scene.environment
    return {name: value + _shift(scene, name, value) for name, value in p.items()}


def with_parameters(scene: Scene, changes: Mapping[str, ArrayLike]) -> Scene:
    """Return the scene with some parameters changed: pure, and differentiable in the new values.

    Values are not checked for range: they may be tracers. Raises SceneError for unknown names and wrong shapes.
    """
    old = parameters(scene)
    for name, value in changes.items():
        if name not in old:
            raise SceneError(f"{name}: the scene has no such parameter{nearest(name, old)}")
        if np.shape(value) != old[name].shape:
            raise SceneError(f"{name}: shape {np.shape(value)}, want {old[name].shape} as in parameters(scene)")
    dtype = scene.camera.position.dtype
    new = {name: jnp.asarray(value, dtype) for name, value in changes.items()}
    return _assign(scene, {name: value - _shift(scene, name, value) for name, value in new.items()})


def _shift(scene: Scene, name: str, value: Array) -> Array:
    """Return the origin for each row of a parameter that is a place, else 0."""
    origin = jnp.asarray(scene.origin, value.dtype)
    return jnp.broadcast_to(origin, value.shape) if name in _PLACES else jnp.zeros_like(value)


def _fields(new: Mapping[str, Array], owner: str) -> dict[str, Any]:
    """Return what has changed of one owner, by field name."""
    names = [name.split(".") for name in new]
    return {field: new[f"{first}.{field}"] for first, field in names if first == owner}


def _assign(scene: Scene, new: Mapping[str, Array]) -> Scene:
    lights, spheres, triangles = scene.lights, scene.spheres, scene.triangles
    if lights is not None:
        lights = replace(lights, **_fields(new, "lights"))
    if spheres is not None and (changed := _fields(new, "spheres")):
        # What the rounding of centre and radius lost stays in the power
        lost = spheres.power - exact_power(spheres.center, spheres.radius)
        spheres = replace(spheres, **changed)
        spheres = replace(spheres, power=exact_power(spheres.center, spheres.radius) + lost)
    if triangles is not None:
        triangles = replace(triangles, **_fields(new, "meshes"))
    return replace(
        scene,
        camera=replace(scene.camera, **_fields(new, "camera")),
        lights=lights,
        spheres=spheres,
        triangles=triangles,
        materials=_with_materials(scene, new),
        environment=new.get("environment.radiance", scene.environment),
    )


def _with_materials(scene: Scene, new: Mapping[str, Array]) -> Materials:
    materials = scene.materials
    if "materials.albedo" in new:
        albedo = new["materials.albedo"][jnp.argsort(scene.albedo_order)]
        a = materials.counts[0]
        if materials.diffuse is not None:
            materials = replace(materials, diffuse=replace(materials.diffuse, albedo=albedo[:a]))
        if materials.mirror is not None:
            materials = replace(materials, mirror=replace(materials.mirror, albedo=albedo[a:]))
    if "materials.ior" in new and materials.glass is not None:
        materials = replace(materials, glass=replace(materials.glass, ior=new["materials.ior"]))
    return materials
