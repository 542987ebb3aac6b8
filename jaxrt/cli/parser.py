"""How arguments are read: refusals in one line with the nearest name, and the versions."""

import argparse
import difflib
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

from jaxrt.cli.errors import UsageError
from jaxrt.core.messages import nearest

COLUMN = 30  # where help texts begin at the latest
ALIKE = 0.7  # of difflib, for an option to be what was meant
ELSEWHERE = {  # what other programs call it
    "--size": "--width and --height",
    "--resolution": "--width and --height",
    "--threads": "--cores",
    "--jobs": "--cores",
    "-j": "--cores",
    "--bounces": "--max-depth",
    "--depth": "--max-depth",
    "--samples-per-pixel": "--spp",
    "-n": "--spp",
    "-s": "--spp",
    "--format": "-o with another suffix",
    "--gpu": "the variable JAX_PLATFORMS",
    "--device": "the variable JAX_PLATFORMS",
}


class Parser(argparse.ArgumentParser):
    """A parser that refuses in one line."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options, allow_abbrev=False, formatter_class=_Formatter)
        self.commands: Mapping[str, Parser] = {}

    def error(self, message: str) -> NoReturn:
        choice = re.fullmatch(r"(.*invalid choice: '(.*)') \(choose from (.*)\)", message, re.DOTALL)
        if choice:
            message = choice[1] + nearest(choice[2], re.findall(r"[\w-]+", choice[3]))
        raise UsageError(f"{message}: see {self.prog} --help")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse; a list of names ends where a file is named, so that it may stand before SCENE and TARGET."""
        return super().parse_known_args(_files_first(args) if "--parameters" in (args or ()) else args, namespace)

    def read(self, argv: Sequence[str]) -> argparse.Namespace:
        """Return the arguments; the command's own parser refuses what is left of them. `help X` is `X --help`."""
        first = argv[0] if argv else ""
        if first == "help":
            argv = [*(name for name in argv[1:2] if name != first), "--help"]
        elif first.startswith("-") and first not in self._known():
            self.error(f"unrecognized arguments: {first}: options come after the command")
        found, left = self.parse_known_args(argv)
        if left:
            self.commands[found.command].refuse(left)
        return found

    def refuse(self, left: Sequence[str]) -> NoReturn:
        """Raise UsageError for arguments that nothing takes."""
        name = left[0].partition("=")[0]
        near = difflib.get_close_matches(name, self._known(), n=1, cutoff=ALIKE)
        if name.startswith("-"):
            meant = ELSEWHERE.get(name) or "".join(near)
        else:
            meant = f"-o {name}" if Path(name).suffix in (".png", ".exr") and "-o" in self._known() else ""
        self.error(f"unrecognized arguments: {' '.join(left)}{f' (did you mean {meant}?)' if meant else ''}")

    def _known(self) -> list[str]:
        return re.findall(r"(?<![\w-])--?[a-zA-Z][a-z-]*", self.format_usage() + self.format_help())


class Version(argparse.Action):
    """Print the versions that tell one installation from another."""

    def __call__(self, parser: argparse.ArgumentParser, *values: object) -> NoReturn:
        import platform
        from importlib.metadata import PackageNotFoundError, version

        def of(package: str) -> str:
            try:
                return version(package)
            except PackageNotFoundError:
                return "not installed"

        print(f"jaxrt {of('jaxrt')} (jax {of('jax')}, jaxlib {of('jaxlib')}, Python {platform.python_version()})")
        parser.exit()


def _files_first(words: Sequence[str]) -> list[str]:
    """Return the words with the files among the names that follow `--parameters` moved to before it."""
    ordered: list[str] = []
    place: int | None = None  # of the option, while its names go on
    for word in words:
        if word == "--parameters":
            place = len(ordered)
        elif word.startswith("-"):
            place = None
        if place is not None and Path(word).suffix.lower() in (".toml", ".exr", ".png"):
            ordered.insert(place, word)
            place += 1
        else:
            ordered.append(word)
    return ordered


class _Formatter(argparse.RawDescriptionHelpFormatter):
    def __init__(self, prog: str) -> None:
        super().__init__(prog, max_help_position=COLUMN)
