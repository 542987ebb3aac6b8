"""How much memory this process may take: what the machine has, and what its user's limits leave of it."""

import os
from collections.abc import Iterator
from pathlib import Path

from jaxrt.description import SceneError

BYTES_PER_PIXEL = 180  # sums of samples in parts, twice (72), and exactly, before and after a chunk (96); encoding (12)
UNLIMITED = 2**60  # cgroups of version 1 write no limit as a number near 2⁶³
GROUPS = Path("/sys/fs/cgroup")
OWN_GROUPS, OWN_STATUS = Path("/proc/self/cgroup"), Path("/proc/self/statm")


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
        pages = (_read(OWN_STATUS) or "0").split()[0]
        yield soft - int(pages) * os.sysconf("SC_PAGE_SIZE"), "ulimit -v leaves"


def _control_groups() -> Iterator[int]:
    """Yield the limits of this process's control group and of all above it.

    Version 2 has one tree, listed as `0::/path`; version 1 one for memory, `7:memory:/path`, that begins in a folder of
    that name. In a container the path may be that of the host: then the tree's root is this group.
    """
    for line in (_read(OWN_GROUPS) or "").splitlines():
        _, _, rest = line.partition(":")
        controllers, _, path = rest.partition(":")
        if controllers and "memory" not in controllers.split(","):
            continue
        root, name = (GROUPS / "memory", "memory.limit_in_bytes") if controllers else (GROUPS, "memory.max")
        own = root / path.strip("/")
        for folder in (own, *own.parents):
            text = _read(folder / name)
            if text and text.isdigit() and int(text) < UNLIMITED:
                yield int(text)
            if folder == root:
                break


def _read(path: Path) -> str | None:
    """Return the text of a small file of the system's without its line end, None where there is none."""
    try:
        return path.read_text().strip()
    except (OSError, UnicodeDecodeError):
        return None
