"""jaxrt's picture against Mitsuba's: are they the same up to noise?

    python -m benchmarks.agreement [--scene scenes/room.toml] [--peer-python PATH]

Both render the scene with many seeds; noise is estimated from the spread over seeds. Four numbers decide:
the z of the image mean, the largest z of a block mean against its Šidák limit, the mean z² of the pixels
(1, but for a structured bias or a wrong variance), and how many pixels without noise differ. The latter
have no part in the mean z²: where no seed changes a pixel on either side, as in the dark of a room with a
point light alone, both must have the same value. With few seeds a raw quotient follows Student's t, so each
is turned into the normal z of the same tail probability.
"""

import argparse
import os
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image
from rich.console import Console
from rich.table import Table
from scipy import stats

from benchmarks.processes import (
    cpu_model,
    find_peer,
    jaxrt_side,
    peer_side,
    run_child,
    wide_console,
)
from jaxrt.core.writing import write_whole

BLOCK = 8  # pixels: means of 8×8 pixels are near enough to normal, single pixels with fireflies are not
MEAN_LIMIT = 4.0
PIXEL_LIMITS = (0.8, 1.25)
ALPHA = 0.01  # chance of a false alarm over all blocks
TINY = 1e-300  # keeps quotients and z finite
ROUNDING = 1e-5  # relative, of a float32 sum of some hundred samples


