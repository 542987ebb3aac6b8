"""The parameters of a scene: what derivatives can be taken of, by dotted name."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.typing import ArrayLike

from jaxrt.description import SceneError, nearest
from jaxrt.kernels.native import local
from jaxrt.scene.materials import material_parameters, with_material_parameters
from jaxrt.scene.measures import measure
from jaxrt.scene.record import Scene, check_scene
from jaxrt.shapes.sphere import exact_power


def parameters(scene: Scene) -> dict[str, Array]:
    """Return the scene's parameters by name, in the user's coordinates and the order of the scene file.

    lights.position (n, 3), lights.intensity (n, 3), lights.radius (n,), materials.albedo (m, 3) of diffuse and mirror
    materials, materials.ior (g,), and so on, one for each field of materials, spheres.center (s, 3), spheres.radius
    (s,), meshes.vertices (v, 3), camera.position (3,), camera.target (3,), camera.fov () in degrees,
    environment.radiance (3,). Only what the scene has is there: no `lights.radius` where every light is a point.
    """
    check_scene(scene)
    scene = local(scene)
    p: dict[str, Array] = {}
    if scene.lights is not None:
        p |= {"lights.position": scene.lights.position, "lights.intensity": scene.lights.intensity}
        if scene.lights.radius is not None:
            p["lights.radius"] = scene.lights.radius
    p |= material_parameters(scene)
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
    check_scene(scene)
    scene = local(scene)
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
    if scene.origin is None or measure(name).range != "place":
        return jnp.zeros_like(value)
    return jnp.broadcast_to(lax.stop_gradient(scene.origin), value.shape)


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
    materials, idle = with_material_parameters(scene, _fields(new, "materials"))
    return replace(
        scene,
        camera=replace(scene.camera, **_fields(new, "camera")),
        lights=lights,
        spheres=spheres,
        triangles=triangles,
        materials=materials,
        idle=idle,
        environment=new.get("environment.radiance", scene.environment),
    )
