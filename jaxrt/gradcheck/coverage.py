"""Which parts of a derivative jaxrt has for a parameter of a scene, and which it lacks."""

from typing import NamedTuple

from jaxrt.scene import Scene

_MOVES_EDGES = ("spheres", "meshes", "camera")


class Coverage(NamedTuple):
    """Parts of a derivative, told in words."""

    edges: bool  # whether visibility edges move with the parameter in a way that jaxrt knows of
    included: tuple[str, ...]
    missing: tuple[str, ...]


def coverage(scene: Scene, name: str, max_depth: int, boundary_samples: int) -> Coverage:
    """Return what derivatives with respect to a parameter contain, and what they do not."""
    light_moves = name in {"lights.position", "lights.radius"}
    shapes_move = name.split(".")[0] in _MOVES_EDGES
    known = _known_edges(scene, light_moves, shapes_move, max_depth)
    missing = _unknown_edges(scene, name, light_moves, shapes_move, max_depth)
    if boundary_samples:
        return Coverage(bool(known), ("interior", *known), tuple(missing))
    return Coverage(False, ("interior",), (*(f"{edge} (boundary_samples is 0)" for edge in known), *missing))


def _known_edges(scene: Scene, light_moves: bool, shapes_move: bool, max_depth: int) -> list[str]:
    outlines = scene.spheres is not None or scene.triangles is not None
    diffuse = scene.materials.diffuse is not None
    sphere_lights = scene.lights is not None and scene.lights.radius is not None
    edges = []
    if (light_moves or shapes_move) and scene.lights is not None and outlines and diffuse:
        edges.append("shadow edges")
    if (shapes_move and (outlines or sphere_lights)) or (light_moves and sphere_lights):
        edges.append("outlines seen by the camera" if shapes_move else "outlines of lights seen by the camera")
    if light_moves and outlines and diffuse and max_depth > 1:
        edges.append("shadow edges in indirect light")
    return edges


def _unknown_edges(scene: Scene, name: str, light_moves: bool, shapes_move: bool, max_depth: int) -> list[str]:
    specular = scene.materials.mirror is not None or scene.materials.glass is not None
    diffuse = scene.materials.diffuse is not None
    sphere_lights = scene.lights is not None and scene.lights.radius is not None
    edges = []
    if specular and (light_moves or shapes_move):
        edges.append("edges seen in mirrors and through glass")
    if name == "materials.ior":
        edges.append("edges seen through glass")
    if shapes_move and diffuse and max_depth > 1:
        edges.append("edges in indirect light of moving shapes or cameras")
    if light_moves and sphere_lights and diffuse and max_depth > 1:
        edges.append("outlines of lights that block bounced light")
    return edges
