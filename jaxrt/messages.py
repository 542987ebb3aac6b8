"""What jaxrt refuses and warns of, and how values and names stand in its messages. Imports nothing large."""

import difflib
import json
from collections.abc import Iterable


class SceneError(ValueError):
    """A scene that cannot be rendered: one line with source, place, culprit and remedy."""


class SceneWarning(UserWarning):
    """A scene that can be rendered, but hardly means what it says."""


def show(value: object) -> str:
    """Return `value` as it would stand in a scene file, on one line of at most 60 characters."""
    quoted = isinstance(value, str | bool)
    text = json.dumps(value, ensure_ascii=False) if quoted else repr(value).replace("\n", " ")
    return text if len(text) <= 60 else text[:57] + "..."


def nearest(name: str, known: Iterable[str]) -> str:
    """Return ` (did you mean "x"?)` with the nearest of `known`, or all of them where none is near."""
    choices = list(known)
    near = difflib.get_close_matches(name, choices, n=1)
    if near:
        return f" (did you mean {show(near[0])}?)"
    return f" (known: {', '.join(choices)})" if choices else " (none is defined)"
