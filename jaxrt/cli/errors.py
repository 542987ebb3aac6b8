"""Refusals of the command line: one line each."""

from collections.abc import Iterator
from contextlib import contextmanager

from jaxrt.messages import SceneError


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
        culprit = f"{error.filename}: {error.strerror}" if error.strerror else str(error)
        raise UsageError(f"{culprit}: choose another file") from None
    except ValueError as error:
        raise UsageError(str(error)) from None
