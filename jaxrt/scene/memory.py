"""How much memory this process may take: what the machine has, and what its user's limits leave of it."""

import os
from collections.abc import Iterator
from pathlib import Path

from jaxrt.core import system
from jaxrt.description import SceneError

BYTES_PER_PIXEL = 180  # sums of samples in parts, twice (72), and exactly, before and after a chunk (96); encoding (12)
UNLIMITED = 2**60  # cgroups of version 1 write no limit as a number near 2⁶³
OWN_STATUS = Path("/proc/self/statm")


def check_memory(width: int, height: int, source: str = "scene") -> None:
    """Raise SceneError where a picture of width × height pixels cannot fit into the memory this process may take."""
    needed = width * height * BYTES_PER_PIXEL
    least = min(limits(), default=None)
    if least is not None and needed > least[0]:
        raise SceneError(
            f"{source}: camera: image {width}x{height} needs {needed / 2**30:.1f} GiB, {least[1]} "
            f"{max(least[0], 0) / 2**30:.1f} GiB: lower width or height"
        )


def limits() -> Iterator[tuple[int, str]]:
    """Yield each limit that the system tells of: bytes, and the words that go before them."""
    try:
        yield os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"), "this machine has"
    except (AttributeError, ValueError, OSError):
        pass
    yield from _address_space()
    yield from ((size, "this process's cgroup allows") for size in _control_groups())


def _address_space() -> Iterator[tuple[int, str]]:
    """Yield what `ulimit -v` leaves: addresses that are taken already count, though little memory is behind them."""
    try:
        import resource
    except ImportError:  # not on Windows
        return
    soft, _ = resource.getrlimit(resource.RLIMIT_AS)
    if soft != resource.RLIM_INFINITY:
        pages = (system.read(OWN_STATUS) or "0").split()[0]
        yield soft - int(pages) * os.sysconf("SC_PAGE_SIZE"), "ulimit -v leaves"


def _control_groups() -> Iterator[int]:
    """Yield the limits of this process's control group and of all above it."""
    for version, folder in system.own_groups("memory"):
        text = system.read(folder / ("memory.max" if version == 2 else "memory.limit_in_bytes"))
        if text and text.isdigit() and int(text) < UNLIMITED:
            yield int(text)
