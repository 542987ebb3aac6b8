"""What is legal in a scene, but hardly meant; and what does not fit into memory. NumPy, on the host."""

from jaxrt.description import SceneDescription
from jaxrt.scene.checks.common import bodies_of
from jaxrt.scene.checks.coplanar import coincident_faces
from jaxrt.scene.checks.glass import crossing_glass, point_light_and_glass, unsound_glass
from jaxrt.scene.checks.lights import dark, near_point_lights, walled_in, walled_in_meshes
from jaxrt.scene.checks.view import (
    dropped_faces,
    left_out,
    narrow_view,
    unused_groups,
    unused_materials,
    unused_textures,
)
from jaxrt.scene.memory import check_memory

__all__ = ["check_memory", "warnings_of"]


def warnings_of(description: SceneDescription) -> list[str]:
    """Return one line for each thing in the scene that is legal but hardly meant."""
    groups, description = unused_groups(description), description.flat
    bodies = bodies_of(description)
    return [
        *groups,
        *dark(description),
        *narrow_view(description, bodies),
        *unused_materials(description),
        *unused_textures(description),
        *walled_in(description),
        *walled_in_meshes(description, bodies),
        *left_out(description),
        *dropped_faces(bodies),
        *unsound_glass(bodies),
        *point_light_and_glass(description, bodies),
        *crossing_glass(description, bodies),
        *coincident_faces(description, bodies),
        *near_point_lights(description, bodies),
    ]
