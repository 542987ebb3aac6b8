"""What both halves of `benchmarks.textures` are asked: a texture, sought by Adam. Imports nothing large."""

import argparse
import math

TOLD = 10  # how often, along the way, it is told how far they are
LAST = 0.1  # share of the rate that the last step has


def texture_parser() -> argparse.ArgumentParser:
    """Return the parser of a half's command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("scene")
    parser.add_argument("visible", help=".npy file: which texels count, (rows, columns)")
    for name, default in (("width", 128), ("height", 176), ("spp", 1), ("target-spp", 1024), ("steps", 1000)):
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--max-depth", type=int)
    parser.add_argument("--rates", type=float, nargs="+", required=True)
    parser.add_argument("--texels", help=".npy file: the truth, (rows, columns, 3); default: the scene's own")
    parser.add_argument("--more", type=int, default=0, help="steps after all others, at the last one's rate")
    return parser


def rate_at(step: int, rate: float, options: argparse.Namespace) -> float:
    """Return the rate of a step, counted from 0, that falls along a cosine."""
    return float(rate * (LAST + (1 - LAST) * 0.5 * (1 + math.cos(math.pi * min(step / options.steps, 1)))))


def told_after(step: int, options: argparse.Namespace) -> bool:
    """Return whether after that many steps it is told how far they are."""
    return step % max(1, options.steps // TOLD) == 0 and (step <= options.steps or step == options.steps + options.more)
