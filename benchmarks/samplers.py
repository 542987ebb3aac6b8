"""What a sampler is worth: RMSE × √(CPU time), the error of an equal-time picture, relative to `independent`.

    python -m benchmarks.samplers [--scene scenes/room.toml]

The mean square error is taken against a reference of many samples with seeds of its own, over the whole
image and all seeds. Reference and picture are independent, so their variances add: the reference's own
variance, known from the spread of the images it is the mean of, is subtracted.
"""

import argparse
import os
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.progress import Progress
from rich.table import Table

from benchmarks.jaxrt_side import clocked, load, use_cores
from benchmarks.processes import cpu_model, wide_console

SAMPLERS = ("independent", "stratified", "sobol")
REFERENCE_SEED = 1_000_000  # first seed of the reference: far from those of the pictures
RESAMPLES = 500  # bootstrap draws over seeds


@dataclass(frozen=True)
class Reference:
    """A picture near the truth, and how near."""

    image: np.ndarray  # (H, W, 3)
    variance: float  # mean over pixels and channels of the squared standard error of `image`


@dataclass(frozen=True)
class Errors:
    """The errors of one sampler at one spp."""

    squared: np.ndarray  # (seeds,) mean square error of each image, less the reference's variance
    seconds: float  # median CPU time of an image

    def cost(self) -> float:
        """Return RMSE × √(CPU seconds)."""
        return float(np.sqrt(self.squared.mean() * self.seconds))


class Renderer:
    """Render one scene with any sampler and number of samples."""

    def __init__(self, options: argparse.Namespace) -> None:
        self.scene: Any = load(options.scene, options.width, options.height)
        self.max_depth: int | None = options.max_depth

    def __call__(self, seed: int, spp: int, sampler: str) -> np.ndarray:
        """Return the image (H, W, 3) of one seed."""
        import jaxrt

        return np.asarray(jaxrt.render(self.scene, seed, spp=spp, max_depth=self.max_depth, sampler=sampler))


def make_reference(render: Renderer, spp: int, seeds: int, progress: Progress) -> Reference:
    """Return the mean of `seeds` Sobol' images of `spp` samples, with its variance from their spread."""
    numbers = progress.track(range(REFERENCE_SEED, REFERENCE_SEED + seeds), description="reference")
    images = np.stack([render(seed, spp, "sobol") for seed in numbers]).astype(np.float64)
    return Reference(images.mean(axis=0), float(images.var(axis=0, ddof=1).mean() / seeds))


def measure(render: Renderer, spp: int, seeds: int, reference: Reference, progress: Progress) -> dict[str, Errors]:
    """Return the errors of each sampler at `spp`; samplers alternate: drift hits all alike."""
    for sampler in SAMPLERS:
        render(seeds, spp, sampler)
    squared: dict[str, list[float]] = {sampler: [] for sampler in SAMPLERS}
    seconds: dict[str, list[float]] = {sampler: [] for sampler in SAMPLERS}
    for seed in progress.track(range(seeds), description=f"{spp} spp"):
        for sampler in SAMPLERS:
            image: list[np.ndarray] = []
            cost = clocked(lambda s=sampler, seed=seed, image=image: image.append(render(seed, spp, s)))
            seconds[sampler].append(cost["cpu"])
            error = float(((image[0].astype(np.float64) - reference.image) ** 2).mean())
            squared[sampler].append(error - reference.variance)
    return {s: Errors(np.array(squared[s]), float(np.median(seconds[s]))) for s in SAMPLERS}


def bootstrap_range(errors: Errors, base: Errors) -> tuple[float, float]:
    """Return the central 90 % of the cost ratio when seeds are drawn again with replacement (Efron 1979)."""
    generator = np.random.default_rng(0)
    picks = generator.integers(0, len(errors.squared), (2, RESAMPLES, len(errors.squared)))
    ratios = errors.squared[picks[0]].mean(axis=1) / base.squared[picks[1]].mean(axis=1)
    low, high = np.quantile(np.sqrt(np.maximum(ratios, 0) * errors.seconds / base.seconds), [0.05, 0.95])
    return float(low), float(high)


def add_rows(table: Table, spp: int, errors: dict[str, Errors], reference: Reference) -> None:
    """Add one row for each sampler at one spp."""
    base = errors["independent"]
    for sampler, e in errors.items():
        mse = float(e.squared.mean())
        low, high = bootstrap_range(e, base)
        table.add_row(
            str(spp),
            sampler,
            f"{np.sqrt(mse):.5f}",
            f"{100 * reference.variance / mse:.1f} %",
            f"{e.seconds:.2f}",
            f"{np.sqrt(mse / base.squared.mean()):.3f}",
            f"{e.cost() / base.cost():.3f} ({low:.3f}–{high:.3f})",
        )


def arguments() -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(description="Compare the samplers at equal CPU time.")
    parser.add_argument("--scene", default="scenes/room.toml")
    for name in ("width", "height", "max-depth"):
        parser.add_argument(f"--{name}", type=int, help="default: the scene's")
    parser.add_argument("--spp", type=int, nargs="+", default=[16, 64, 256])
    parser.add_argument("--seeds", type=int, default=16)
    parser.add_argument("--reference-spp", type=int, default=1024, help="spp of each reference image")
    parser.add_argument("--reference-seeds", type=int, default=8, help="reference images")
    parser.add_argument("--cores", type=int, default=os.cpu_count())
    return parser.parse_args()


def main() -> None:
    """Measure, and print the table."""
    options, console = arguments(), wide_console()
    use_cores(options.cores)
    render = Renderer(options)
    columns = ("spp", "sampler", "RMSE", "reference's share", "CPU s", "RMSE ratio", "RMSE × √time (90 %)")
    table = Table(*columns, title=f"{options.scene}, {options.seeds} seeds, ratios to independent")
    with Progress(console=console, transient=True) as progress:
        reference = make_reference(render, options.reference_spp, options.reference_seeds, progress)
        for spp in options.spp:
            errors = measure(render, spp, options.seeds, reference, progress)
            add_rows(table, spp, errors, reference)
    samples, error = options.reference_spp * options.reference_seeds, np.sqrt(reference.variance)
    console.print(cpu_model())
    console.print(f"reference: {samples} samples a pixel, RMS standard error {error:.5f}")
    console.print(table)


if __name__ == "__main__":
    main()
