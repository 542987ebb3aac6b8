"""The unknowns of a fit as one vector without bounds.

Albedos are the sigmoid of their number, intensities, radii and indices of refraction the exponential: a clipped value
would lose its derivative at the bound. Places are counted in units of the scene's size, so that a step of one vector
component is of like weight for all; rotation vectors in radians.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import ArrayLike, NDArray

from jaxrt.description import SceneError, show
from jaxrt.fit.targets import FitError
from jaxrt.lights import casters_of
from jaxrt.scene import Scene, placed
from jaxrt.scene.measures import TEXTURES, has_rows, measure
from jaxrt.scene.names import rows_called
from jaxrt.scene.parameters import parameters, with_parameters
from jaxrt.scene.selectors import Selector
from jaxrt.textures.neighbours import neighbours

Floats = NDArray[np.float64]

EDGE = 0.02  # starts are kept this far inside the bounds, where the derivative is not yet lost
HALF_TURN = 180.0  # degrees, the bound of a field of view
RADIAN = HALF_TURN / np.pi


class Unknown(NamedTuple):
    """One parameter row with its place in the vector."""

    selector: Selector
    text: str  # as the user wrote it
    kind: str  # "place", "shift", "turn", "fraction", "positive", "angle" or "free"
    first: int
    shape: tuple[int, ...]

    @property
    def size(self) -> int:
        """Return how many components of the vector it takes."""
        return int(np.prod(self.shape))

    @property
    def span(self) -> slice:
        """Return its components in the vector."""
        return slice(self.first, self.first + self.size)

    def labels(self) -> list[str]:
        """Return the name of each component."""
        if not self.shape:
            return [self.text]
        axes = measure(self.selector.name).axes
        rows = [self.text + "".join(f"[{i}]" for i in place) for place in np.ndindex(self.shape[:-1])]
        return [f"{row}.{axis}" for row in rows for axis in axes]


class Unknowns(NamedTuple):
    """All unknowns, and the length that places are counted in."""

    rows: tuple[Unknown, ...]
    length: float

    def labels(self) -> list[str]:
        """Return the name of each component of the vector."""
        return [label for row in self.rows for label in row.labels()]

    @property
    def turns_of_placed(self) -> NDArray[np.bool_]:
        """Return which components (k,) of the vector turn a thing whose place is sought too."""
        sought = {row.selector for row in self.rows}

        def placed(turn: Selector) -> bool:
            return turn._replace(name=turn.name.removesuffix("rotate") + "translate") in sought

        return np.concatenate([np.full(row.size, placed(row.selector)) for row in self.rows])

    def vector(self, scene: Scene) -> NDArray[np.floating]:
        """Return the vector (k,) of the scene's own values, kept a little inside the bounds."""
        values = parameters(scene)
        parts = [_free(row, np.asarray(row.selector.pick(values[row.selector.name])), self.length) for row in self.rows]
        return np.concatenate(parts).astype(scene.dtype)

    def apply(self, scene: Scene, vector: Array) -> Scene:
        """Return the scene with the values that the vector stands for: pure, differentiable in the vector."""
        return self.put(scene, [bounded(row.kind, vector[row.span], self.length) for row in self.rows])

    def put(self, scene: Scene, values: Sequence[ArrayLike]) -> Scene:
        """Return the scene with a value for each unknown."""
        rows = zip(self.rows, values, strict=True)
        return with_parameters(scene, {str(row.selector): jnp.reshape(jnp.asarray(x), row.shape) for row, x in rows})

    def values(self, vector: ArrayLike) -> dict[str, Floats]:
        """Return the value of each unknown by the user's name for it."""
        return {row.text: self._value(row, vector).reshape(row.shape) for row in self.rows}

    def slopes(self, vector: ArrayLike) -> Floats:
        """Return d value / d component (k,): what turns standard errors of the vector into those of the values."""
        parts = []
        for row in self.rows:
            value = self._value(row, vector)
            slope = {"fraction": value * (1 - value), "positive": value, "angle": value * (1 - value / HALF_TURN)}
            parts.append(slope.get(row.kind, np.full_like(value, _unit(row.kind, self.length))))
        return np.concatenate(parts)

    def _value(self, row: Unknown, vector: ArrayLike) -> Floats:
        """Return the numbers of an unknown as `bounded` does, by NumPy: small programs take long to compile."""
        u = np.asarray(vector, float)[row.span]
        if row.kind in ("fraction", "angle"):
            return (HALF_TURN if row.kind == "angle" else 1) / (1 + np.exp(-u))
        if row.kind == "positive":
            return np.exp(u)
        return _unit(row.kind, self.length) * u


def _unit(kind: str, length: float) -> float:
    """Return in what an unknown that has no bounds is counted."""
    return {"free": 1.0, "turn": RADIAN}.get(kind, length)


