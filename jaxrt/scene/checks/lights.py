"""Lights that are not there, that cannot be seen, or that make noise."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jaxrt.description import SceneDescription
from jaxrt.description.box_tree import Floats, box_distances
from jaxrt.description.kinds import LIGHTS
from jaxrt.description.mesh_facts import nearest_distances, triangle_distances, winding_numbers
from jaxrt.scene.checks.common import Body, centers_and_radii, inside, is_lit, more, spheres_of, transmits

TOO_NEAR = 1e-2  # of the distances around a point light: indirect light then has a relative error of dozens
SUNK = 100  # a ball of fewer radii of the lamp in it is no wall that the lamp is let into


def dark(scene: SceneDescription) -> Iterator[str]:
    """Find a scene without light."""
    sky = scene.environment
    if not scene.lights and sky is None:
        yield "no light and no environment: the picture is black, add [[lights]] or [environment]"
    elif not any(map(_has_power, scene.lights)) and not (sky and any(sky.radiance)):
        yield "no light or environment has any power: the picture is black, raise an intensity or radiance"


def _has_power(light: Any) -> bool:
    """Return whether a light shines: one that is tinted, unless all of its tints are black."""
    tints = [getattr(light, field) for field, measure in LIGHTS.kind_of(light).measures.items() if measure.tints]
    return not tints or bool(np.any(tints))


def walled_in(scene: SceneDescription) -> Iterator[str]:
    """Find lights that closed opaque spheres or other lights part from the camera, as a whole or for the most part."""
    opaque = spheres_of(scene, opaque=True)
    walls = [scene.spheres[i] for i in opaque]
    centers, radii = centers_and_radii(walls)
    if (eye := scene.eye) is None:
        return
    camera_inside = inside(eye, centers, radii)
    for i, position, radius in scene.lamps:
        distances = np.linalg.norm(centers - position, axis=-1)
        parted = np.where(camera_inside, distances >= radii + radius, distances + radius <= radii)
        swallowed = ~camera_inside & ~parted & (distances < radii) & (radii < SUNK * radius)
        if radius:
            swallowed &= distances + radii > radius
        if parted.any():
            wall = int(np.argmax(parted))
            light_is, camera_is = ("outside", "inside") if camera_inside[wall] else ("inside", "outside")
            yield (
                f"lights[{i}] is {light_is} of spheres[{opaque[wall]}] ({walls[wall].material}) and the "
                f"camera {camera_is}: its light cannot be seen, move one of them"
            )
        elif swallowed.any():
            wall = int(np.argmax(swallowed))
            yield (
                f"lights[{i}] has its centre inside of spheres[{opaque[wall]}] ({walls[wall].material}): only what "
                "sticks out shines, move one of them"
            )
        buried = distances + radii <= radius
        if buried.any():
            ball = int(np.argmax(buried))
            yield f"spheres[{opaque[ball]}] is inside of lights[{i}]: it cannot be seen, move one of them"
        if radius and np.linalg.norm(eye - position) < radius:
            yield f"the camera is inside of lights[{i}]: the picture is black, move one of them"
    if not scene.lights and scene.environment and camera_inside.any():
        wall = opaque[int(np.argmax(camera_inside))]
        yield f"the camera is inside of spheres[{wall}] without lights: the picture is black, move it"


def walled_in_meshes(scene: SceneDescription, bodies: Sequence[Body]) -> Iterator[str]:
    """Find lights that closed opaque meshes part from the camera."""
    if (eye := scene.eye) is None:
        return
    lamps = scene.lamps
    places = np.array([eye, *(lamp.position for lamp in lamps)])
    for body in bodies:
        if body.has(transmits):
            continue
        camera_inside, *lights_inside = _inside_body(places, body)
        parted = [lamp.number for lamp, within in zip(lamps, lights_inside, strict=True) if within != camera_inside]
        if parted:
            light_is, camera_is = ("outside", "inside") if camera_inside else ("inside", "outside")
            yield (
                f"lights[{parted[0]}] is {light_is} of {body.name} ({body.mesh.names[0]}) and the camera {camera_is}: "
                f"its light cannot be seen, move one of them{more(len(parted), 'lights')}"
            )
        if not scene.lights and scene.environment and camera_inside:
            yield f"the camera is inside of {body.name} without lights: the picture is black, move it"


def _inside_body(places: Floats, body: Body) -> NDArray[np.bool_]:
    """Return whether a mesh that is closed holds each place (p, 3); its box answers first, since it costs least."""
    low, high = body.box
    held = np.all((low < places) & (places < high), axis=-1)
    if held.any():
        held[held] = winding_numbers(places[held], body.vertices, body.faces) != 0
    return held & (body.closed if held.any() else False)


def near_point_lights(scene: SceneDescription, bodies: Sequence[Body]) -> Iterator[str]:
    """Find point lights so near to a surface that they light that indirect light from there is mostly noise.

    Near is meant for what is around: the camera, and the nearest places of most other things. How far a floor reaches
    does not matter.
    """
    numbers = [lamp.number for lamp in scene.lamps if not lamp.radius]
    if not numbers or scene.eye is None:
        return
    points = np.array([lamp.position for lamp in scene.lamps if not lamp.radius])
    spheres = [s for s in scene.spheres if is_lit(scene.materials[s.material])]
    corners = [t.vertices for t in scene.triangles if is_lit(scene.materials[t.material])]
    singles = np.array(corners, float).reshape(-1, 3, 3)
    meshes = [body for body in bodies if body.has(is_lit)]
    around = _around(points, *centers_and_radii(spheres), singles)
    boxes = np.array([box_distances(points, *body.box) for body in meshes]).reshape(len(meshes), len(points)).T
    others = np.sort(np.concatenate([around, boxes], axis=1), axis=1)
    if not others.shape[1]:
        return
    usual = np.maximum(np.linalg.norm(points - scene.eye, axis=-1), others[:, (others.shape[1] - 1) // 2])
    limits = TOO_NEAR * usual
    nearest = [nearest_distances(points, body.corners, limits) for body in meshes]
    distances = np.concatenate([around, np.array(nearest).reshape(len(meshes), len(points)).T], axis=1).min(axis=1)
    near = np.flatnonzero(distances < limits)
    if len(near):
        yield (
            f"lights[{numbers[near[0]]}] is a point light at {distances[near[0]]:.2g} from a surface: indirect light "
            f"from there is very noisy; move it away or use a radius > 0{more(len(near), 'lights')}"
        )


def _around(points: Floats, centers: Floats, radii: Floats, singles: Floats) -> Floats:
    """Return the distances (p, n) from points to spheres and single triangles."""
    to_spheres = [np.abs(np.linalg.norm(centers - point, axis=-1) - radii) for point in points]
    to_triangles = [triangle_distances(point, singles) for point in points]
    return np.concatenate([np.array(to_spheres), np.array(to_triangles)], axis=1)
