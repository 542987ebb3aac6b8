"""`jaxrt fit`."""

import argparse
from pathlib import Path

from jaxrt.cli import start
from jaxrt.cli.errors import refusing
from jaxrt.cli.places import check_folder
from jaxrt.cli.start import present, usable_cores
from jaxrt.fit.command import run_fit


def run(args: argparse.Namespace) -> int:
    """Fit and return the exit status."""
    args.output = args.output or Path(f"{args.scene.stem}_fit")
    check_folder(args.output)
    start.start_jax(present(args.cores or usable_cores()))
    start.check_devices()
    with refusing():
        return run_fit(args)
