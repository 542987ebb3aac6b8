"""What the system tells of this process: the cores that it may run on, its control groups."""

import os
from collections.abc import Iterator
from pathlib import Path

GROUPS, OWN_GROUPS = Path("/sys/fs/cgroup"), Path("/proc/self/cgroup")


def usable_cores() -> int:
    """Return how many cores this process may run on, at least 1.

    A control group's share of 1.5 cores is 2: the second is idle half of the time.
    """
    affinity = getattr(os, "sched_getaffinity", None)
    there = len(affinity(0)) if affinity else os.cpu_count() or 1
    return max(1, min([there, *(-(-quota // period) for quota, period in _quotas())]))


def own_groups(controller: str) -> Iterator[tuple[int, Path]]:
    """Yield version and folder of this process's control group, and of all above it, for `memory` or `cpu`.

    Version 2 has one tree, listed as `0::/path`; version 1 one for each controller, `7:memory:/path`, that begins in a
    folder of that name. In a container the path may be that of the host: then the tree's root is this group.
    """
    for line in (read(OWN_GROUPS) or "").splitlines():
        _, _, rest = line.partition(":")
        controllers, _, path = rest.partition(":")
        if controllers and controller not in controllers.split(","):
            continue
        version, root = (1, GROUPS / controller) if controllers else (2, GROUPS)
        folder = root / path.strip("/")
        for place in (folder, *folder.parents):
            yield version, place
            if place == root:
                break


def read(path: Path) -> str | None:
    """Return the text of a small file of the system's without its line end, None where there is none."""
    try:
        return path.read_text().strip()
    except (OSError, UnicodeDecodeError):
        return None


def _quotas() -> Iterator[tuple[int, int]]:
    """Yield the processor time that control groups allow, and in how much time; no limit is `max`, or -1."""
    for version, folder in own_groups("cpu"):
        if version == 2:
            words = (read(folder / "cpu.max") or "").split()
        else:
            words = [read(folder / f"cpu.cfs_{name}_us") or "" for name in ("quota", "period")]
        if len(words) == 2 and all(word.isdigit() and int(word) for word in words):
            yield int(words[0]), int(words[1])
