"""Text of mesh files: decoded once, at the door, and turned into numbers by NumPy."""

import codecs
import re
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jaxrt.description.mesh_facts import Floats

_MARKS = ((codecs.BOM_UTF8, "utf-8"), (codecs.BOM_UTF16_LE, "utf-16-le"), (codecs.BOM_UTF16_BE, "utf-16-be"))
_NUMBER = re.compile(r"[-+]?(?:(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|inf|infinity|nan)", re.ASCII | re.IGNORECASE)
_IS_BLANK = np.isin(np.arange(256), list(b" \t\n\v\f\r\x1c\x1d\x1e\x1f"))  # bytes that `str.split` takes for space
_FORTRAN = re.compile(r"\d\.?[dD][-+]?\d")


class BadRow(ValueError):
    """A row of text that does not hold the numbers asked for. `row` says which."""

    def __init__(self, row: int):
        super().__init__(f"row {row} holds no numbers")
        self.row = row


def decode(data: bytes) -> str:
    """Return the text of a file, its lines ended by a line feed each.

    UTF-8 with or without a byte order mark, UTF-16 by its mark, else Latin-1, in which all bytes mean something.
    """
    for mark, encoding in _MARKS:
        if data.startswith(mark):
            text = data[len(mark) :].decode(encoding, errors="replace")
            break
    else:
        try:
            text = data.decode("utf-8")
        except UnicodeDecodeError:
            text = data.decode("latin-1")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def floats(rows: Sequence[str], columns: int) -> Floats:
    """Return the first numbers (n, columns) of each row of text. Raises BadRow where there are not as many."""
    if not rows:
        return np.zeros((0, columns))
    try:
        with warnings.catch_warnings():
            # Of rows without any word, which it passes over
            warnings.simplefilter("ignore")
            table = np.loadtxt(rows, usecols=range(columns), comments=None, ndmin=2)
    except ValueError:
        table = np.zeros((0, columns))
    if len(table) == len(rows):
        return table
    for i, row in enumerate(rows):
        words = row.split()[:columns]
        if len(words) < columns or not all(map(_NUMBER.fullmatch, words)):
            raise BadRow(i)
    return np.array([[float(word) for word in row.split()[:columns]] for row in rows])


def numbers(words: str, count: int, kind: type[np.generic]) -> NDArray[Any] | None:
    """Return the numbers (count,) of a `kind` that stand in a text, None where it holds anything else."""
    if not count:
        return np.zeros(0, kind) if not words.strip() else None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)
            found = np.fromstring(words, kind, sep=" ")
    except (ValueError, DeprecationWarning):
        return None
    # A sign parts two numbers as well as a space does: count the words too
    return found if len(found) == count == len(words.split()) else None


def counts_of_words(rows: Sequence[str]) -> NDArray[np.int64]:
    """Return how many words each row of text has."""
    text = "\n".join([*rows, ""])
    if not rows or not text.isascii():
        return np.array([len(row.split()) for row in rows], np.int64)
    data = np.frombuffer(text.encode(), np.uint8)
    blank = _IS_BLANK[data]
    begins = ~blank
    begins[1:] &= blank[:-1]
    ends = np.flatnonzero(data == ord("\n"))
    counts: NDArray[np.int64] = np.add.reduceat(begins, np.append(0, ends[:-1] + 1), dtype=np.int64)
    return counts


def is_count(word: str) -> bool:
    """Return whether a word is a whole number of a size that counts can have."""
    return word.isascii() and word.isdigit() and len(word) <= 15


def number_hint(words: str, otherwise: str) -> str:
    """Return what to do about numbers that are none."""
    if "," in words:
        return "write decimals with a point"
    return "write exponents with e" if _FORTRAN.search(words) else otherwise
