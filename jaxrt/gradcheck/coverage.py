"""Which parts of a derivative jaxrt has for a parameter of a scene, and which it lacks."""

from typing import NamedTuple

import numpy as np

from jaxrt.cameras import edges_known
from jaxrt.gradcheck.surfaces import lamps_cross, movers_of, nothing_faces_another, some_cross, surfaces_of
from jaxrt.lights import casters_of
from jaxrt.scene import Scene
from jaxrt.scene.measures import bends_light, measure, moves_lamps, moves_shapes

CROSSING = "curves where surfaces cross, as diffuse surfaces see them"
SUNK = "curves where lights are sunk into surfaces"
SPECULAR = "edges that diffuse surfaces see in mirrors and through glass"
BEHIND = "caustics and indirect shadows seen in mirrors and through glass"
GLOSSY = "outlines that materials of one's own see which tell no numbers"
OWN_TURNS = "how paths move that turn on materials of one's own which tell no numbers"
AFAR = "shadow edges of lights that are at no place"
SCATTERED = "all edges: the camera's rays start at many places"


class Coverage(NamedTuple):
    """Parts of a derivative, told in words."""

    edges: bool  # whether visibility edges move with the parameter in a way that jaxrt knows of
    included: tuple[str, ...]
    missing: tuple[str, ...]


class Motion(NamedTuple):
    """What a parameter's row moves in a scene, and what there is to show it."""

    lamps: bool = False  # lights that have a place move
    balls: bool = False  # some of these have a size
    views: bool = False  # shapes move, the camera, or what bends its rays
    direct: bool = False  # all but the last of these: what the camera sees directly
    far: bool = False  # shadows move of lights that have no place
    crosses: bool = False  # some of what moves cuts through other surfaces
    sunk: bool = False  # lights are among these, or what they are sunk into
    faced: bool = False  # surfaces have others in view
    shows: bool = False  # mirrors or glass show something


def coverage(scene: Scene, name: str, max_depth: int, boundary_samples: int, row: int | None = None) -> Coverage:
    """Return what derivatives with respect to a parameter's row contain, and what not. None: those of any row."""
    motion = _motion(scene, name, row)
    known = _known_edges(scene, motion, max_depth)
    missing = _unknown_edges(scene, motion, max_depth)
    if known and not edges_known(scene.camera):
        known, missing = [], [SCATTERED]
    if boundary_samples:
        return Coverage(bool(known), ("interior", *known), tuple(missing))
    return Coverage(False, ("interior",), (*(f"{edge} (boundary_samples is 0)" for edge in known), *missing))


def _motion(scene: Scene, name: str, row: int | None) -> Motion:
    lamps, direct = moves_lamps(name), moves_shapes(name)
    views = direct or bends_light(scene.materials, name)
    far = _moves_far_shadows(scene, name, views)
    if not (lamps or views or far):
        return Motion()
    surfaces = surfaces_of(scene)
    movers = movers_of(scene, surfaces, name, row)
    faced = scene.eye is None or not nothing_faces_another(surfaces, np.asarray(scene.eye, float))
    # A camera moves neither lights nor what they are sunk into
    own = (lamps or direct) and not name.startswith("camera.")
    return Motion(
        lamps=lamps,
        balls=lamps and bool(np.any(surfaces.radii[movers.balls] > 0)),
        views=views,
        direct=direct,
        far=far,
        crosses=some_cross(surfaces, movers),
        sunk=own and lamps_cross(scene, surfaces, movers),
        faced=faced,
        shows=any(kind.is_delta and (faced or kind.transmits) for kind in scene.materials.kinds),
    )


def _moves_far_shadows(scene: Scene, name: str, views: bool) -> bool:
    """Return whether shadows move in the light of lights that have no place."""
    far = [] if scene.lights is None else [k for k in scene.lights.others if not hasattr(k, "position")]
    owner, field = name.split(".")
    turns = owner == "lights" and not measure(name).tints
    return (views and bool(far)) or (turns and any(k.is_delta and field in k.kind.parameters for k in far))


def _known_edges(scene: Scene, motion: Motion, max_depth: int) -> list[str]:
    if not (motion.lamps or motion.views):
        return []
    outlines = scene.spheres is not None or scene.triangles is not None
    lights, materials = scene.lights, scene.materials
    sizes = lights is not None and lights.have_size
    shadows = _have_places(scene) and outlines and materials.are_lit
    seen = "outlines" if motion.views else "outlines of lights"
    outlined = (motion.views and outlines) or sizes
    bounces = materials.see_outlines and (scene.environment is not None or (lights is not None and max_depth > 1))
    chains = sizes or (max_depth > 1 and (motion.views or shadows)) or (motion.views and _is_bright(scene))
    edges = {
        "shadow edges": shadows and (motion.lamps or motion.direct),
        f"{seen} seen by the camera": outlined and (motion.lamps or motion.direct),
        "curves where surfaces cross, seen by the camera": motion.crosses and (motion.direct or materials.are_delta),
        "edges seen in mirrors and through glass": motion.shows and chains,
        "shadow edges in indirect light": shadows and max_depth > 1,
        # After the last event, a scattered ray sees the sky alone
        f"{seen} seen by scattered rays": outlined and bounces,
        "edges of caustics": motion.shows and materials.are_lit and sizes and max_depth > 1,
    }
    return [edge for edge, there in edges.items() if there]


def _unknown_edges(scene: Scene, motion: Motion, max_depth: int) -> list[str]:
    """Return what derivatives lack with respect to what moves visibility."""
    sky, lit = _is_bright(scene), scene.materials.are_lit
    outlines = motion.views or motion.balls
    # How many events before the last one that shows more than lights and skies
    ahead = max_depth - 1 if sky or scene.lights is not None else 0
    edges = {
        CROSSING: motion.crosses and lit and ahead > 0,
        SUNK: motion.sunk and (lit or (motion.lamps and not motion.shows)),
        SPECULAR: outlines and motion.shows and lit and (ahead > 1 or (sky and ahead > 0)),
        BEHIND: (motion.lamps or motion.views) and motion.shows and lit and _have_places(scene) and ahead > 1,
        GLOSSY: outlines and motion.faced and not scene.materials.tell_numbers and (sky or ahead > 0),
        OWN_TURNS: motion.views and not scene.materials.tell_numbers and _have_places(scene) and ahead > 0,
        AFAR: motion.far and motion.faced and lit,
    }
    return [edge for edge, there in edges.items() if there]


def _have_places(scene: Scene) -> bool:
    """Return whether some lights have a place."""
    return scene.lights is not None and casters_of(scene.lights)[0].shape[0] > 0


def _is_bright(scene: Scene) -> bool:
    """Return whether there is light from afar that rays run into."""
    sky = scene.environment is not None and bool(np.any(np.asarray(scene.environment) > 0))
    return sky or (scene.lights is not None and any(scene.lights.skies()))
