"""The step of finite differences: small against what curves, large against rounding and pixels."""

from collections.abc import Iterator

import jax.numpy as jnp
import numpy as np

from jaxrt.description import SceneError
from jaxrt.description.box_tree import Floats
from jaxrt.gradcheck.surfaces import Surfaces, gaps, surfaces_of
from jaxrt.scene import Scene
from jaxrt.scene.measures import measure
from jaxrt.scene.parameters import parameters
from jaxrt.scene.selectors import Selector

SHARE = 0.01  # step of places, as a share of the distance that the camera looks over
OF_RADIUS = 0.02  # step of a radius, as a share of it
OF_LENGTH = 0.05  # step of places, as a share of what moves, and of the way to where it touches something
LEAST = 2e-5  # step, as a share of what the camera looks over: rounding is then below 1 %
TOUCHES = 1e-3  # of the same: what is nearer touches, and no step is small enough
OF_FRACTION = 0.02  # step of what is between 0 and 1
OF_VALUE = {"positive": 0.02, "free": 0.02, "angle": 0.01}  # step of others, as a share of the row's largest number


def default_step(scene: Scene, selector: Selector, value: float) -> float:
    """Return a step for central differences of a number of that value. Raises SceneError for a radius of 0."""
    name = selector.name
    known = measure(name)
    if known.step is not None or known.range == "fraction":
        return known.step or OF_FRACTION
    if known.range != "place" and not name.endswith(".radius"):
        largest = float(jnp.max(jnp.abs(selector.pick(parameters(scene)[name]))))
        return OF_VALUE[known.range] * (largest or 1.0)
    reach = _reach(scene)
    steps = [SHARE * reach, *(OF_LENGTH * length for length in _lengths(scene, selector, reach))]
    if name.endswith(".radius"):
        if value <= 0:
            raise SceneError(f"{selector}: a radius of 0 has no central difference: check a light that has a radius")
        steps.append(OF_RADIUS * value)
    return max(min(steps), LEAST * reach)


def _lengths(scene: Scene, selector: Selector, reach: float) -> Iterator[float]:
    """Yield the lengths over which a picture changes its ways as the row of a place or radius moves."""
    surfaces, (owner, _) = surfaces_of(scene), selector.name.split(".")
    if owner == "meshes":
        yield _shortest_side(surfaces, selector.row)
        return
    eye = np.asarray(scene.camera.position, float)
    if selector.name == "camera.target":
        yield float(np.linalg.norm(np.asarray(scene.camera.target, float) - eye))
        return
    center, radius, own = eye, 0.0, None
    if owner != "camera":
        assert selector.row is not None
        own = selector.row + (0 if owner == "spheres" or scene.spheres is None else len(scene.spheres.radius))
        center, radius = surfaces.centers[own], float(surfaces.radii[own])
    if radius > 0:
        yield radius
    yield from (gap for gap in gaps(surfaces, center, radius, own) if gap > TOUCHES * reach)


def _shortest_side(surfaces: Surfaces, vertex: int | None) -> float:
    """Return the shortest side at a vertex."""
    corners = surfaces.corners[np.any(surfaces.faces == vertex, axis=1)]
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).min(initial=np.inf))


def _reach(scene: Scene) -> float:
    """Return a typical distance from the camera to what the scene is made of, huge spheres left out."""
    eye = np.asarray(scene.camera.position, float)
    places: list[Floats] = []
    if scene.lights is not None:
        places.append(np.asarray(scene.lights.position, float))
    if scene.spheres is not None:
        center, radius = np.asarray(scene.spheres.center, float), np.asarray(scene.spheres.radius, float)
        places.append(center[2 * radius < np.linalg.norm(center - eye, axis=-1)])
    if scene.triangles is not None:
        places.append(np.asarray(scene.triangles.vertices, float))
    distances = np.linalg.norm(np.concatenate([*places, np.zeros((0, 3))]) - eye, axis=-1)
    # The lower quartile: a floor may reach far
    return float(np.percentile(distances[distances > 0], 25)) if np.any(distances > 0) else 1.0
