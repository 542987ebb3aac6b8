"""Counts that callers give: whole numbers from some least one on."""

import operator

from jaxrt.core.messages import show


def whole_number(place: str, value: int, least: int = 1, bits: int | None = None) -> int:
    """Return a count of at most so many bits. place: what asks and for what, as "render: spp".

    Raises ValueError for what is less, more or no whole number.
    """
    try:
        number = operator.index(value)
    except TypeError:
        raise ValueError(f"{place} is {show(value)}, want a whole number") from None
    if number < least or (bits is not None and number >> bits):
        most = "" if bits is None else f", and less than 2**{bits}"
        raise ValueError(f"{place} is {show(number)}, want at least {least}{most}")
    return number
