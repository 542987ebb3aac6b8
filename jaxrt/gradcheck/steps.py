"""The step of finite differences: small against what curves, large against rounding and pixels."""

from collections.abc import Iterator

import jax.numpy as jnp
import numpy as np

from jaxrt.description import SceneError
from jaxrt.description.box_tree import Floats
from jaxrt.gradcheck.surfaces import Surfaces, gaps, movers_of, surfaces_of
from jaxrt.lights import casters_of
from jaxrt.scene import Scene, placed
from jaxrt.scene.lights import light_numbers
from jaxrt.scene.measures import measure, moves_lamps
from jaxrt.scene.parameters import parameters
from jaxrt.scene.poses import POSES, pivot_of
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
    if name in POSES:
        return _pose_step(scene, selector, value)
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


def _pose_step(scene: Scene, selector: Selector, value: float) -> float:
    """Return the step of a number of a pose, by which what it moves goes as far as a place does in its step."""
    surfaces, reach, name = surfaces_of(scene), _reach(scene), selector.name
    movers = movers_of(scene, surfaces, name, selector.row)
    centers, radii = surfaces.centers[movers.balls], surfaces.radii[movers.balls, None]
    points = np.concatenate([centers - radii, centers + radii, surfaces.corners[movers.faces].reshape(-1, 3)])
    if not len(points):
        return 1.0  # of no effect
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    step = max(min(SHARE * reach, OF_LENGTH * size), LEAST * reach)
    if name.endswith(".translate"):
        return step
    arm = float(np.linalg.norm(points - pivot_of(scene.poses, name, selector.row), axis=-1).max())
    return float(np.degrees(step / arm)) if name.endswith(".rotate") else value * step / arm


def _lengths(scene: Scene, selector: Selector, reach: float) -> Iterator[float]:
    """Yield the lengths over which a picture changes its ways as the row of a place or radius moves."""
    surfaces, (owner, field) = surfaces_of(scene), selector.name.split(".")
    if owner == "meshes":
        yield _shortest_side(surfaces, selector.row)
        return
    center, radius, own = _eye(scene), 0.0, None
    if owner == "camera" and field != scene.camera.kind.anchor:
        # What it looks at, as seen from where it is
        yield float(np.linalg.norm(np.asarray(getattr(scene.camera, field), float) - center))
        return
    if owner != "camera":
        assert selector.row is not None
        own = selector.row
        if owner == "lights":
            if not moves_lamps(selector.name):
                return
            own = light_numbers(scene, selector.name)[own] + (0 if scene.spheres is None else len(scene.spheres.radius))
        center, radius = surfaces.centers[own], float(surfaces.radii[own])
    if radius > 0:
        yield radius
    yield from (gap for gap in gaps(surfaces, center, radius, own) if gap > TOUCHES * reach)


def _shortest_side(surfaces: Surfaces, vertex: int | None) -> float:
    """Return the shortest side at a vertex."""
    corners = surfaces.corners[np.any(surfaces.faces == vertex, axis=1)]
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).min(initial=np.inf))


def _eye(scene: Scene) -> Floats:
    """Return where the camera is (3,), or the origin."""
    return np.zeros(3) if scene.eye is None else np.asarray(scene.eye, float)


def _reach(scene: Scene) -> float:
    """Return a typical distance from the camera to what the scene is made of, huge spheres left out."""
    scene = placed(scene)
    eye = _eye(scene)
    places: list[Floats] = []
    if scene.lights is not None:
        places.append(np.asarray(casters_of(scene.lights)[0], float))
    if scene.spheres is not None:
        center, radius = np.asarray(scene.spheres.center, float), np.asarray(scene.spheres.radius, float)
        places.append(center[2 * radius < np.linalg.norm(center - eye, axis=-1)])
    if scene.triangles is not None:
        places.append(np.asarray(scene.triangles.vertices, float))
    distances = np.linalg.norm(np.concatenate([*places, np.zeros((0, 3))]) - eye, axis=-1)
    # The lower quartile: a floor may reach far
    return float(np.percentile(distances[distances > 0], 25)) if np.any(distances > 0) else 1.0
