"""stdout and stderr that may be closed, break, or lack characters: what is said suffers then, never the work."""

import codecs
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from typing import Any, TextIO

# What stands for characters of jaxrt's own where an encoding lacks them
PLAIN = {"°": " deg", "±": "+-", "²": "^2", "·": "*", "×": "x", "−": "-", "–": "-", "…": "...", "→": "->", "│": "|"}


class _Patient:
    """A text stream that goes on into the void when its reader is gone."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        with self._breaking():
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        with self._breaking():
            self._stream.flush()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    @contextmanager
    def _breaking(self) -> Iterator[None]:
        try:
            yield
        except (OSError, ValueError) as error:
            if isinstance(error, ValueError) and not self._stream.closed:
                raise
            # What is still in the buffer has to go somewhere, or the end of the process complains of it
            with suppress(OSError, ValueError):
                void = os.open(os.devnull, os.O_WRONLY)
                os.dup2(void, self._stream.fileno())
                os.close(void)


@contextmanager
def patient_streams() -> Iterator[None]:
    """Let nothing fail that is printed."""
    _open_standard_descriptors()
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors=_register())
    out, err = (stream or open(os.devnull, "w") for stream in (sys.stdout, sys.stderr))
    with redirect_stdout(_Patient(out)), redirect_stderr(_Patient(err)):
        try:
            yield
        finally:
            sys.stdout.flush()
            sys.stderr.flush()


def spelt(text: str, encoding: str) -> str:
    """Return the text as it will be printed in an encoding: what has to be aligned."""
    return text.encode(encoding, _register()).decode(encoding)


def _register() -> str:
    """Return the name by which codecs know what stands for characters that they lack."""
    codecs.register_error("jaxrt", _instead)
    return "jaxrt"


def _instead(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    lacking = error.object[error.start : error.end]
    return "".join(PLAIN.get(c, c.encode("ascii", "backslashreplace").decode()) for c in lacking), error.end


def _open_standard_descriptors() -> None:
    """Let 0, 1 and 2 be open: else the next file is one of them, and what libraries print goes into it."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest number that is free