def z_scores(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the z of mean(a) - mean(b) over the leading axis (seeds): Welch's t with its tail made normal.

    Rounding is added to the noise: a light seen directly has none, and need not agree to the last bit.
    """
    a, b = a.astype(np.float64), b.astype(np.float64)
    va, vb = a.var(axis=0, ddof=1) / len(a), b.var(axis=0, ddof=1) / len(b)
    rounding = rounding_of(a, b)
    per_freedom = np.maximum(va**2 / (len(a) - 1) + vb**2 / (len(b) - 1), TINY)
    freedom = np.clip((va + vb) ** 2 / per_freedom, 1, len(a) + len(b) - 2)
    difference = a.mean(axis=0) - b.mean(axis=0)
    tail = stats.t.sf(np.abs(difference) / np.hypot(np.sqrt(va + vb), rounding), freedom)
    return np.sign(difference) * stats.norm.isf(np.maximum(tail, TINY))


def rounding_of(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return what float32 sums as large as those of two stacks, seeds leading, can be off by."""
    return ROUNDING * np.maximum(np.abs(a).max(axis=0), np.abs(b).max(axis=0)) + TINY


def block_means(images: np.ndarray) -> np.ndarray:
    """Return (n, H/8, W/8, 3) means over blocks of 8×8 pixels of (n, H, W, 3) images; the rest is cut off."""
    n, height, width, channels = images.shape
    rows, columns = height // BLOCK, width // BLOCK
    cut = images[:, : rows * BLOCK, : columns * BLOCK].astype(np.float64)
    return cut.reshape(n, rows, BLOCK, columns, BLOCK, channels).mean(axis=(2, 4))


def sidak_limit(tests: int) -> float:
    """Return the |z| that the largest of `tests` normal numbers exceeds with chance ALPHA (Šidák 1967)."""
    return float(stats.norm.isf((1 - (1 - ALPHA) ** (1 / tests)) / 2))


def verdicts(ours: np.ndarray, theirs: np.ndarray) -> list[tuple[str, str, str, bool]]:
    """Return (quantity, value, limit, passed) for the four numbers of two stacks of images (n, H, W, 3)."""
    image_z = float(z_scores(ours.mean(axis=(1, 2, 3)), theirs.mean(axis=(1, 2, 3))))
    blocks = z_scores(block_means(ours), block_means(theirs))
    worst, limit = float(np.abs(blocks).max()), sidak_limit(blocks.size)
    noisy = (np.ptp(ours, axis=0) > 0) | (np.ptp(theirs, axis=0) > 0)
    squared = float((z_scores(ours, theirs)[noisy] ** 2).mean()) if noisy.any() else 1.0
    low, high = PIXEL_LIMITS
    apart = np.abs(ours[0].astype(np.float64) - theirs[0]) > MEAN_LIMIT * rounding_of(ours, theirs)
    different = int(np.count_nonzero(apart & ~noisy))
    return [
        ("z of the image mean", f"{image_z:+.2f}", f"± {MEAN_LIMIT}", abs(image_z) <= MEAN_LIMIT),
        (f"largest |z| of {BLOCK}×{BLOCK} block means", f"{worst:.2f}", f"{limit:.2f}", worst <= limit),
        ("mean z² of noisy pixels", f"{squared:.3f}", f"{low} … {high}", low <= squared <= high),
        ("pixels without noise that differ", f"{different}", "0", different == 0),
    ]


def save_difference(path: str, ours: np.ndarray, theirs: np.ndarray) -> None:
    """Save ours, theirs, and the z of block means (blue: ours darker, red: brighter, ±4) side by side."""
    a, b = ours.mean(axis=0), theirs.mean(axis=0)
    z = np.clip(z_scores(block_means(ours), block_means(theirs)).mean(axis=-1) * np.sqrt(3) / 4, -1, 1)
    z = np.kron(z, np.ones((BLOCK, BLOCK)))
    height, width = z.shape
    colour = np.stack([1 + np.minimum(z, 0), 1 - np.abs(z), 1 - np.maximum(z, 0)], axis=-1)
    shown = [np.clip(x[:height, :width], 0, 1) ** (1 / 2.2) for x in (a, b)]
    picture = Image.fromarray(np.uint8(255 * np.concatenate([*shown, colour], axis=1) + 0.5))
    write_whole(Path(path), lambda file: picture.save(file, format="PNG"))


def load_stack(path: str) -> np.ndarray:
    """Return the images (n, H, W, 3) of a file that a side script has saved."""
    with np.load(path) as archive:
        return archive["images"]


def render_stack(options: argparse.Namespace, folder: str, python: str | None, sampler: str = "") -> np.ndarray:
    """Return the stack of images (n, H, W, 3) of jaxrt with one sampler, or of the peer `python`."""
    names = ("width", "height", "spp", "max_depth", "seeds", "cores")
    out = f"{folder}/{sampler}.npz"
    shared = {name: getattr(options, name) for name in names} | {"out": out}
    if python:
        command = peer_side(python, "image", options.scene, **shared)
    else:
        command = jaxrt_side("image", options.scene, **shared, sampler=sampler, masking=options.masking)
    run_child(command, folder)
    return load_stack(out)


def judge(title: str, ours: np.ndarray, theirs: np.ndarray, console: Console) -> bool:
    """Print the four numbers and the means, and return whether all four pass."""
    table = Table("quantity", "value", "limit", "verdict", title=title)
    rows = verdicts(ours, theirs)
    for quantity, value, limit, passed in rows:
        table.add_row(quantity, value, limit, "[green]PASS" if passed else "[red]FAIL")
    console.print(table)
    beyond = np.mean(np.abs(z_scores(ours, theirs)) > 3)
    console.print(f"values beyond 3 standard errors: {100 * beyond:.2f} %, of normal noise 0.27 %")
    console.print(f"means: jaxrt {ours.mean(axis=(0, 1, 2))}, Mitsuba {theirs.mean(axis=(0, 1, 2))}")
    return all(row[3] for row in rows)


def arguments() -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(description="Test jaxrt's picture against Mitsuba's.")
    parser.add_argument("--scene", default="scenes/room.toml")
    for name in ("width", "height", "max-depth"):
        parser.add_argument(f"--{name}", type=int, help="default: the scene's")
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--seeds", type=int, default=16)
    parser.add_argument("--samplers", nargs="+", default=["independent", "sobol"])
    parser.add_argument("--cores", type=int, default=os.cpu_count())
    parser.add_argument("--masking", default="correlated", help='of rough facets; "separable" as Mitsuba has it')
    parser.add_argument("--reference", help="images of mitsuba_side.py (.npz), instead of rendering them")
    parser.add_argument("--out", default="agreement", help="start of the names of the difference pictures")
    parser.add_argument("--peer-python", help="python of Mitsuba; default: $JAXRT_MITSUBA_PYTHON")
    return parser.parse_args()


def main() -> int:
    """Render, print the verdicts for each sampler, and return 0 for a pass (or no peer), 1 for a failure."""
    options, console = arguments(), wide_console()
    python, message = (None, options.reference) if options.reference else find_peer(options.peer_python)
    console.print(f"{cpu_model()}\n{message}")
    if not python and not options.reference:
        return 0
    passed = True
    with tempfile.TemporaryDirectory() as folder:
        theirs = load_stack(options.reference) if options.reference else render_stack(options, folder, python)
        for sampler in options.samplers:
            ours = render_stack(options, folder, None, sampler)
            passed &= judge(f"{options.scene}, {sampler}", ours, theirs, console)
            save_difference(f"{options.out}-{sampler}.png", ours, theirs)
    console.print(f"{'PASS' if passed else 'FAIL'}; pictures and block z in {options.out}-SAMPLER.png")
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
