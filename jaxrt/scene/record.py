"""What a scene is, once it is built: arrays and topology, the input of all that computes."""

from dataclasses import replace
from os import PathLike
from typing import Any

from jax import Array

from jaxrt.core.pytree import dtype_of, pytree, static
from jaxrt.description import RenderDefaults, SceneError, show
from jaxrt.lights import Lights
from jaxrt.materials import Materials
from jaxrt.scene.names import Names
from jaxrt.scene.poses import Poses, asking, place
from jaxrt.shapes import Spheres, Triangles


@pytree
class Scene:
    """What is there: a pytree of float arrays and integer topology. Kinds of things that are absent are None."""

    camera: Any  # one of a kind of camera, without rows
    spheres: Spheres | None
    triangles: Triangles | None
    materials: Materials
    lights: Lights | None
    environment: Array | None  # (3,) radiance W·sr⁻¹·m⁻² from every direction
    idle: dict[str, Array] | None  # (k, …) by field: parameters of materials that nothing is made of, of no effect
    order: dict[str, Array] | None  # (m,) int32: row among (materials, idle), or lights, of each in the file's order
    origin: Array | None  # (3,) user's coordinates of this scene's origin; None: the same
    poses: Poses | None  # of meshes and groups, which they place where they were asked for
    defaults: RenderDefaults = static()  # what `render` uses for spp and max_depth when not told
    names: Names = static(default=Names())  # of rows; equal to any other

    @property
    def eye(self) -> Array | None:
        """Where the camera is, (3,); None where it has no place."""
        place = self.camera.kind.anchor
        return None if place is None else getattr(self.camera, place)

    @property
    def dtype(self) -> Any:
        """The dtype of all its numbers."""
        return dtype_of(self)


class NoSceneError(SceneError, TypeError):
    """Something else than a scene stands where one is wanted."""


def check_scene(scene: object) -> None:
    """Raise NoSceneError for anything but a scene."""
    if not isinstance(scene, Scene):
        remedy = "jaxrt.load_scene(path)" if isinstance(scene, str | PathLike) else "what jaxrt.build returns"
        raise NoSceneError(f"scene: {show(scene)} is no Scene: pass {remedy}")


def placed(scene: Scene) -> Scene:
    """Return the scene with its shapes where their poses place them, whether these are parameters or not."""
    spheres, triangles = place(scene.poses, scene.spheres, scene.triangles)
    return replace(scene, spheres=spheres, triangles=triangles, poses=None)


def with_poses(scene: Scene) -> Scene:
    """Return the scene with the poses of meshes and groups among its parameters: the same picture, to rounding."""
    poses, (spheres, triangles) = asking(scene.poses, scene.spheres, scene.triangles)
    return replace(scene, spheres=spheres, triangles=triangles, poses=poses)


def drawn(scene: Scene) -> Scene:
    """Return what a picture depends on: scenes that differ in the rest share a program."""
    materials = scene.materials
    if materials.textures is not None:
        materials = replace(materials, textures=replace(materials.textures, names=()))
    return replace(
        placed(scene), materials=materials, idle=None, order=None, origin=None, defaults=RenderDefaults(), names=Names()
    )
