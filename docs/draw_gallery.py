"""Draw the gallery: run every `jaxrt` command of docs/gallery.md, from the project's root."""

import re
import shlex
from pathlib import Path

from jaxrt.cli import main

GALLERY = Path(__file__).with_name("gallery.md")


def commands() -> list[list[str]]:
    """Return the arguments of each command in the gallery."""
    return [shlex.split(line) for line in re.findall(r"^jaxrt (.*)$", GALLERY.read_text(), re.MULTILINE)]


if __name__ == "__main__":
    for arguments in commands():
        if status := main(arguments):
            raise SystemExit(status)
