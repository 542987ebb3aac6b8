"""What a fit reads and leaves: the target, fit.json, the loss curve and the before/after picture."""

import json
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jaxrt.core.writing import write_text, write_whole
from jaxrt.description import show
from jaxrt.fit.answer import Fit
from jaxrt.fit.descent import DONE, Progress
from jaxrt.fit.lacks import Missing
from jaxrt.fit.solve import MOST_ROUNDS
from jaxrt.fit.targets import FitError
from jaxrt.fit.unknowns import Unknowns
from jaxrt.io.color import gamma_encode, srgb_encode
from jaxrt.io.files import SCENE_BYTES, read_bytes
from jaxrt.io.image import load_image

Floats = NDArray[np.floating]

WHITE = 254.5 / 255  # display value from which on a pixel tells only that it is at least so bright


class Target(NamedTuple):
    """A picture to be matched."""

    image: Floats  # (height, width, 3) linear radiance
    weight: Floats  # (height, width, 3) 1, or 0 where the file does not tell the radiance
    notes: tuple[str, ...]  # what was done to it


def load_target(path: Path, srgb: bool = False) -> Target:
    """Return the target in an EXR file, or in a PNG file, linearised and without its clipped pixels.

    Raises ValueError and FileNotFoundError as `load_image` does.
    """
    image = load_image(path, srgb)
    weight = np.ones_like(image)
    notes = []
    if path.suffix.lower() == ".png":
        display = np.asarray(srgb_encode(image) if srgb else gamma_encode(image))
        weight = (display < WHITE).astype(np.float32)
        curve = "the sRGB curve" if srgb else "gamma 2.2"
        notes.append(
            f"{path}: display values, linearised by {curve}; {1 - weight.mean():.1%} clipped at white, left out"
        )
    bad = ~np.isfinite(image)
    if bad.any():
        notes.append(f"{path}: {int(bad.any(-1).sum())} pixels are not finite, left out")
    weight = np.where(bad, 0, weight).astype(np.float32)
    return Target(np.where(bad, 0, image), weight, tuple(notes))


def write_report(path: Path, report: Mapping[str, Any]) -> None:
    """Write fit.json; numbers that are not finite become null."""
    text = json.dumps(_plain(report), indent=2, allow_nan=False) + "\n"
    write_text(path, text)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value


def progress_report(values: Mapping[str, Floats], progress: Progress, missing: Missing) -> dict[str, Any]:
    """Return what fit.json holds while the fit goes on: enough to resume from."""
    stands = {key: value for key, value in progress._asdict().items() if key not in ("step", "loss")}
    return {
        "verdict": None,
        "parameters": {
            name: {"value": value, "derivative_lacks": missing.get(name, ())} for name, value in values.items()
        },
        "iterations": progress.step,
        "progress": stands,
    }


def final_report(answer: Fit) -> dict[str, Any]:
    """Return what fit.json holds at the end."""
    report = progress_report(answer.values, answer.progress, answer.lacks)
    for name, errors in answer.errors.items():
        report["parameters"][name]["standard_error"] = errors
    verdict = answer.verdict._asdict()
    del verdict["errors"]
    return {**report, "verdict": {**verdict, "interrupted": bool(answer.interrupted)}}


def read_progress(path: Path, unknowns: Unknowns) -> Progress:
    """Return the progress that fit.json holds. Raises FitError where it is of another fit, damaged, or not there."""
    if not os.path.lexists(path):
        raise FitError(f"{path}: no such file: nothing to resume, leave out --resume")
    data = read_bytes(path, (".json",), limit=SCENE_BYTES)
    try:
        report = json.loads(data)
        names, progress = list(report["parameters"].keys()), report["progress"]
        vector, losses, stage = _numbers(progress["vector"]), _numbers(progress["losses"]), progress["stage"]
        step_size, waiting, rounds = progress.get("step_size"), progress.get("waiting", 0), progress.get("rounds", 1)
        sizes = _numbers([] if step_size is None else [step_size])
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
        raise FitError(f"{path}: is no report of a fit: nothing to resume, leave out --resume") from None
    if names != [row.text for row in unknowns.rows]:
        raise FitError(f"{path}: is of another fit, of {', '.join(names)[:100]}: name the same --parameters")
    if len(vector) != sum(row.size for row in unknowns.rows):
        raise FitError(f"{path}: has {len(vector)} unknowns where the fit has others: leave out --resume")
    if type(stage) is not int or not 0 <= stage <= DONE:
        raise FitError(f"{path}: stage {show(stage)} is none of a fit: leave out --resume")
    counts = type(waiting) is int and type(rounds) is int and 1 <= rounds <= MOST_ROUNDS
    if not counts or any(size <= 0 for size in sizes):
        raise FitError(f"{path}: step_size, waiting or rounds is none of a fit: leave out --resume")
    loss, size = losses[-1] if losses else math.inf, sizes[0] if sizes else None
    return Progress(len(losses), stage, np.asarray(vector, np.float32), loss, losses, size, waiting, rounds)


def _numbers(values: Any) -> tuple[float, ...]:
    """Return a list of finite numbers of float32. Raises TypeError or ValueError for anything else."""
    if not isinstance(values, list) or not all(type(value) in (int, float) for value in values):
        raise TypeError("no list of numbers")
    with np.errstate(over="ignore"):
        finite = np.isfinite(np.asarray(values, float).astype(np.float32)).all()
    if not finite:
        raise ValueError("not finite")
    return tuple(float(value) for value in values)


def draw_losses(path: Path, losses: tuple[float, ...]) -> None:
    """Draw the loss of each step."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5, 3.2), layout="constrained")
    axes = figure.subplots()
    axes.semilogy(range(1, len(losses) + 1), losses, ".-")
    axes.set(xlabel="step", ylabel="relative MSE", title="loss on the fit's own samples, coarse to fine")
    axes.grid(alpha=0.3)
    write_whole(path, lambda file: figure.savefig(file, format="png", dpi=120))


def draw_before_after(path: Path, targets: Sequence[Target], before: Floats, after: Floats) -> None:
    """Draw targets, start, answer, and the errors of both in one colour scale: a row for each view.

    before, after: pictures of all views, one below the other.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 3 * len(targets)), layout="constrained")
    rows, first = figure.subplots(len(targets), 5, squeeze=False), 0
    views = []
    for target in targets:
        height, width, _ = target.image.shape
        seen, own = target.image * target.weight, slice(first, first + height)
        views.append((seen, before[own, :width], after[own, :width]))
        first += height
    bright = float(np.quantile(np.concatenate([seen.max(axis=-1).ravel() for seen, _, _ in views]), 0.99)) or 1.0
    widest = max(float(np.max(np.abs(np.mean(start - seen, axis=-1)))) for seen, start, _ in views) or 1.0
    for axes, (seen, *pictures) in zip(rows, views, strict=True):
        for place, title, picture in zip(axes, ("target", "start", "fit"), (seen, *pictures), strict=False):
            place.imshow(np.clip(gamma_encode(picture / bright), 0, 1))
            place.set_title(title)
        for place, title, picture in zip(axes[3:], ("start - target", "fit - target"), pictures, strict=True):
            shown = place.imshow(np.mean(picture - seen, axis=-1), cmap="RdBu_r", vmin=-widest, vmax=widest)
            place.set_title(title)
        figure.colorbar(shown, ax=axes[4])
        for place in axes:
            place.set_axis_off()
    write_whole(path, lambda file: figure.savefig(file, format="png", dpi=100))
