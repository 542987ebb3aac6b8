"""Which parts of a derivative jaxrt has for a parameter of a scene, and which it lacks."""

from typing import NamedTuple

import numpy as np

from jaxrt.gradcheck.surfaces import movers_of, nothing_faces_another, some_cross, surfaces_of
from jaxrt.scene import Scene

_MOVES_EDGES = ("spheres", "meshes", "camera")

CROSSING = "curves where surfaces cross"
SKY = "outlines before the sky as diffuse surfaces see them"
INDIRECT = "edges in indirect light of moving shapes or cameras"
SPECULAR = "edges seen in mirrors and through glass"
REFRACTED = "edges seen through glass"


class Coverage(NamedTuple):
    """Parts of a derivative, told in words."""

    edges: bool  # whether visibility edges move with the parameter in a way that jaxrt knows of
    included: tuple[str, ...]
    missing: tuple[str, ...]


def coverage(scene: Scene, name: str, max_depth: int, boundary_samples: int, row: int | None = None) -> Coverage:
    """Return what derivatives with respect to a parameter's row contain, and what not. None: those of any row."""
    light_moves = name in {"lights.position", "lights.radius"}
    shapes_move = name.split(".")[0] in _MOVES_EDGES
    known = _known_edges(scene, light_moves, shapes_move, max_depth)
    missing = _unknown_edges(scene, name, row, max_depth) if light_moves or shapes_move else []
    if name == "materials.ior" and scene.materials.glass is not None:
        missing.append(REFRACTED)
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
    if (light_moves or shapes_move) and scene.lights is not None and outlines and diffuse and max_depth > 1:
        edges.append("shadow edges in indirect light")
    # After the last event, a diffuse surface sees the sky alone
    bounces = diffuse and (scene.environment is not None or (scene.lights is not None and max_depth > 1))
    if bounces and ((shapes_move and (outlines or sphere_lights)) or (light_moves and sphere_lights)):
        edges.append(
            "outlines seen by diffuse surfaces" if shapes_move else "outlines of lights seen by diffuse surfaces"
        )
    return edges


def _unknown_edges(scene: Scene, name: str, row: int | None, max_depth: int) -> list[str]:
    """Return what derivatives lack with respect to a place or size of shapes, lights or camera."""
    surfaces = surfaces_of(scene)
    movers = movers_of(scene, surfaces, name, row)
    light_moves = name.startswith("lights.")
    sphere_lights = scene.lights is not None and scene.lights.radius is not None
    sky = scene.environment is not None and bool(np.any(np.asarray(scene.environment) > 0))
    faced = not nothing_faces_another(surfaces, np.asarray(scene.camera.position, float))
    edges = []
    if some_cross(surfaces, movers):
        edges.append(CROSSING)
    specular = scene.materials.glass is not None or (faced and scene.materials.mirror is not None)
    # What follows the last event shows lights and the sky alone
    if specular and (max_depth > 1 or sphere_lights or (sky and not light_moves)):
        edges.append(SPECULAR)
    # Of spheres alone these are right; where meshes see or are seen they are added, but not shown to be right yet
    meshes = scene.triangles is not None and faced and scene.materials.diffuse is not None and not light_moves
    if meshes and sky:
        edges.append(SKY)
    if meshes and max_depth > 1:
        edges.append(INDIRECT)
    return edges
