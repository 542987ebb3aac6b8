"""What both halves of `benchmarks.adam` are asked: a picture's size, samples, steps. Imports nothing large."""

import argparse


def adam_parser() -> argparse.ArgumentParser:
    """Return the parser of a half's command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("scene")
    for name, default in (("width", 64), ("height", 64), ("spp", 8), ("target-spp", 64), ("steps", 100)):
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--max-depth", type=int)
    parser.add_argument("--rate", type=float, default=0.02)
    return parser
