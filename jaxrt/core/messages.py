"""What jaxrt refuses and warns of, and how values and names stand in its messages. Imports nothing large."""

import difflib
import json
import reprlib
from collections.abc import Iterable

MOST = 1000  # characters of a message
SHOWN = 60  # characters of a value in it
COMPARED = 10_000  # names that a misspelt one is compared with, each of at most LONG characters
LONG = 100
LISTED = 12  # names that a message lists


class SceneError(ValueError):
    """A scene that cannot be rendered: one line with source, place, culprit and remedy."""

    def __init__(self, text: object = "") -> None:
        super().__init__(one_line(str(text)))


class SceneWarning(UserWarning):
    """A scene that can be rendered, but hardly means what it says."""


def one_line(text: str) -> str:
    """Return `text` in printable characters, others escaped, its middle left out where it is long."""
    if len(text) > MOST:
        text = f"{text[: MOST * 2 // 3]} … {text[-MOST // 4 :]}"
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


class _Short(reprlib.Repr):
    """As `repr`, of values of any size and depth, at a cost that does not grow with them."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel = self.maxlist = self.maxtuple = self.maxdict = SHOWN // 2
        self.maxstring = self.maxother = self.maxlong = 2 * SHOWN

    def repr_int(self, value: int, level: int) -> str:
        # Python writes out no decimals beyond 4300
        return repr(value) if abs(value) < 10**SHOWN else hex(value)[: 2 * SHOWN]


_short = _Short()


def show(value: object) -> str:
    """Return `value` as it would stand in a scene file, on one line of at most 60 characters."""
    if isinstance(value, str | bool):
        text = json.dumps(value[: 2 * SHOWN] if isinstance(value, str) else value, ensure_ascii=False)
    else:
        text = _short.repr(value).replace("\n", " ")
    return text if len(text) <= SHOWN else text[: SHOWN - 3] + "..."


def nearest(name: str, known: Iterable[str]) -> str:
    """Return ` (did you mean "x"?)` with the nearest of `known`, or some of them where none is near."""
    choices = [str(choice) for choice in known]
    # Small or large letters, and the last part of a dotted name
    asked = name[:LONG].casefold()
    compared = {choice.casefold(): choice for choice in choices[:COMPARED] if len(choice) <= LONG}
    near = [choice for choice in compared if asked and choice.endswith(f".{asked}")]
    near = near[:1] or difflib.get_close_matches(asked, compared, n=1)
    if near:
        return f" (did you mean {show(compared[near[0]])}?)"
    if not choices:
        return " (none is defined)"
    listed = ", ".join(choice if len(choice) <= SHOWN else show(choice) for choice in choices[:LISTED])
    more = f" and {len(choices) - LISTED} more" if len(choices) > LISTED else ""
    return f" (known: {listed}{more})"
