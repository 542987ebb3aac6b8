"""Pictures that do not fit into what this process may take."""

import os
import subprocess
import sys

import pytest

import jaxrt
from jaxrt.core.system import usable_cores
from jaxrt.description import SceneError
from jaxrt.scene import memory

GIB = 2**30


@pytest.fixture
def system(monkeypatch):
    """Return a function that sets up a system of files, by path."""

    def with_files(files):
        monkeypatch.setattr("jaxrt.core.system.read", lambda path: files.get(str(path)))

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


@pytest.mark.parametrize(
    ("files", "cores"),
    [
        ({}, 8),
        ({"/proc/self/cgroup": "0::/a/b", "/sys/fs/cgroup/a/b/cpu.max": "max 100000"}, 8),
        ({"/proc/self/cgroup": "0::/a/b", "/sys/fs/cgroup/a/cpu.max": "150000 100000"}, 2),
        ({"/proc/self/cgroup": "0::/docker/x", "/sys/fs/cgroup/cpu.max": "50000 100000"}, 1),
        ({"/proc/self/cgroup": "0::/", "/sys/fs/cgroup/cpu.max": "9900000 100000"}, 8),
        ({"/proc/self/cgroup": "0::/", "/sys/fs/cgroup/cpu.max": "garbage"}, 8),
        (
            {
                "/proc/self/cgroup": "3:cpu,cpuacct:/a\n7:memory:/b",
                "/sys/fs/cgroup/cpu/a/cpu.cfs_quota_us": "300000",
                "/sys/fs/cgroup/cpu/a/cpu.cfs_period_us": "100000",
                "/sys/fs/cgroup/cpu/cpu.cfs_quota_us": "-1",
                "/sys/fs/cgroup/cpu/cpu.cfs_period_us": "100000",
            },
            3,
        ),
    ],
)
def test_s5_cores_that_affinity_and_control_groups_leave(system, monkeypatch, files, cores):
    system(files)
    monkeypatch.setattr("os.sched_getaffinity", lambda process: set(range(8)), raising=False)
    assert usable_cores() == cores
    given = []
    monkeypatch.setattr("jax.config.update", lambda *setting: given.append(setting))
    jaxrt.use_cpu_cores()
    assert given == [("jax_num_cpu_devices", cores)]


def test_s5_numbers_of_cores_that_are_none():
    for n in (0, -1, 1.5, "two", True):
        with pytest.raises(ValueError, match=r"use_cpu_cores: n is .+: pass a whole number from 1 on, or none for all"):
            jaxrt.use_cpu_cores(n)


@pytest.mark.parametrize(
    ("given", "left"),
    [
        ("", "--xla_backend_optimization_level=2"),
        ("--xla_cpu_x=1", "--xla_cpu_x=1 --xla_backend_optimization_level=2"),
        ("--xla_backend_optimization_level=1", "--xla_backend_optimization_level=1"),
    ],
)
def test_programs_are_compiled_at_the_level_asked_for_or_the_second(monkeypatch, given, left):
    monkeypatch.setattr("jax.config.update", lambda *setting: None)
    monkeypatch.setenv("XLA_FLAGS", given)
    jaxrt.use_cpu_cores(1)
    assert os.environ["XLA_FLAGS"] == left


def test_devices_have_threads_to_wait_in(monkeypatch):
    """A loop of steps on two devices never ended when XLA's pool had as many threads as cores."""
    set_up = {}
    monkeypatch.setattr("jax.config.update", set_up.__setitem__)
    monkeypatch.delenv("NPROC", raising=False)
    jaxrt.use_cpu_cores(1)
    assert "NPROC" not in os.environ
    jaxrt.use_cpu_cores(3)
    assert set_up == {"jax_num_cpu_devices": 3} and os.environ["NPROC"] == "24"
    monkeypatch.setenv("NPROC", "7")
    jaxrt.use_cpu_cores(2)
    assert os.environ["NPROC"] == "7"
