"""`jaxrt merge`."""

import argparse

from jaxrt.cli.errors import UsageError, refusing
from jaxrt.cli.saving import save_picture
from jaxrt.cli.start import check_output
from jaxrt.io.partial import MACHINE, merged, read_partial


def run(args: argparse.Namespace) -> int:
    """Write the picture that parts make up, and return the exit status."""
    check_output(args.output)
    if len(set(args.parts)) < len(args.parts):
        raise UsageError("merge: a file is named twice: name each once")
    with refusing():
        parts = {path: read_partial(path) for path in args.parts}
        total = merged(parts)
    status = save_picture(args.output, total.picture(), args.exposure, args.srgb)
    machines = {part.facts.get(MACHINE) for part in parts.values()}
    alike = "" if len(machines) == 1 else ", of different processors: right to 1e-6, not to the bit"
    print(f"{args.output}: {total.end} spp from {len(parts)} files{alike}")
    return status
