"""The command line: `jaxrt render`, `jaxrt info`, `jaxrt diff`, `jaxrt gradcheck`, `jaxrt fit`."""

import importlib
import os
import sys
from collections.abc import Sequence

from jaxrt.cli.arguments import parser
from jaxrt.cli.errors import print_anything, told


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status.

    0: done. 1: a gradient differs from finite differences, or noise leaves it open; a fit is stalled or ambiguous.
    2: bad scene or arguments, told in one line on stderr. 70: a fault of jaxrt's own, likewise. 130: interrupted.
    Only 0, 1 and interrupted fits write files.
    """
    # What XLA says of its own affairs looks like a crash; read when it is loaded
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    print_anything()
    try:
        args = parser().parse_args(argv)
        return importlib.import_module(f"jaxrt.cli.{args.command}").run(args) or 0
    except KeyboardInterrupt:
        print("jaxrt: interrupted, nothing written", file=sys.stderr)
        return 130
    except Exception as error:
        return told(error)
