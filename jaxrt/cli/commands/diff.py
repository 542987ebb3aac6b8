"""`jaxrt diff`."""

import argparse
import math

import numpy as np

from jaxrt.cli.errors import UsageError, refusing
from jaxrt.cli.start import check_output
from jaxrt.io.image import load_image, save_image

RELATIVE_FLOOR = 1e-2  # added to the squared reference in the relative MSE, so that black pixels do not rule it


def run(args: argparse.Namespace) -> None:
    """Print how two pictures differ, and write a picture of where."""
    check_output(args.output)
    with refusing():
        a, b = (load_image(path, srgb=args.srgb).astype(np.float64) for path in (args.a, args.b))
    if a.shape != b.shape:
        sizes = " and ".join(f"{image.shape[1]}x{image.shape[0]}" for image in (a, b))
        raise UsageError(f"{args.a}, {args.b}: sizes differ, {sizes}: render both in one size")
    error = np.abs(a - b)
    worst = float(error.max())
    i, j, _ = np.unravel_index(error.argmax(), error.shape)
    with refusing():
        save_image(args.output, error / worst if worst > 0 else error)
    print(f"RMSE          {math.sqrt(np.mean(error**2)):.6g}")
    print(f"relative MSE  {np.mean(error**2 / (b**2 + RELATIVE_FLOOR)):.6g}")
    print(f"max error     {worst:.6g} at column {j}, row {i}")
    print(f"error picture {args.output}, |A - B|, white = {worst:.6g}")
