"""Pictures that do not fit into what this process may take."""

import subprocess
import sys

import pytest

from jaxrt.description import SceneError
from jaxrt.scene import memory

GIB = 2**30


@pytest.fixture
def system(monkeypatch):
    """Return a function that sets up a system of files, by path."""

    def with_files(files):
        monkeypatch.setattr(memory, "_read", lambda path: files.get(str(path)))

    return with_files


@pytest.mark.parametrize(
    ("files", "sizes"),
    [
        ({}, []),
        # Version 2: the group's own limit and those above it; `max` is none
        (
            {
                "/proc/self/cgroup": "0::/user/job",
                "/sys/fs/cgroup/user/job/memory.max": "max",
                "/sys/fs/cgroup/user/memory.max": str(3 * GIB),
            },
            [3],
        ),
        # In a container, whose own tree begins at the group
        ({"/proc/self/cgroup": "0::/docker/abc", "/sys/fs/cgroup/memory.max": str(GIB)}, [1]),
        # Version 1, with other controllers beside; no limit is a number near 2**63
        (
            {
                "/proc/self/cgroup": "8:cpu,cpuacct:/a\n7:memory:/a/b\n1:name=systemd:/x",
                "/sys/fs/cgroup/memory/a/b/memory.limit_in_bytes": str(2 * GIB),
                "/sys/fs/cgroup/memory/a/memory.limit_in_bytes": str(9223372036854771712),
                "/sys/fs/cgroup/a/memory.max": str(GIB),
            },
            [2],
        ),
    ],
)
def test_l9_limits_of_control_groups(system, files, sizes):
    system(files)
    assert list(memory._control_groups()) == [size * GIB for size in sizes]


def test_l9_the_least_limit_counts_and_is_named(system):
    system({"/proc/self/cgroup": "0::/", "/sys/fs/cgroup/memory.max": str(GIB // 4)})
    memory.check_memory(1024, 1024)
    with pytest.raises(SceneError) as caught:
        memory.check_memory(2048, 2048, "room.toml")
    assert str(caught.value) == (
        "room.toml: camera: image 2048x2048 needs 0.7 GiB, this process's cgroup allows 0.2 GiB: lower width or height"
    )


def test_l9_ulimit_counts_less_what_is_taken():
    """In a process of its own, with 1 GiB of addresses to go: a picture of 1.1 GiB is refused in words."""
    pytest.importorskip("resource")
    code = """if True:
        import resource
        from jaxrt.scene.memory import check_memory
        taken = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (taken + (1 << 30), resource.RLIM_INFINITY))
        check_memory(1000, 1000)
        try:
            check_memory(2600, 2600)
        except ValueError as error:
            print(error)
    """
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert told == "scene: camera: image 2600x2600 needs 1.1 GiB, ulimit -v leaves 1.0 GiB: lower width or height\n"
