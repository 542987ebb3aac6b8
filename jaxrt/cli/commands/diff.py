"""`jaxrt diff`."""

import argparse
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from jaxrt.cli.errors import UsageError, refusing
from jaxrt.cli.start import check_output
from jaxrt.io.image import load_image, save_image

RELATIVE_FLOOR = 1e-2  # added to the squared reference in the relative MSE, so that black pixels do not rule it

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]  # (H, W)


def run(args: argparse.Namespace) -> None:
    """Print how two pictures differ, and with -o write a picture of where."""
    if args.output is not None:
        _check_output(args)
    paths = (args.a, args.b)
    with refusing():
        a, b = (load_image(path, srgb=args.srgb).astype(np.float64) for path in paths)
    if a.shape != b.shape:
        sizes = " and ".join(f"{image.shape[1]}x{image.shape[0]}" for image in (a, b))
        raise UsageError(f"{args.a}, {args.b}: sizes differ, {sizes}: render both in one size")
    clipped = _clipped(paths, a, b)
    broken: Mask = np.any(~np.isfinite(a + b), axis=-1)
    compared = ~(clipped | broken)
    if not compared.any():
        raise UsageError(f"{args.a}, {args.b}: no pixel is left to compare, all are {_reasons(clipped, broken)}")
    error = np.where(compared[..., None], np.abs(a - b), 0)
    worst = float(error.max())
    if args.output is not None:
        with refusing():
            save_image(args.output, error / worst if worst > 0 else error)
    _tell(error[compared], b[compared])
    i, j, _ = np.unravel_index(error.argmax(), error.shape)
    print(f"max error     {worst:.6g} at column {j}, row {i}")
    if not compared.all():
        print(f"left out      {compared.size - compared.sum()} of {compared.size} pixels: {_reasons(clipped, broken)}")
    if clipped.any():
        print(f"              clipped alike, they differ by up to {_apart(a, b, clipped & ~broken):.6g}")
    if args.output is not None:
        print(f"error picture {args.output}, |A - B|, white = {worst:.6g}")


def _check_output(args: argparse.Namespace) -> None:
    check_output(args.output, "error.png")
    for path in (args.a, args.b):
        if args.output.exists() and path.exists() and args.output.samefile(path):
            raise UsageError(f"{args.output}: is one of the pictures to compare: choose another name")


def _clipped(paths: tuple[Path, Path], a: Floats, b: Floats) -> Mask:
    """Return which pixels a PNG holds 0 or 255 of in some channel, where the other file holds what is beyond."""
    png = [path.suffix.lower() == ".png" for path in paths]
    if all(png):
        return np.zeros(a.shape[:2], bool)
    return np.any([((x <= 0) | (x >= 1)).any(-1) & is_png for x, is_png in zip((a, b), png, strict=True)], axis=0)


def _apart(a: Floats, b: Floats, clipped: Mask) -> float:
    """Return by how much the clipped pixels differ even if the other file's are clipped too."""
    return float(np.abs(np.clip(a[clipped], 0, 1) - np.clip(b[clipped], 0, 1)).max(initial=0))


def _reasons(clipped: Mask, broken: Mask) -> str:
    counts = ((clipped, "clipped in the PNG (0 or 255)"), (broken, "not finite"))
    return ", ".join(f"{mask.sum()} {what}" for mask, what in counts if mask.any())


def _tell(error: Floats, reference: Floats) -> None:
    print(f"RMSE          {math.sqrt(np.mean(error**2)):.6g}")
    print(f"relative MSE  {np.mean(error**2 / (reference**2 + RELATIVE_FLOOR)):.6g}")
