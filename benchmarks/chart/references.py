"""References with their standard errors, kept in the user's cache folder from run to run."""

import hashlib
import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.samplers import REFERENCE_SEED, Reference
from jaxrt.core.writing import write_whole


def cache_folder() -> Path:
    """Return where references are kept."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "jaxrt" / "references"


def content_key(files: list[Path], settings: dict[str, object]) -> str:
    """Return a name for what the files hold and what the settings are."""
    digest = hashlib.sha256(json.dumps(settings, sort_keys=True).encode())
    for file in files:
        digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()[:24]


def cached(folder: Path, key: str, make: Callable[[], Reference]) -> Reference:
    """Return the reference of that key from the folder, or make it and keep it there."""
    file = folder / f"{key}.npz"
    if file.exists():
        with np.load(file) as archive:
            return Reference(archive["image"], float(archive["variance"]))
    made = make()
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(file, lambda half: np.savez(half, image=made.image, variance=made.variance))
    return made


def mean_image(draw: Callable[[int], np.ndarray], seeds: int) -> Reference:
    """Return the mean of the images of `seeds` seeds of their own, its variance known from their spread.

    Welford's way: images are not kept.
    """
    mean, squares = np.zeros(()), np.zeros(())
    for i in range(seeds):
        image = draw(REFERENCE_SEED + i)
        change = image - mean
        mean = mean + change / (i + 1)
        squares = squares + change * (image - mean)
    return Reference(mean, float(squares.mean() / (seeds - 1) / seeds))
