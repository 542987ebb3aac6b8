"""The arguments of every command, and what they may be. Nothing here imports JAX or NumPy: help is at once."""

import argparse
from collections.abc import Callable
from pathlib import Path

from jaxrt.cli.parser import Parser, Version
from jaxrt.core.messages import show
from jaxrt.hosts.seats import Seat, hosts_from

COUNT_MAX = 2**31 - 1
SEED_MAX = 2**32 - 1
PROGRAM = "A differentiable Monte-Carlo path tracer: pictures of scenes of spheres and meshes, and their derivatives."
BEGIN = """\
begin with:
  jaxrt example room -o room.toml      a scene file to look at and to change
  jaxrt render room.toml -o room.png   its picture
  jaxrt COMMAND --help                 all that a command can do

exit status: 0 done, 1 a gradient differs or a fit is open, 2 bad input, 3 written elsewhere, 4 a host is lost,
128 + n by signal n"""


def parser() -> Parser:
    """Return the parser of all commands; `command` is the name of the module of this folder that runs it."""
    top = Parser(prog="jaxrt", description=PROGRAM, epilog=BEGIN)
    top.add_argument("-V", "--version", action=Version, nargs=0, help="show the versions of jaxrt, JAX and Python")
    commands = top.add_subparsers(required=True, metavar="COMMAND", dest="command", title="commands")
    for add, name, text, example in (
        (_add_example, "example", "list the scenes that come with jaxrt, or write one", "room -o room.toml"),
        (_add_render, "render", "draw the picture of a scene", "room.toml -o room.png --spp 256"),
        (_add_info, "info", "tell what is in a scene, its parameters and warnings", "room.toml"),
        (_add_diff, "diff", "compare two pictures", "room.png reference.exr"),
        (_add_merge, "merge", "make one picture of ranges of its samples", "a.partial b.partial -o room.exr"),
        (_add_gradcheck, "gradcheck", "compare a derivative with finite differences", 'room.toml "lights.position[0]"'),
        (
            _add_fit,
            "fit",
            "find the parameters that explain a picture",
            "guess.toml seen.exr --parameters lights.position",
        ),
    ):
        sentence, example = f"{text.capitalize()}.", f"example:\n  jaxrt {name} {example}"
        add(commands.add_parser(name, help=text, description=sentence, epilog=example))
    top.commands = commands.choices
    return top


def _add_example(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", nargs="?", metavar="NAME", help="which one to write; without it they are listed")
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="scene file (NAME.toml); its mesh goes beside it"
    )


def _add_scene(parser: argparse.ArgumentParser, text: str = "scene file (TOML); jaxrt example writes one") -> None:
    parser.add_argument("scene", type=Path, metavar="SCENE", help=text)
    parser.add_argument(
        "--allow-folder",
        type=Path,
        action="append",
        default=[],
        metavar="DIR",
        help="where meshes may lie besides the scene's own folder; may be repeated",
    )


def _add_render(parser: argparse.ArgumentParser) -> None:
    count, seed = _integer(1, COUNT_MAX), _integer(0, SEED_MAX)
    _add_scene(parser)
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="picture, .png or .exr (SCENE's name with .png)"
    )
    drawing = parser.add_argument_group("drawing", "The first four are by default as in the scene file.")
    drawing.add_argument("--spp", type=count, metavar="N", help="samples per pixel: four times as many halve the noise")
    drawing.add_argument("--max-depth", type=count, metavar="D", help="scattering events along a path")
    drawing.add_argument("--width", type=count, metavar="W", help="columns")
    drawing.add_argument("--height", type=count, metavar="H", help="rows")
    drawing.add_argument("--camera", type=_integer(0, COUNT_MAX), default=0, metavar="I", help="of [[cameras]] (0)")
    drawing.add_argument("--seed", type=seed, default=0, metavar="S", help="of the random numbers (0)")
    drawing.add_argument(
        "--sampler", default="sobol", metavar="NAME", help="sobol (default), stratified or independent"
    )
    drawing.add_argument("--cores", type=count, metavar="N", help="CPU cores (all)")
    drawing.add_argument(
        "--outputs",
        type=_names,
        default=(),
        metavar="NAME,...",
        help="draw these too, as layers of an EXR or PNGs beside: depth, normal, position, albedo, uv, mask[NAME], "
        "shape, material, sky; with alpha the picture lacks the sky, to be laid over another",
    )
    _add_display(parser)
    long = parser.add_argument_group("long renders")
    long.add_argument("--resume", action="store_true", help="go on from FILE.partial, which an interruption left")
    long.add_argument(
        "--hosts", type=_hosts, metavar="A,B", help="draw on all of these, this one first; auto under a scheduler"
    )
    long.add_argument("--samples", type=_range, metavar="A:B", help="draw only these of the --spp, for jaxrt merge")


