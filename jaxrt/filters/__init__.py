"""Filters: by how much a place of the film counts in a pixel; one file a filter.

Each answers of one axis, in widths from a pixel's middle,

    place(u) -> the place in [-½, ½] that a number in [0, 1) is drawn to, by importance (Ernst et al. 2006)
    weight(x) -> the density of places there, which is the filter's value

so that samples keep their weights. A box of one pixel, the default, is no filter: no code.
"""

import importlib
import math
from types import ModuleType
from typing import TYPE_CHECKING, NamedTuple

from jaxrt.core.messages import nearest, show

if TYPE_CHECKING:  # the command line tells of a scene without JAX
    from jax import Array

BOX = "box"
NAMES = (BOX, "gaussian", "blackman-harris")
WIDTH, WIDEST = 3.0, 16.0  # pixels


class Filter(NamedTuple):
    """A filter of a width: along both axes the same."""

    name: str
    width: float  # pixels, from end to end

    @property
    def margin(self) -> int:
        """Pixels beside a pixel, to each side, in which what it shows counts."""
        return max(0, math.ceil(self.width / 2 - 0.5))

    def place(self, u: "Array") -> "Array":
        """Return how far from a pixel's middle, in pixels, a number in [0, 1) places a sample."""
        place: Array = self.width * self._kind.place(u)
        return place

    def weight(self, x: "Array") -> "Array":
        """Return the density of places so far from a pixel's middle, per pixel."""
        weight: Array = self._kind.weight(x / self.width) / self.width
        return weight

    @property
    def _kind(self) -> ModuleType:
        return importlib.import_module(f"jaxrt.filters.{self.name.replace('-', '_')}")


def filter_of(name: str, width: float | None) -> Filter | None:
    """Return the filter of a name and a width in pixels, by default 3; None for the box.

    Raises ValueError for unknown names, for widths out of range, and for a box's width.
    """
    if name not in NAMES:
        raise ValueError(f"filter: unknown filter {show(name)}{nearest(str(name), NAMES)}: use {', '.join(NAMES)}")
    if name == BOX:
        if width is not None:
            raise ValueError(f"filter_width: a box is one pixel wide: leave it out, or use {' or '.join(NAMES[1:])}")
        return None
    width = WIDTH if width is None else width
    if isinstance(width, bool) or not isinstance(width, int | float) or not 0 < width <= WIDEST:
        raise ValueError(f"filter_width: {show(width)} is no number of pixels above 0 and up to {WIDEST:g}")
    return Filter(name, float(width))
