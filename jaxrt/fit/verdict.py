"""What a fit's answer is worth: solved, stalled, ambiguous or noise-limited, and why.

Judged on fresh seeds, of which two are a and b. Their difference tells the noise of the rendering. The product of
their residuals at the same pixel adds up to what no sample explains: errors of the model and noise of the target; the
product of neighbouring pixels to errors of the model alone, since noise has no neighbours. However little that is, it
is unexplained if it is more than the answer's standard errors account for, or is there whatever the unknowns are; but
for what the rounding of the target adds.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Pairs = list[tuple[tuple[slice, ...], tuple[slice, ...]]]  # parts of a picture, pixel on pixel
Rows = tuple[Floats, Floats]  # (n, k) from the unknowns' vector to further residuals, and what these (n,) are

AMBIGUOUS = 1e4  # condition of the Jacobian from which on some change of the unknowns leaves the picture alone
SIGNIFICANT = 4.0  # standard deviations; by noise alone one of the four tests exceeds them once in 8,000 fits
REACHES = 1, 3  # pixels: what is sharp and strong in a few, what is wide and faint
SHARP = 0.02  # standard error, in components of the unknowns' vector (places: half of it), of a solved fit
BLIND = 1e-7  # column of the Jacobian, of the largest one, below which no gradient reaches an unknown
TINY = 1e-12  # singular value of J₂ᵀJ₁, of the largest, that is taken for zero
NAMES = 12  # of unknowns in a message
NAMED = 0.1  # share in a null vector from which on an unknown is named


class Verdict(NamedTuple):
    """The verdict in a word, in a sentence, and the numbers behind it."""

    word: str  # "solved", "stalled", "ambiguous" or "noise-limited"
    message: str
    loss: float  # relative MSE on a fresh seed
    noise_floor: float  # what the rendering's own noise adds to it
    structured: float  # RMS of what no noise explains, of the target's RMS
    gradient: float  # cosine between the residual and what the unknowns can change, 0 at a minimum
    condition: float  # of the Jacobian
    null: list[dict[str, float]]  # changes of the unknowns that leave the picture alone
    errors: Floats  # (k,) standard errors of the vector's components, inf where not determined


def judge(
    residuals: Sequence[Floats],
    jacobians: Sequence[Floats],
    labels: list[str],
    places: NDArray[np.bool_],
    sets: int,
    smooth: Rows | None = None,
    rounding: float = 0.0,
) -> Verdict:
    """Return the verdict on an answer.

    residuals: (height, width, 3) of two fresh seeds or more, in units in which the target's sum of squares is 1.
    jacobians: (height, width, 3, k) of the same. labels: names of the k components; places: (k,) which of them are
    places. sets: of how many sets of samples the answer is the mean. smooth: what was to be small besides. rounding:
    what the rounding of the target may add to a residual's sum of squares.
    """
    a, b = residuals[:2]
    jacobian = jacobians[0]
    matrix = jacobian.reshape(-1, jacobian.shape[-1])
    loss, floor = float(np.mean([np.sum(a**2), np.sum(b**2)])), float(np.sum((a - b) ** 2) / 2)
    columns = np.linalg.norm(matrix, axis=0)
    blind = [label for label, norm in zip(labels, columns, strict=True) if norm <= BLIND * max(columns.max(), 1e-6)]
    # Of all that was to be small
    rows, left = matrix, a.ravel()
    if smooth is not None:
        rows, left = _below(matrix, smooth[0]), np.concatenate([left, smooth[1]])
    values, directions = _spectrum(rows)
    condition = float(values[0] / values[-1]) if values[-1] > 0 else np.inf
    null = [
        _shares(direction, labels)
        for s, direction in zip(values, directions, strict=True)
        if s * AMBIGUOUS <= values[0]
    ]
    known = condition <= AMBIGUOUS
    inverses = _inverses(jacobians, smooth, AMBIGUOUS**-2)
    covariance = _covariance(residuals, inverses, sets, smooth)
    errors = np.sqrt(np.maximum(np.diag(covariance), 0)) if known else np.full(len(labels), np.inf)
    found = [(pairs, structure(residuals, pairs)) for pairs in map(neighbours, REACHES)]
    structured = float(np.sqrt(max(found[0][1][0], 0)))
    mean = np.mean(jacobians, axis=0)
    free = inverses if smooth is None else _inverses(jacobians, None, AMBIGUOUS**-2)
    change = mean @ _step(residuals, free)
    outside = [residual - change for residual in residuals]
    # Where it is more than noise, its own sets' and the answer's, the answer is off by about as much
    step = _step(residuals, inverses, smooth)
    missed = step**2 > SIGNIFICANT**2 * (1 + sets / len(residuals)) * np.diag(covariance)
    errors = np.where(missed & known, np.hypot(errors, step), errors)
    explained = all(_is_explained(*one, outside, mean, covariance, rounding) for one in found)
    slope, sizes = rows.T @ left, np.linalg.norm(rows, axis=0)
    gradient = float(np.max(np.abs(slope) / np.maximum(sizes * np.linalg.norm(left), 1e-30)))
    vague = np.flatnonzero(errors > np.where(places, SHARP / 2, SHARP))
    word, message = _word(explained, structured, blind, null, [labels[i] for i in vague])
    return Verdict(word, message, loss, floor, structured, gradient, condition, null, errors)


def _word(
    explained: bool, structured: float, blind: list[str], null: list[dict[str, float]], vague: list[str]
) -> tuple[str, str]:
    if not explained and blind:
        return "stalled", (
            f"no gradient reaches {', '.join(blind)}: nothing in the picture changes with it, though "
            f"{_percent(structured)} of the target is unexplained: start elsewhere (--starts 32), lights above the "
            "floor, in front of walls"
        )
    if not explained:
        return "stalled", (
            f"{_percent(structured)} of the target is unexplained and no step makes it less: a local minimum, "
            "or something else in the scene differs from the target: start elsewhere (--starts 32), or fit more "
            "parameters"
        )
    if null:
        return "ambiguous", f"{_gauge(null)}: fix one of them"
    if vague:
        return "noise-limited", (
            f"the picture is explained, but noise leaves {_some(vague)} uncertain: more spp, or a cleaner target"
        )
    return "solved", "the picture is explained up to noise, and determines the parameters"


def _percent(share: float) -> str:
    """Return a share in percent, to two digits where it is small."""
    return f"{share:.1%}" if share >= 0.01 else f"{100 * share:.2g}%"


def _some(labels: list[str]) -> str:
    """Return the first few names of a list, and how many more there are."""
    more = len(labels) - NAMES
    return ", ".join(labels) if more <= 0 else f"{', '.join(labels[:NAMES])} and {more} more"


def _gauge(null: list[dict[str, float]]) -> str:
    """Return in words what leaves the picture alone."""
    named = sorted({label for direction in null for label in direction})
    albedos = [n for n in named if n.startswith("materials.albedo")]
    intensities = [n for n in named if n.startswith(("lights.intensity", "environment.radiance"))]
    if albedos and intensities and len(albedos) + len(intensities) == len(named):
        if all(_opposite(direction, albedos) for direction in null):
            return f"only the product of albedo and intensity is seen, the scale of {_some(named)} is not"
    if len(named) == 1:
        return f"{named[0]} does not change the picture"
    return f"{_some(named)} can change together without changing the picture"


def _opposite(direction: dict[str, float], albedos: list[str]) -> bool:
    """Return whether albedo and intensity of one channel change in opposite ways."""
    pairs = [(v, w) for n, v in direction.items() for m, w in direction.items() if n in albedos and m not in albedos]
    channels = [(n, m) for n in direction for m in direction if n in albedos and m not in albedos]
    return all(v * w < 0 for (v, w), (n, m) in zip(pairs, channels, strict=True) if n[-1] == m[-1])


def _is_explained(
    pairs: Pairs,
    found: tuple[float, float],
    outside: Sequence[Floats],
    jacobian: Floats,
    covariance: Floats,
    rounding: float,
) -> bool:
    """Return whether noise, rounding and, by their covariance, the errors of the unknowns account for the structure.

    found: that of the residuals. What changes of the unknowns would take away must be within their errors; the rest,
    `outside`, noise.
    """
    power, spread = found
    own = _structure_form(jacobian, pairs) @ covariance
    within = power - np.trace(own) - rounding <= SIGNIFICANT * np.sqrt(spread**2 + 2 * np.trace(own @ own))
    power, spread = structure(outside, pairs)
    return bool(within and power - rounding <= SIGNIFICANT * spread)


def neighbours(reach: int) -> Pairs:
    """Return the slices of a picture that lay each pixel on its neighbours as far as `reach` away, each pair once.

    Those at 1 are beside and below, those farther away all around.
    """
    offsets = [(dy, dx) for dy in range(reach + 1) for dx in range(-reach, reach + 1) if dy or dx > 0]
    offsets = [(dy, dx) for dy, dx in offsets if reach > 1 or not (dy and dx)]
    return [(_shifted(dy, dx), _shifted(-dy, -dx)) for dy, dx in offsets]


def _shifted(*offset: int) -> tuple[slice, ...]:
    return tuple(slice(step, None) if step >= 0 else slice(None, step) for step in offset)


def structure(residuals: Sequence[Floats], pairs: Pairs) -> tuple[float, float]:
    """Return the sum of squares of the structured part of residuals, without bias, and its standard deviation.

    Each pixel meets its neighbours in other sets of samples. Channels of a pixel share their samples, and count once.
    """
    n, sums, power, variance = len(residuals), np.sum(residuals, axis=0), 0.0, 0.0
    for here, there in pairs:
        same = sum(residual[here] * residual[there] for residual in residuals)
        products = np.sum(sums[here] * sums[there] - same, axis=-1) / (n * (n - 1) * len(pairs))
        power += float(np.sum(products))
        variance += float(np.sum(products**2))
    return power, np.sqrt(variance)


def _structure_form(jacobian: Floats, pairs: Pairs) -> Floats:
    """Return the form (k, k) that turns a change of the unknowns into the structure that it adds."""
    k = jacobian.shape[-1]
    forms = [jacobian[here].reshape(-1, k).T @ jacobian[there].reshape(-1, k) for here, there in pairs]
    form = np.mean(forms, axis=0)
    return (form + form.T) / 2


def _inverses(jacobians: Sequence[Floats], smooth: Rows | None, least: float) -> list[Floats]:
    """Return what turns each set's residuals, and those that were to be small besides, into a step (k,).

    least: of `instrumental`.
    """
    if smooth is not None:
        jacobians = [_below(jacobian, smooth[0]) for jacobian in jacobians]
    n = len(jacobians)
    return [instrumental(jacobians[i], jacobians[(i + 1) % n], least) for i in range(n)]


def _step(residuals: Sequence[Floats], inverses: list[Floats], smooth: Rows | None = None) -> Floats:
    """Return the step (k,) of a least-squares solver from an answer on, by sets of samples that it was not made of."""
    left = [residual.ravel() for residual in residuals]
    if smooth is not None:
        left = [np.concatenate([residual, smooth[1]]) for residual in left]
    return np.mean([inverse @ one for inverse, one in zip(inverses, left, strict=True)], axis=0)


def _spectrum(matrix: Floats) -> tuple[Floats, Floats]:
    """Return the singular values (k,), largest first, and the right singular vectors, one a row."""
    triangle = np.linalg.qr(matrix, mode="r")
    _, values, directions = np.linalg.svd(triangle)
    return values, directions


def _shares(direction: Floats, labels: list[str]) -> dict[str, float]:
    """Return the components of a null vector that matter, the first positive."""
    direction = direction * np.sign(direction[np.argmax(np.abs(direction) >= NAMED)])
    return {n: round(float(v), 3) for n, v in zip(labels, direction, strict=True) if abs(v) >= NAMED}


def standard_errors(
    residuals: Sequence[Floats], jacobians: Sequence[Floats], sets: int = 1, smooth: Rows | None = None
) -> Floats:
    """Return the standard errors (k,) of a least-squares answer, from residuals (..., c) and J (..., c, k) there.

    residuals, jacobians: of n sets of samples that the answer was not made of. sets: of how many it was.

    The sandwich (JᵀJ)⁻¹ Jᵀ S J (JᵀJ)⁻¹ (White 1980), S = rrᵀ within each pixel: path-traced noise is not alike in all
    pixels, that of shadow edges, which place a light, is large; and the c channels of a pixel share their samples.
    JᵀJ of one set is too large by J's own noise, which makes errors too small: here each meets the J of the next.

    Of the n steps that a pixel asks for, the mean has the variance T + R/n and the spread that of R: T is the target's
    noise, R a set's. The answer's is T + R/sets, so that much is added. More sets make errors more certain, which few
    pixels may tell: where a highlight of 4 tells a roughness, those of one set are off by a third.

    smooth: further residuals, of what was to be small besides. Of these S is the mean square of all: texels that no
    picture shows are as rough as the others, however smoothly they are filled.
    """
    return np.sqrt(np.maximum(np.diag(_covariance(residuals, _inverses(jacobians, smooth, TINY), sets, smooth)), 0))


def _covariance(residuals: Sequence[Floats], inverses: list[Floats], sets: int, smooth: Rows | None) -> Floats:
    """Return the covariance (k, k) whose diagonal holds the squares of `standard_errors`."""
    n, k, seen, channels = len(residuals), len(inverses[0]), residuals[0].size, residuals[0].shape[-1]
    steps = [inverse[:, :seen] * one.ravel() for inverse, one in zip(inverses, residuals, strict=True)]
    scores = np.stack([step.reshape(k, -1, channels).sum(axis=-1) for step in steps])
    mean = np.mean(scores, axis=0)
    covariance = mean @ mean.T
    if n > 1:
        off = (scores - mean).transpose(1, 0, 2).reshape(k, -1)
        covariance += off @ off.T / (n - 1) * (1 / sets - 1 / n)
    if smooth is not None:
        filled = np.mean(inverses, axis=0)[:, seen:]
        covariance += np.mean(smooth[1] ** 2) * filled @ filled.T
    return covariance


def _below(jacobian: Floats, rows: Floats) -> Floats:
    """Return a Jacobian (…, k) as a matrix with further rows below."""
    return np.concatenate([jacobian.reshape(-1, rows.shape[1]), rows])


def instrumental(jacobian: Floats, instrument: Floats, least: float = TINY) -> Floats:
    """Return (J₂ᵀJ₁)⁻¹J₂ᵀ (k, n), which turns a residual into a step.

    least: singular value of J₂ᵀJ₁, of the largest, that is not taken for zero.
    """
    k = jacobian.shape[-1]
    here, other = jacobian.reshape(-1, k), instrument.reshape(-1, k)
    return np.linalg.pinv(other.T @ here, rcond=least) @ other.T


def promised_gain(residual: Floats, jacobian: Floats, step: NDArray[np.floating] | None) -> float:
    """Return by how much the linear model says that the loss falls: with a step, or with the best there is."""
    change = -np.linalg.lstsq(jacobian.T @ jacobian, jacobian.T @ residual)[0] if step is None else step
    return float(np.sum(residual**2) - np.sum((residual + jacobian @ change) ** 2))
