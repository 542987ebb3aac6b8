"""What a fit's answer is worth: solved, stalled, ambiguous or noise-limited, and why.

Judged on fresh seeds, of which two are a and b. Their difference tells the noise of the rendering. The product of
their residuals at the same pixel adds up to what no sample explains: errors of the model and noise of the target; the
product of neighbouring pixels to errors of the model alone, since noise has no neighbours.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Rows = tuple[Floats, Floats]  # (n, k) from the unknowns' vector to further residuals, and what these (n,) are

AMBIGUOUS = 1e4  # condition of the Jacobian from which on some change of the unknowns leaves the picture alone
UNEXPLAINED = 0.01  # structured residual, of the target's RMS, that counts as an explained picture
SIGNIFICANT = 4.0  # standard deviations
SHARP = 0.02  # standard error, in components of the unknowns' vector (places: half of it), of a solved fit
BLIND = 1e-7  # column of the Jacobian, of the largest one, below which no gradient reaches an unknown
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
) -> Verdict:
    """Return the verdict on an answer.

    residuals: (height, width, 3) of two fresh seeds or more, in units in which the target's sum of squares is 1.
    jacobians: (height, width, 3, k) of the same. labels: names of the k components; places: (k,) which of them are
    places. sets: of how many sets of samples the answer is the mean. smooth: what was to be small besides.
    """
    a, b = residuals[:2]
    jacobian = jacobians[0]
    matrix = jacobian.reshape(-1, jacobian.shape[-1])
    loss, floor = float(np.mean([np.sum(a**2), np.sum(b**2)])), float(np.sum((a - b) ** 2) / 2)
    structured, significance = _structure(a, b)
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
    errors = standard_errors(residuals, jacobians, sets, smooth) if known else np.full(len(labels), np.inf)
    slope, sizes = rows.T @ left, np.linalg.norm(rows, axis=0)
    gradient = float(np.max(np.abs(slope) / np.maximum(sizes * np.linalg.norm(left), 1e-30)))
    explained = structured <= UNEXPLAINED or significance <= SIGNIFICANT
    vague = np.flatnonzero(errors > np.where(places, SHARP / 2, SHARP))
    word, message = _word(explained, structured, blind, null, [labels[i] for i in vague])
    return Verdict(word, message, loss, floor, structured, gradient, condition, null, errors)


def _word(
    explained: bool, structured: float, blind: list[str], null: list[dict[str, float]], vague: list[str]
) -> tuple[str, str]:
    if not explained and blind:
        return "stalled", (
            f"no gradient reaches {', '.join(blind)}: nothing in the picture changes with it, though {structured:.1%} "
            "of the target is unexplained: start elsewhere (--starts 32), lights above the floor, in front of walls"
        )
    if not explained:
        return "stalled", (
            f"{structured:.1%} of the target is unexplained and no step makes it less: a local minimum, or something "
            "else in the scene differs from the target: start elsewhere (--starts 32), or fit more parameters"
        )
    if null:
        return "ambiguous", f"{_gauge(null)}: fix one of them"
    if vague:
        return "noise-limited", (
            f"the picture is explained, but noise leaves {_some(vague)} uncertain: more spp, or a cleaner target"
        )
    return "solved", "the picture is explained up to noise, and determines the parameters"


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


def _structure(a: Floats, b: Floats) -> tuple[float, float]:
    """Return the RMS of the structured part of two residuals, and its significance in standard deviations."""
    pairs = [(a[:, 1:], b[:, :-1]), (a[:, :-1], b[:, 1:]), (a[1:], b[:-1]), (a[:-1], b[1:])]
    power = sum(float(np.sum(x * y)) for x, y in pairs) / len(pairs)
    spread = np.sqrt(sum(float(np.sum((x * y) ** 2)) for x, y in pairs)) / len(pairs)
    return float(np.sqrt(max(power, 0))), power / spread if spread > 0 else 0.0


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
    n, (channels, k) = len(residuals), jacobians[0].shape[-2:]
    if smooth is not None:
        jacobians = [_below(jacobian, smooth[0]) for jacobian in jacobians]
    inverses, seen = [instrumental(jacobians[i], jacobians[(i + 1) % n]) for i in range(n)], residuals[0].size
    steps = [inverse[:, :seen] * one.ravel() for inverse, one in zip(inverses, residuals, strict=True)]
    scores = np.stack([step.reshape(k, -1, channels).sum(axis=-1) for step in steps])
    variance = np.mean(scores, axis=0) ** 2
    if n > 1:
        variance += np.var(scores, axis=0, ddof=1) * (1 / sets - 1 / n)
    filled = 0 if smooth is None else np.mean(smooth[1] ** 2) * np.sum(np.mean(inverses, 0)[:, seen:] ** 2, axis=1)
    return np.sqrt(np.maximum(np.sum(variance, axis=1), 0) + filled)


def _below(jacobian: Floats, rows: Floats) -> Floats:
    """Return a Jacobian (…, k) as a matrix with further rows below."""
    return np.concatenate([jacobian.reshape(-1, rows.shape[1]), rows])


def instrumental(jacobian: Floats, instrument: Floats, least: float = 1e-12) -> Floats:
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
