"""The arguments of every command, and what they may be. Nothing here imports JAX or NumPy: help is at once."""

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from jaxrt.cli.errors import UsageError
from jaxrt.core.messages import show

COUNT_MAX = 2**31 - 1
SEED_MAX = 2**32 - 1


class Parser(argparse.ArgumentParser):
    """A parser that refuses in one line."""

    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message}: see {self.prog} --help")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse; a list of names ends where a file is named, so that it may stand before SCENE and TARGET."""
        return super().parse_known_args(_files_first(args) if "--parameters" in (args or ()) else args, namespace)


def parser() -> argparse.ArgumentParser:
    """Return the parser of all commands; `command` is the name of the module of this folder that runs it."""
    top = Parser(prog="jaxrt", description="A differentiable path tracer.", allow_abbrev=False)
    commands = top.add_subparsers(required=True, metavar="COMMAND", dest="command")
    for add, name, text in (
        (_add_render, "render", "render a scene file to a picture"),
        (_add_merge, "merge", "add what render --samples has drawn to one picture"),
        (_add_info, "info", "tell what is in a scene file"),
        (_add_diff, "diff", "compare two pictures"),
        (_add_gradcheck, "gradcheck", "compare a gradient with finite differences"),
        (_add_fit, "fit", "recover parameters from a picture"),
    ):
        add(commands.add_parser(name, help=text, allow_abbrev=False))
    return top


def _add_scene(parser: argparse.ArgumentParser, text: str = "scene file (TOML)") -> None:
    parser.add_argument("scene", type=Path, metavar="SCENE", help=text)
    parser.add_argument(
        "--allow-folder", type=Path, action="append", default=[], metavar="DIR", help="where more meshes may lie"
    )


def _add_render(parser: argparse.ArgumentParser) -> None:
    count, seed = _integer(1, COUNT_MAX), _integer(0, SEED_MAX)
    _add_scene(parser)
    parser.add_argument("-o", "--output", type=Path, help="picture (.png or .exr); SCENE's name with .png")
    parser.add_argument("--spp", type=count, metavar="N", help="samples per pixel")
    parser.add_argument("--max-depth", type=count, metavar="D", help="scattering events along a path")
    parser.add_argument("--width", type=count, metavar="W", help="columns")
    parser.add_argument("--height", type=count, metavar="H", help="rows")
    parser.add_argument("--seed", type=seed, default=0, metavar="S", help="of the random numbers (0)")
    parser.add_argument("--sampler", default="sobol", metavar="NAME", help="sobol, stratified or independent")
    parser.add_argument("--cores", type=count, metavar="N", help="CPU cores (all)")
    parser.add_argument("--exposure", type=_real, default=0.0, metavar="EV", help="brighten by 2**EV (0)")
    parser.add_argument("--srgb", action="store_true", help="write PNG by the sRGB curve, not gamma 2.2")
    parser.add_argument("--resume", action="store_true", help="go on from OUTPUT.partial, which an interruption left")
    parser.add_argument("--samples", type=_range, metavar="A:B", help="draw only these of the --spp, for jaxrt merge")


def _add_merge(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("parts", type=Path, nargs="+", metavar="PART", help="what render --samples wrote (.partial)")
    parser.add_argument("-o", "--output", type=Path, required=True, help="picture (.png or .exr)")
    parser.add_argument("--exposure", type=_real, default=0.0, metavar="EV", help="brighten by 2**EV (0)")
    parser.add_argument("--srgb", action="store_true", help="write PNG by the sRGB curve, not gamma 2.2")


def _add_info(parser: argparse.ArgumentParser) -> None:
    _add_scene(parser)


def _add_diff(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("a", type=Path, metavar="A", help="picture (.png or .exr)")
    parser.add_argument("b", type=Path, metavar="B", help="the reference")
    parser.add_argument("-o", "--output", type=Path, default=Path("diff.png"), help="error picture (diff.png)")
    parser.add_argument("--srgb", action="store_true", help="PNG holds the sRGB curve, not gamma 2.2")


def _add_gradcheck(parser: argparse.ArgumentParser) -> None:
    count, seed = _integer(1, COUNT_MAX), _integer(0, SEED_MAX)
    _add_scene(parser)
    parser.add_argument("parameter", metavar="NAME[ROW]", help="such as lights.position[0] or materials.albedo[white]")
    parser.add_argument("-o", "--output", type=Path, help="picture: finite differences | interior only | with edges")
    parser.add_argument("--spp", type=count, metavar="N", help="samples per pixel (256)")
    parser.add_argument("--max-depth", type=count, metavar="D", help="scattering events along a path")
    parser.add_argument("--width", type=count, metavar="W", help="columns (the longer side has 64 pixels)")
    parser.add_argument("--height", type=count, metavar="H", help="rows")
    parser.add_argument("--boundary-samples", type=_integer(0, COUNT_MAX), metavar="N", help="on edges (4 a pixel)")
    parser.add_argument("--component", type=_integer(0, 2), metavar="I", help="of a vector: 0, 1 or 2 (all)")
    parser.add_argument("--step", type=float, metavar="H", help="of the finer difference (about 1 %% of what matters)")
    parser.add_argument("--seeds", type=_integer(2, COUNT_MAX), default=8, metavar="N", help="for error bars (8)")
    parser.add_argument("--seed", type=seed, default=0, metavar="S", help="of the random numbers (0)")
    parser.add_argument("--cores", type=count, metavar="N", help="CPU cores (all)")


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


def _add_fit(parser: argparse.ArgumentParser) -> None:
    count, seed = _integer(1, COUNT_MAX), _integer(0, SEED_MAX)
    _add_scene(parser, "scene file (TOML), with the values to start from")
    parser.add_argument("target", type=Path, metavar="TARGET", help="the picture to match: .exr, or .png (linearised)")
    parser.add_argument("--parameters", nargs="+", required=True, metavar="NAME[ROW]", help="what to recover")
    parser.add_argument("-o", "--output", type=Path, help="folder of the results (SCENE's name with _fit)")
    parser.add_argument("--spp", type=count, metavar="N", help="samples per pixel of the last stage")
    parser.add_argument("--max-depth", type=count, metavar="D", help="scattering events along a path")
    parser.add_argument("--max-steps", type=count, default=60, metavar="N", help="of the solver (60)")
    parser.add_argument("--starts", type=count, default=1, metavar="N", help="starts to choose the best of (1)")
    parser.add_argument("--seed", type=seed, default=0, metavar="S", help="of the random numbers (0)")
    parser.add_argument("--cores", type=count, metavar="N", help="CPU cores (all)")
    parser.add_argument("--srgb", action="store_true", help="a PNG holds the sRGB curve, not gamma 2.2")
    parser.add_argument("--resume", action="store_true", help="go on from the output folder's fit.json")


def _integer(low: int, high: int) -> Callable[[str], int]:
    def convert(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{show(text)} is not a whole number") from None
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{show(value)} is out of range, use {low} to {high}")
        return value

    return convert


def _range(text: str) -> tuple[int, int]:
    first, colon, end = text.partition(":")
    whole = _integer(0, COUNT_MAX)
    if not colon or not whole(first) < whole(end):
        raise argparse.ArgumentTypeError(f"{show(text)} is no range: write FIRST:END, such as 0:512")
    return whole(first), whole(end)


def _real(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{show(text)} is not a number") from None
    if not abs(value) <= 100:
        raise argparse.ArgumentTypeError(f"{text[:60]} is out of range, use -100 to 100 stops")
    return value
