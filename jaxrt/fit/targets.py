"""What a fit is to match: radiance, or a dict of outputs by name, held as one picture of all their channels."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from jaxrt.description import SceneError, show
from jaxrt.scene import Scene
from jaxrt.transport.outputs import SKY, channels
from jaxrt.views import LIGHT, NUMBERS, Asked, asked_for

Floats = NDArray[np.float64]
Pictures = NDArray[np.floating]
Named = Mapping[str, Any]

FLAT = 0.1  # least size of what varies little, of the root of its sum of squares
LEVELS = 256  # values of 8 bits
MANY = 4  # pixels and channels of each value, on average, where a picture is of 8 bits
STEEPEST = 2.4  # largest step of sRGB and of gamma 2.2, of the brightest over `LEVELS`
SHINING = (*LIGHT, SKY)  # whose 0 is black
RADIANCE = Asked(("radiance",), True, {}, False)


class FitError(SceneError):
    """A fit that cannot go on: culprit, what, remedy."""


class Targets(NamedTuple):
    """What the views of a scene are to show."""

    outputs: Asked
    pictures: list[Array]  # (height, width, channels), one of each view, 0 where the weight is
    weights: list[Array]  # of their shapes
    by_name: bool  # whether the outputs were given by name


def targets_of(scene: Scene, targets: Sequence[Any], weights: Sequence[Any]) -> Targets:
    """Return targets and weights of all views, as the user gave them. Raises FitError."""
    by_name = isinstance(targets[0], Mapping)
    if by_name:
        weights = [{} if weight is None else weight for weight in weights]
    else:
        targets, weights = ([{"radiance": value} for value in values] for values in (targets, weights))
    outputs = _outputs(scene, targets, weights)
    pairs = [_checked(outputs, *pair) for pair in zip(targets, weights, strict=True)]
    return Targets(outputs, [picture for picture, _ in pairs], [weight for _, weight in pairs], by_name)


def _outputs(scene: Scene, targets: Sequence[Any], weights: Sequence[Any]) -> Asked:
    """Return what all views show."""
    names = list(targets[0])
    for target in targets:
        if not isinstance(target, Mapping) or set(target) != set(names):
            raise FitError(f"target: views show different things: give each a dict of {', '.join(names)}")
    for weight in weights:
        if not isinstance(weight, Mapping) or not set(weight) <= set(names):
            raise FitError(f"weight: want a dict, as the target is, of {', '.join(names)}")
    fixed = [name for name in names if name in NUMBERS]
    if fixed:
        raise FitError(f'target: "{fixed[0]}" has no derivative: fit "mask[NAME]", the share that shows a thing')
    try:
        return asked_for(scene, names)
    except ValueError as error:
        raise FitError(str(error).replace("render: ", "target: ", 1)) from None


def _checked(outputs: Asked, target: Named, weight: Named) -> tuple[Array, Array]:
    """Return target and weight (height, width, channels) of a view."""
    pictures, trust = {}, {}
    for name, width in _widths(outputs).items():
        pictures[name] = _picture(name, target[name], width)
        trust[name] = _weight(name, weight.get(name), pictures[name].shape)
    sizes = {picture.shape[:2] for picture in pictures.values()}
    if len(sizes) > 1:
        raise FitError(f"target: outputs of one view differ in size, {show(sorted(sizes))}: crop or shrink them alike")
    picture, weights = joined(pictures), joined(trust)
    return jnp.where(weights == 0, 0, picture), weights


def _picture(name: str, value: Any, width: int) -> Pictures:
    want = ("(height, width)" if width == 1 else f"(height, width, {width})") + " of linear radiance" * (
        name in SHINING
    )
    try:
        picture = np.asarray(value, np.float32)
    except (TypeError, ValueError):
        raise FitError(f"target: {_of(name)}{show(value)}, want {want}") from None
    if picture.shape[2:] != ((width,) if width > 1 else ()) or picture.ndim < 2 or not picture.size:
        raise FitError(f"target: {_of(name)}shape {picture.shape}, want {want}")
    return picture


def _weight(name: str, value: Any, shape: tuple[int, ...]) -> Pictures:
    trust = np.ones(1, np.float32) if value is None else np.asarray(value, np.float32)
    try:
        trust = np.broadcast_to(trust, shape)
    except ValueError:
        raise FitError(f"weight: {_of(name)}shape {trust.shape}, want that of the target, {shape}") from None
    if not (np.isfinite(trust).all() and (trust >= 0).all()):
        raise FitError(f"weight: {_of(name)}has numbers that are negative or not finite: use 0 to 1")
    return trust


def _widths(outputs: Asked) -> dict[str, int]:
    """Return how many channels each output has."""
    return {name: 3 if name in LIGHT else channels((outputs.outputs[name],)) for name in outputs.names}


def joined(found: Mapping[str, Any]) -> Array:
    """Return outputs (height, width) or (height, width, c) as one picture (height, width, channels)."""
    parts = [part[..., None] if part.ndim == 2 else part for part in found.values()]
    return jnp.concatenate(parts, axis=-1) if len(parts) > 1 else jnp.asarray(parts[0])


def parted(picture: Pictures, outputs: Asked) -> dict[str, Pictures]:
    """Return the outputs that such a picture has been joined from."""
    found, first = {}, 0
    for name, width in _widths(outputs).items():
        found[name] = picture[..., first] if width == 1 else picture[..., first : first + width]
        first += width
    return found


def scale_of(target: Array, weight: Array, outputs: Asked) -> Floats:
    """Return the units (1, 1, channels) of residuals, in which the target's own size is 1.

    Outputs have units of their own: each counts by its size, times what weights it is given. Raises FitError where one
    has none.
    """
    pictures, weights = (parted(np.asarray(x, float), outputs) for x in (target, weight))
    sizes = {name: _size(name, picture, weights[name] > 0) for name, picture in pictures.items()}
    units = {name: size / sizes[outputs.names[0]] for name, size in sizes.items()}
    size = math.hypot(*(_size(name, picture, weights[name]) / units[name] for name, picture in pictures.items()))
    return np.repeat([size * unit for unit in units.values()], list(_widths(outputs).values()))[None, None]


def _size(name: str, picture: Pictures, weight: NDArray[Any]) -> float:
    """Return the root of the weighted sum of squares: of light from black on, of others from their mean on.

    Where they are of no light, what is 0 has no meaning: a ball in front of a far wall changes little of the distance.
    """
    whole = float(np.linalg.norm(picture * weight))
    if not np.isfinite(whole):
        raise FitError(f"target: {_of(name)}has pixels that are not finite: mask them, check scene and target")
    if whole == 0:
        raise FitError(f"target: {_of(name)}black, or masked everywhere: choose another picture")
    if name in SHINING:
        return whole
    mean = np.sum(picture * weight, axis=(0, 1)) / np.sum(np.broadcast_to(weight, picture.shape), axis=(0, 1))
    return max(float(np.linalg.norm((picture - mean) * weight)), FLAT * whole)


def rounding_of(target: Array, weight: Array, scale: Floats) -> float:
    """Return the sum of squares that rounding to 8 bits may add to residuals; 0 of a picture that is not of 8 bits.

    One that is has few values, each of many pixels; from one to the next is a step, by whatever curve they are encoded.
    """
    picture, trust = np.asarray(target, float), np.asarray(weight, float)
    values, number = np.unique(picture, return_inverse=True)
    if len(values) < 2 or len(values) > LEVELS or picture.size < MANY * len(values):
        return 0.0
    steps = np.minimum(np.diff(values), STEEPEST * values[-1] / LEVELS)
    step = (np.minimum(np.append(steps, np.inf), np.append(np.inf, steps)))[number.reshape(picture.shape)]
    return float(np.sum((step * trust / scale) ** 2) / 12)


def _of(name: str) -> str:
    """Return the name of an output as it stands in messages; a picture needs none."""
    return "" if name == "radiance" else f"{name}: "
