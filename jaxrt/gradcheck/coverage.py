"""Which parts of a derivative jaxrt has for a parameter of a scene, and which it lacks."""

from typing import NamedTuple

import numpy as np

from jaxrt.gradcheck.surfaces import movers_of, nothing_faces_another, some_cross, surfaces_of
from jaxrt.lights import casters_of
from jaxrt.scene import Scene
from jaxrt.scene.measures import measure, moves_lamps, moves_shapes

CROSSING = "curves where surfaces cross"
SKY = "outlines before the sky as diffuse surfaces see them"
INDIRECT = "edges in indirect light of moving shapes or cameras"
AFAR = "shadow edges of lights that are at no place"
SCATTERED = "all edges: the camera's rays start at many places"
LIGHTS = "outlines of lights that block bounced light"
SPECULAR = "edges seen in mirrors and through glass"
REFRACTED = "edges seen through glass"


class Coverage(NamedTuple):
    """Parts of a derivative, told in words."""

    edges: bool  # whether visibility edges move with the parameter in a way that jaxrt knows of
    included: tuple[str, ...]
    missing: tuple[str, ...]


def coverage(scene: Scene, name: str, max_depth: int, boundary_samples: int, row: int | None = None) -> Coverage:
    """Return what derivatives with respect to a parameter's row contain, and what not. None: those of any row."""
    light_moves, shapes_move = moves_lamps(name), moves_shapes(name)
    known = _known_edges(scene, light_moves, shapes_move, max_depth)
    missing = _unknown_edges(scene, name, row, max_depth) if light_moves or shapes_move else []
    missing += [*_bent_edges(scene, name), *_far_edges(scene, name, shapes_move)]
    if known and not scene.camera.is_central:
        known, missing = [], [SCATTERED]
    if boundary_samples:
        return Coverage(bool(known), ("interior", *known), tuple(missing))
    return Coverage(False, ("interior",), (*(f"{edge} (boundary_samples is 0)" for edge in known), *missing))


def _bent_edges(scene: Scene, name: str) -> list[str]:
    """Return what derivatives lack with respect to what turns light that goes on in single directions."""
    owner, field = name.split(".")
    if owner != "materials" or measure(name).tints:
        return []
    bending = [kind for kind in scene.materials.kinds if kind.is_delta and field in kind.kind.parameters]
    return list(dict.fromkeys(REFRACTED if kind.transmits else SPECULAR for kind in bending))


def _far_edges(scene: Scene, name: str, shapes_move: bool) -> list[str]:
    """Return what derivatives lack where shadows move in the light of lights that have no place."""
    owner, field = name.split(".")
    far = [] if scene.lights is None else [k for k in scene.lights.others if k.is_delta and not hasattr(k, "position")]
    turned = owner == "lights" and not measure(name).tints and any(field in kind.kind.parameters for kind in far)
    shadows = scene.materials.are_lit and (scene.spheres is not None or scene.triangles is not None)
    return [AFAR] if shadows and (turned or (far and shapes_move)) else []


def _known_edges(scene: Scene, light_moves: bool, shapes_move: bool, max_depth: int) -> list[str]:
    outlines = scene.spheres is not None or scene.triangles is not None
    diffuse = scene.materials.are_lit
    sphere_lights = scene.lights is not None and scene.lights.have_size
    edges = []
    lamps = scene.lights is not None and casters_of(scene.lights)[0].shape[0] > 0
    if (light_moves or shapes_move) and lamps and outlines and diffuse:
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
    sphere_lights = scene.lights is not None and scene.lights.have_size
    sky = scene.environment is not None and bool(np.any(np.asarray(scene.environment) > 0))
    sky = sky or (scene.lights is not None and any(scene.lights.skies()))
    faced = scene.eye is None or not nothing_faces_another(surfaces, np.asarray(scene.eye, float))
    edges = []
    if some_cross(surfaces, movers):
        edges.append(CROSSING)
    specular = any(kind.is_delta and (faced or kind.transmits) for kind in scene.materials.kinds)
    # What follows the last event shows lights and the sky alone
    if specular and (max_depth > 1 or sphere_lights or (sky and not light_moves)):
        edges.append(SPECULAR)
    # Of spheres alone these are right; where meshes see or are seen they are added, but not shown to be right yet
    meshes = scene.triangles is not None and faced and scene.materials.are_lit and not light_moves
    if meshes and sky:
        edges.append(SKY)
    if meshes and max_depth > 1:
        edges.append(INDIRECT)
    return edges
