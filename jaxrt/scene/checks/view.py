"""A camera that hardly shows what it should, and parts of the scene that no ray meets."""

from collections.abc import Iterator, Sequence

import numpy as np

from jaxrt.description import SceneDescription, show
from jaxrt.description.textures import painted_fields
from jaxrt.scene.checks.common import Body
from jaxrt.textures.stack import asks


def narrow_view(scene: SceneDescription, bodies: Sequence[Body]) -> Iterator[str]:
    """Ask the camera whether it hardly shows what it should."""
    if hasattr(scene.camera, "doubts"):
        yield from scene.camera.doubts(list(_angular_sizes(scene, bodies)))


def _angular_sizes(scene: SceneDescription, bodies: Sequence[Body]) -> Iterator[float]:
    """Yield the angle under which the camera sees each sphere and mesh that it is outside of."""
    eye = scene.eye
    if eye is None:
        return
    for sphere in scene.spheres:
        distance = np.linalg.norm(eye - sphere.center)
        if distance > sphere.radius:
            yield float(2 * np.arcsin(sphere.radius / distance))
    boxes = [body.box for body in bodies] + [(np.min(t.vertices, 0), np.max(t.vertices, 0)) for t in scene.triangles]
    for low, high in boxes:
        if not ((low < eye) & (eye < high)).all():
            yield float(2 * np.arctan2(np.linalg.norm(high - low) / 2, np.linalg.norm((low + high) / 2 - eye)))


def unused_materials(scene: SceneDescription) -> Iterator[str]:
    """Find materials that nothing is made of."""
    used = {sphere.material for sphere in scene.spheres} | {triangle.material for triangle in scene.triangles}
    used.update(name for mesh in scene.meshes for name in mesh.names)
    for name in scene.materials:
        if name not in used:
            yield f"materials: {show(name)} is used by nothing: name it in a sphere, triangle or mesh, or remove it"


def unused_groups(scene: SceneDescription) -> Iterator[str]:
    """Find groups that nothing is in."""
    named = {sphere.group for sphere in scene.spheres} | {mesh.group for mesh in scene.meshes}
    for name in (name for name in scene.groups if name not in named):
        yield f"groups: {show(name)} has no members: name it as the group of a sphere or mesh, or remove it"


def dropped_faces(bodies: Sequence[Body]) -> Iterator[str]:
    """Find faces that no ray can hit."""
    for body in bodies:
        count = len(body.mesh.faces)
        dropped = np.setdiff1d(np.arange(count), body.mesh.kept, assume_unique=True)
        if len(dropped):
            yield f"{body.title}: {len(dropped)} of {count} faces have no area and are dropped, first {dropped[0]}"


def left_out(scene: SceneDescription) -> Iterator[str]:
    """Tell what mesh files and pictures hold that is not used, and what was mended."""
    for i, mesh in enumerate(scene.meshes):
        if mesh.notes:
            yield f"meshes[{i}] ({mesh.file}): {mesh.notes}"
        if mesh.colors is not None and mesh.file is not None and not asks(scene, mesh.names)[1]:
            text = 'vertex colours are not used: paint its material with a texture of type = "vertex_colors"'
            yield f"meshes[{i}] ({mesh.file}): {text}"
    for name, texture in scene.textures.items():
        if getattr(texture, "notes", None):
            yield f"textures.{name} ({texture.file}): {texture.notes}"


def unused_textures(scene: SceneDescription) -> Iterator[str]:
    """Find textures that no material is painted with."""
    used = {texture for material in scene.materials.values() for _, texture in painted_fields(material)}
    for name in scene.textures:
        if name not in used:
            yield f"textures: {show(name)} is used by nothing: write albedo = {show(name)} in a material, or remove it"