def bounded(kind: str, u: Array, length: float) -> Array:
    """Return the values that components without bounds stand for."""
    if kind == "fraction":
        return jax.nn.sigmoid(u)
    if kind == "angle":
        return HALF_TURN * jax.nn.sigmoid(u)
    if kind == "positive":
        return jnp.exp(u)
    return _unit(kind, length) * u


def _free(row: Unknown, value: Floats, length: float) -> Floats:
    """Return the components of a start value."""
    value = value.astype(float).reshape(-1)
    if row.kind in ("fraction", "angle"):
        share = np.clip(value / (HALF_TURN if row.kind == "angle" else 1), EDGE, 1 - EDGE)
        return np.log(share / (1 - share))
    if row.kind == "positive":
        largest = value.max() if value.max() > 0 else 1.0
        return np.log(np.maximum(value, EDGE * largest))
    return value / _unit(row.kind, length)


def unknowns_of(scene: Scene, selectors: Mapping[str, Selector]) -> Unknowns:
    """Return the unknowns that the selectors name, by the user's words for them. Raises SceneError for doubles."""
    values, rows, first = parameters(scene), [], 0
    seen: set[Selector] = set()
    for text, selector in selectors.items():
        if selector in seen:
            raise SceneError(f"{text}: is named twice: name it once")
        seen.add(selector)
        shape = selector.pick(values[selector.name]).shape
        row = Unknown(selector, text, measure(selector.name).range, first, shape)
        rows.append(row)
        first += row.size
    return Unknowns(tuple(rows), scene_length(scene))


def scene_length(scene: Scene) -> float:
    """Return the diagonal of the box around camera, lights, triangles and all but huge spheres, in scene units."""
    scene = placed(scene)
    camera, eye = scene.camera, np.zeros(3) if scene.eye is None else np.asarray(scene.eye, float)
    fields = [field for field, known in camera.kind.parameters.items() if known.range == "place"]
    points: list[Floats] = [np.asarray(getattr(camera, field), float)[None] for field in fields]
    if scene.lights is not None:
        points.append(np.asarray(casters_of(scene.lights)[0], float))
    if scene.triangles is not None:
        points.append(np.asarray(scene.triangles.vertices, float))
    if scene.spheres is not None:
        center, radius = np.asarray(scene.spheres.center, float), np.asarray(scene.spheres.radius, float)[:, None]
        small = 2 * radius[:, 0] < np.linalg.norm(center - eye, axis=1)
        points += [(center - radius)[small], (center + radius)[small]]
    box = np.concatenate(points or [eye[None]])
    return float(np.linalg.norm(box.max(axis=0) - box.min(axis=0))) or 1.0


def all_rows(texts: Sequence[str], scene: Scene) -> list[str]:
    """Return the texts with each name of several rows, a parameter or a mesh's vertices, replaced by all of these."""
    values, out = parameters(scene), []
    for text in texts:
        name, row = rows_called(scene.names, text, values)
        rows = slice(None) if row is None and has_rows(name) else row
        numbers = range(values[name].shape[0])[rows] if isinstance(rows, slice) else ()
        out += [f"{name}[{i}]" for i in numbers] if len(numbers) > 1 else [text]
    return out


def differences(scene: Scene, unknowns: Unknowns, smoothness: float | None) -> Floats | None:
    """Return the matrix (n, k) from the unknowns' vector to weighted differences of neighbouring texels.

    What no picture shows then goes on from around it; where pictures tell, they outweigh it. The sum of their squares
    is the square of `smoothness` where they are 1 on average: a picture that is off by that share of its own size costs
    as much. None without smoothness. Raises FitError for what is no such number, and where no picture is among the
    unknowns.
    """
    if smoothness is None:
        return None
    if isinstance(smoothness, bool) or not isinstance(smoothness, int | float) or not 0 < smoothness < math.inf:
        raise FitError(f"fit: smoothness is {show(smoothness)}: pass a number above 0, as 0.01, or none")
    found, textures = [np.zeros((0, sum(row.size for row in unknowns.rows)))], scene.materials.textures
    for row in unknowns.rows:
        if row.selector.name.startswith(TEXTURES) and textures is not None:
            pairs = neighbours(textures, row.selector.name.removeprefix(TEXTURES))
            places = row.first + 3 * pairs[..., None] + np.arange(3)
            own = np.zeros((places[:, 0].size, found[0].shape[1]))
            first, second = (places[:, i].ravel() for i in (0, 1))
            own[np.arange(len(own)), first], own[np.arange(len(own)), second] = 1, -1
            found.append(own)
    matrix = np.concatenate(found)
    if not len(matrix):
        raise FitError("fit: smoothness is of the texels of pictures, and none are sought: leave it out")
    return matrix * (smoothness / len(matrix) ** 0.5)
