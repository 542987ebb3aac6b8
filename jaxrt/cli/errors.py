"""Refusals and failures of the command line: one line each."""

import os
import re
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager

from jaxrt.core.messages import SceneError, one_line

BAD_INPUT, INTERNAL = 2, 70  # exit statuses


class UsageError(ValueError):
    """Arguments that cannot be served: one line with culprit and remedy."""


@contextmanager
def refusing() -> Iterator[None]:
    """Turn what the file layer raises into one line."""
    try:
        yield
    except SceneError:
        raise
    except OSError as error:
        raise UsageError(_of_system(error)) from None
    except ValueError as error:
        raise UsageError(str(error)) from None


def told(error: Exception) -> int:
    """Print what ended a command in one line, with JAXRT_TRACEBACK=1 also where, and return the exit status."""
    if os.environ.get("JAXRT_TRACEBACK"):
        traceback.print_exception(error)
    status, text = _verdict(error)
    print(f"jaxrt: error: {one_line(text)}", file=sys.stderr)
    return status


def _verdict(error: Exception) -> tuple[int, str]:
    """Return the exit status and the line for what ended a command."""
    text = str(error)
    if isinstance(error, SceneError | UsageError):
        return BAD_INPUT, text
    if isinstance(error, MemoryError) or re.search("RESOURCE_EXHAUSTED|bad_alloc", text):
        return BAD_INPUT, "memory: there is not enough of it: lower width and height, or the number of faces"
    if isinstance(error, RecursionError):
        return BAD_INPUT, "the scene is nested too deeply: flatten it"
    if isinstance(error, OSError):
        return BAD_INPUT, _of_system(error)
    return INTERNAL, f"internal error: {type(error).__name__}: {text}: please report it, with JAXRT_TRACEBACK=1 set"


def _of_system(error: OSError) -> str:
    """Return what the system refused, and of which file."""
    culprit = [str(part) for part in (error.filename, error.strerror) if part]
    return f"{': '.join(culprit)}: choose another file" if culprit else str(error)
