"""Part of a picture: the exact sums of some of its samples, in memory and in a file.

A file is a line that says what it is, a line of JSON (facts, range, checksum), then the sums as little-endian float64,
high parts before low parts. Nothing in it is code; it is no longer than its first lines say.
"""

import hashlib
import json
import os
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from jaxrt.core.maths import two_sum
from jaxrt.core.messages import nearest, show
from jaxrt.core.writing import write_whole

SUFFIX = ".partial"
MAGIC = b"jaxrt partial 1\n"
HEADER = 1 << 16  # bytes that a header may have
CACHED = 1 << 13  # pixels
MACHINE = "machine"  # the one fact in which parts may differ: other processors round otherwise

Sums = NDArray[np.float64]
Facts = dict[str, str | int]  # what determines every sample: scene, seed, sampler, …, in the order they are compared in


class PartialError(ValueError):
    """A file of sums that cannot be used: one line with file, what is wrong, and the remedy."""


@dataclass(frozen=True)
class Partial:
    """Sums of samples first … end − 1 of each pixel. They do not depend on how the samples came together."""

    facts: Facts
    first: int
    end: int
    high: Sums  # (height, width, 3) the sum, rounded
    low: Sums  # (height, width, 3) what the rounding left out: together over 100 bits

    @classmethod
    def nothing(cls, facts: Facts, first: int) -> "Partial":
        """Return the sum of no samples."""
        zeros = np.zeros((int(facts["height"]), int(facts["width"]), 3))
        return cls(facts, first, first, zeros, zeros)

    def plus(self, end: int, *terms: NDArray[Any]) -> "Partial":
        """Return the sum up to sample `end`, given what to add."""
        high, low = np.empty_like(self.high), np.empty_like(self.low)
        # As many rows at a time as the cache holds: the sum takes 36 operations a number
        step = max(1, CACHED // self.high.shape[1])
        for first in range(0, len(high), step):
            rows = slice(first, first + step)
            high[rows], low[rows] = _added(self.high[rows], self.low[rows], [term[rows] for term in terms])
        return replace(self, end=end, high=high, low=low)

    def picture(self) -> NDArray[np.float32]:
        """Return the mean of the samples, in the arithmetic of `jaxrt.render`."""
        with np.errstate(over="ignore"):
            return self.high.astype(np.float32) * np.float32(1 / (self.end - self.first))

    def write(self, path: Path) -> None:
        """Write the file, whole or not at all."""
        head = {"facts": self.facts, "first": self.first, "end": self.end}
        data = np.stack([self.high, self.low]).astype("<f8").tobytes()
        line = json.dumps(head | {"sha256": _checksum(head, data)}).encode() + b"\n"
        write_whole(path, lambda file: file.write(MAGIC + line + data))


def _added(high: Sums, low: Sums, terms: Iterable[NDArray[Any]]) -> tuple[Sums, Sums]:
    with np.errstate(invalid="ignore", over="ignore"):  # pixels that are not finite are told of at the end
        for term in terms:
            high, rest = two_sum(high, np.asarray(term, np.float64))
            high, low = two_sum(high, low + rest)
    return high, low


def read_partial(path: Path) -> Partial:
    """Return the sums in a file. Raises PartialError where it holds none, or others than were written."""
    try:
        if path.exists() and not path.is_file():
            raise PartialError(f"{path}: is no file: take one that --samples wrote")
        with path.open("rb") as file:
            # The open file's size: another process may put a newer one in its place at any time
            head, data = _read(file, os.fstat(file.fileno()).st_size)
        shape = 2, int(head["facts"]["height"]), int(head["facts"]["width"]), 3
        whole = head.pop("sha256") == _checksum(head, data)
    except FileNotFoundError:
        names = [p.name for p in path.parent.glob(f"*{SUFFIX}")]
        hint = nearest(path.name, names) if names else ""
        raise PartialError(f"{path}: no such file{hint}: check the path") from None
    except OSError as error:
        raise PartialError(f"{path}: cannot be read ({error.strerror or error}): check the file") from None
    except PartialError:
        raise
    except (ValueError, KeyError, TypeError, RecursionError):
        raise PartialError(f"{path}: holds no sums of samples: take a file that --samples wrote") from None
    if not whole or len(data) != 48 * shape[1] * shape[2]:
        raise PartialError(f"{path}: is damaged: remove it, and draw its samples again")
    high, low = np.frombuffer(data, "<f8").reshape(shape)
    return Partial(head["facts"], head["first"], head["end"], high.astype(np.float64), low.astype(np.float64))


def difference(a: Facts, b: Facts) -> str | None:
    """Return the first fact that differs, in words, or None. The machine may differ."""
    for name in {**a, **b}:
        if name != MACHINE and a.get(name) != b.get(name):
            if name in ("scene", "code"):
                return f"another {name}" if name == "scene" else "another version of jaxrt"
            return f"{name} {show(a.get(name))}, not {show(b.get(name))}"
    return None


def merged(parts: dict[Path, Partial]) -> Partial:
    """Return the sum of parts that make up a whole picture. Raises PartialError for gaps, overlaps, other scenes."""
    ordered = sorted(parts.items(), key=lambda item: (item[1].first, item[1].end))
    (path, total), spp = ordered[0], int(ordered[0][1].facts["spp"])
    total = Partial.nothing(total.facts, 0)
    for other, part in ordered:
        differs = difference(part.facts, total.facts)
        if differs:
            raise PartialError(f"{other}: {differs} as in {path}: merge parts of one picture")
        if part.first < total.end:
            twice = f"{part.first}:{min(part.end, total.end)}"
            raise PartialError(f"{other}: samples {twice} are in {path} too: leave one of them out")
        if part.first > total.end:
            raise PartialError(_gap(total.end, part.first))
        path, total = other, total.plus(part.end, part.high, part.low)
    if total.end != spp:
        raise PartialError(_gap(total.end, spp))
    return total


def _gap(first: int, end: int) -> str:
    return f"samples {first}:{end} are missing: draw them with --samples {first}:{end}"


def _read(file: BinaryIO, size: int) -> tuple[dict[str, Any], bytes]:
    """Return header and data of a file of `size` bytes, no data where it has not as much as the header announces."""
    if file.read(len(MAGIC)) != MAGIC:
        raise ValueError
    head = json.loads(file.readline(HEADER))
    facts = head["facts"]
    samples = head["first"], head["end"], facts["spp"]
    if not all(isinstance(n, int) for n in samples) or not 0 <= samples[0] <= samples[1] <= samples[2]:
        raise ValueError
    width, height = facts["width"], facts["height"]
    if not (isinstance(width, int) and isinstance(height, int) and width > 0 and height > 0):
        raise ValueError
    return head, file.read() if size - file.tell() == 48 * width * height else b""


def _checksum(head: dict[str, Any], data: bytes) -> str:
    digest = hashlib.sha256(json.dumps(head).encode())
    digest.update(data)
    return digest.hexdigest()
