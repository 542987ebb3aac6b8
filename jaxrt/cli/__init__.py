"""The command line: `jaxrt example`, `render`, `info`, `diff`, `merge`, `gradcheck` and `fit`."""

import importlib
import os
import sys
from collections.abc import Sequence

from jaxrt.cli.arguments import parser
from jaxrt.cli.errors import told
from jaxrt.cli.signals import NOTHING, leaving, raising, status_of
from jaxrt.cli.streams import patient_streams


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status.

    0: done. 1: a gradient differs from finite differences, or noise leaves it open; a fit is stalled or ambiguous.
    2: bad scene or arguments, told in one line on stderr; nothing is written. 3: a picture that is elsewhere than asked
    for, or has pixels that are not finite. 4: another host is lost. 70: a fault of jaxrt's own, in one line. 128 + n:
    ended by signal n (130 Ctrl-C, 143 TERM, 129 HUP). At 4 and by signals `render` and `fit` write what they have.
    """
    # What XLA says of its own affairs looks like a crash; read when it is loaded
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    with patient_streams():
        try:
            with leaving():
                words = sys.argv[1:] if argv is None else argv
                args = parser().read(words)
                args.words = list(words)
                command = importlib.import_module(f"jaxrt.cli.commands.{args.command}")
            with raising():
                return command.run(args) or 0
        except KeyboardInterrupt as interrupt:
            print(NOTHING, file=sys.stderr)
            return status_of(interrupt)
        except Exception as error:
            return told(error)
