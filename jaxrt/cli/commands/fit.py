"""`jaxrt fit`."""

import argparse
from pathlib import Path

from jaxrt.cli.errors import refusing
from jaxrt.cli.places import check_folder
from jaxrt.core.extras import require


def run(args: argparse.Namespace) -> int:
    """Fit and return the exit status."""
    # Before anything large is loaded
    require("fit", "optimistix", "tomlkit", "matplotlib")
    args.output = args.output or Path(f"{args.scene.stem}_fit")
    check_folder(args.output)
    from jaxrt.cli import start
    from jaxrt.fit.command import run_fit

    start.start_jax(start.present(args.cores))
    start.check_devices()
    with refusing():
        return run_fit(args)