def _add_display(parser: argparse.ArgumentParser) -> None:
    display = parser.add_argument_group("display")
    display.add_argument("--exposure", type=_stops, default=0.0, metavar="EV", help="brighten by 2**EV (0)")
    display.add_argument("--srgb", action="store_true", help="write PNG by the sRGB curve, not gamma 2.2")


def _add_merge(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("parts", type=Path, nargs="+", metavar="PART", help="what render --samples wrote (.partial)")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FILE", help="picture, .png or .exr")
    _add_display(parser)


def _add_info(parser: argparse.ArgumentParser) -> None:
    _add_scene(parser)


def _add_diff(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("a", type=Path, metavar="A", help="picture, .png or .exr")
    parser.add_argument(
        "b", type=Path, metavar="B", help="the reference; pixels that are clipped in a PNG are left out"
    )
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help="error picture |A - B|, .png or .exr (none)")
    parser.add_argument("--srgb", action="store_true", help="PNG holds the sRGB curve, not gamma 2.2")


def _add_gradcheck(parser: argparse.ArgumentParser) -> None:
    count, seed = _integer(1, COUNT_MAX), _integer(0, SEED_MAX)
    _add_scene(parser)
    parser.add_argument(
        "parameter", metavar="NAME[ROW]", help='a parameter, as jaxrt info lists them, such as "lights.position[0]"'
    )
    parser.add_argument("-o", "--output", type=Path, help="picture: finite differences | interior only | with edges")
    parser.add_argument("--spp", type=count, metavar="N", help="samples per pixel (256)")
    parser.add_argument("--max-depth", type=count, metavar="D", help="scattering events along a path")
    parser.add_argument("--width", type=count, metavar="W", help="columns (the longer side has 64 pixels)")
    parser.add_argument("--height", type=count, metavar="H", help="rows")
    parser.add_argument("--boundary-samples", type=_integer(0, COUNT_MAX), metavar="N", help="on edges (4 a pixel)")
    parser.add_argument("--component", type=_integer(0, 2), metavar="I", help="of a vector: 0, 1 or 2 (all)")
    parser.add_argument(
        "--step", type=_number, metavar="H", help="of the finer difference (about 1 %% of what matters)"
    )
    parser.add_argument("--seeds", type=_integer(2, COUNT_MAX), default=8, metavar="N", help="for error bars (8)")
    parser.add_argument("--seed", type=seed, default=0, metavar="S", help="of the random numbers (0)")
    parser.add_argument("--cores", type=count, metavar="N", help="CPU cores (all)")


def _add_fit(parser: argparse.ArgumentParser) -> None:
    count, seed = _integer(1, COUNT_MAX), _integer(0, SEED_MAX)
    _add_scene(parser, "scene file (TOML), with the values to start from")
    parser.add_argument(
        "targets",
        type=Path,
        nargs="+",
        metavar="TARGET",
        help="the picture to match: .exr, or .png (linearised); one for each of the scene's [[cameras]]",
    )
    parser.add_argument("--parameters", nargs="+", required=True, metavar="NAME[ROW]", help="what to recover")
    parser.add_argument("-o", "--output", type=Path, help="folder of the results (SCENE's name with _fit)")
    parser.add_argument("--spp", type=count, metavar="N", help="samples per pixel of the last stage")
    parser.add_argument("--max-depth", type=count, metavar="D", help="scattering events along a path")
    parser.add_argument("--max-steps", type=count, default=60, metavar="N", help="of the solver (60)")
    parser.add_argument("--starts", type=count, default=1, metavar="N", help="starts to choose the best of (1)")
    parser.add_argument("--smoothness", type=_number, metavar="S", help="of textures sought, such as 0.01 (none)")
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


def _names(text: str) -> tuple[str, ...]:
    """Return what is listed, at most once each."""
    names = tuple(dict.fromkeys(name.strip() for name in text.split(",")))
    if not all(names):
        raise argparse.ArgumentTypeError(f"{show(text)} is no list: write NAME,NAME, such as depth,normal")
    return names


def _range(text: str) -> tuple[int, int]:
    first, colon, end = text.partition(":")
    whole = _integer(0, COUNT_MAX)
    if not colon or not whole(first) < whole(end):
        raise argparse.ArgumentTypeError(f"{show(text)} is no range: write FIRST:END, such as 0:512; --spp is how many")
    return whole(first), whole(end)


def _hosts(text: str) -> Seat | list[str]:
    try:
        return hosts_from(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{show(text)} is not a number") from None


def _stops(text: str) -> float:
    if not abs(value := _number(text)) <= 100:
        raise argparse.ArgumentTypeError(f"{text[:60]} is out of range, use -100 to 100 stops")
    return value
