"""Several hosts: what they draw together is what one draws, and what happens where one dies."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import jaxrt
from jaxrt import cli
from jaxrt.hosts import launch
from jaxrt.hosts.seats import Seat, hosts_from
from tests.command import BALL, run

ROOT = Path(jaxrt.__file__).parents[1]
GUARD = 600  # seconds: what should take twenty, beside anything
QUICK = "--xla_backend_optimization_level=0"  # programs that are compiled in half the time

PROGRAM = """
import sys, tomllib
import jax, jax.numpy as jnp, numpy as np
import jaxrt
from tests.command import BALL

rank, count, address, out = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3], sys.argv[4]
jaxrt.use_cpu_cores(4 // count)
if count > 1:
    jax.distributed.initialize(address, count, rank, heartbeat_timeout_seconds=60)
assert len(jax.devices()) == 4
scene = jaxrt.build(tomllib.loads(BALL))

@jax.jit
def looked_at(p):
    picture = jaxrt.render(jaxrt.with_parameters(scene, p), 3, spp=8)
    return jnp.sum(picture**2), picture

p = {name: jaxrt.parameters(scene)[name] for name in ("materials.albedo", "lights.intensity")}
(_, picture), slopes = jax.value_and_grad(looked_at, has_aux=True)(p)
np.savez(out, picture, *slopes.values())
"""


Start = Callable[..., "subprocess.Popen[str]"]


@pytest.fixture
def process(tmp_path: Path) -> Iterator[Start]:
    """Yield what starts a Python process in the test's folder, (words, variables); none outlives the test."""
    children: list[subprocess.Popen[str]] = []
    environment = os.environ | {"PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(tmp_path / "cache"), "XLA_FLAGS": QUICK}
    environment.pop("TF_CPP_MIN_LOG_LEVEL", None)  # that of this process, where JAX has been loaded

    def start(*words: object, **variables: str) -> subprocess.Popen[str]:
        command, pipe = [sys.executable, *map(str, words)], subprocess.PIPE
        children.append(
            subprocess.Popen(command, cwd=tmp_path, env=environment | variables, stderr=pipe, stdout=pipe, text=True)
        )
        return children[-1]

    yield start
    for child in children:
        if child.poll() is None:
            child.terminate()  # a launcher ends those that it has started
            try:
                child.wait(30)
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait()


def finished(child: subprocess.Popen[str]) -> tuple[int, str]:
    _, err = child.communicate(timeout=GUARD)
    return child.returncode, err


def test_two_processes_draw_and_differentiate_what_one_does(tmp_path: Path, process: Start) -> None:
    """Two devices each, against one process with all four."""
    with socket.socket() as listener:
        listener.bind(("", 0))
        address = f"localhost:{listener.getsockname()[1]}"
    arguments = [(0, 1), (0, 2), (1, 2)]
    children = [process("-c", PROGRAM, *who, address, f"{who}.npz") for who in arguments]
    assert [finished(child) for child in children] == [(0, "")] * 3
    one, *two = (list(np.load(tmp_path / f"{who}.npz").values()) for who in arguments)
    for mine in two:
        np.testing.assert_array_equal(mine[0], one[0])
        for slope, expected in zip(mine[1:], one[1:], strict=True):
            assert (expected > 0).all()
            np.testing.assert_allclose(slope, expected, rtol=1e-6)


def test_a_lost_host_is_named_and_its_picture_resumed_to_the_bit(tmp_path: Path, process: Start) -> None:
    (tmp_path / "ball.toml").write_text(BALL.replace("= 2\n", "= 6000\n", 1))
    words = ["-m", "jaxrt", "render", "ball.toml", "--cores", "1", "--sampler", "independent", "-o"]
    child = process(*words, "two.exr", "--hosts", "localhost,localhost", JAXRT_CHECKPOINT_SECONDS="0")
    sums, begun = tmp_path / "two.exr.partial", time.monotonic()
    while not sums.exists() and child.poll() is None and time.monotonic() - begun < GUARD:
        time.sleep(0.01)
    begun = time.monotonic()
    lost = subprocess.run(["pgrep", "-P", str(child.pid)], capture_output=True, text=True, check=True).stdout.split()[1]
    os.kill(int(lost), signal.SIGKILL)
    status, err = finished(child)
    assert status == launch.LOST, err
    assert time.monotonic() - begun < 120
    assert "jaxrt: host 1 of 2 is lost: " in err and "are in two.exr: go on with --resume" in err
    assert err.endswith("jaxrt: error: host 1 of 2 (localhost) is lost: ended by signal 9\n")
    status, err = finished(process(*words, "two.exr", "--resume", "--hosts", "localhost,localhost"))
    assert (status, sums.exists()) == (0, False), err
    assert finished(process(*words, "one.exr"))[0] == 0
    assert (tmp_path / "two.exr").read_bytes() == (tmp_path / "one.exr").read_bytes()


class Child:
    """A process that ends with a status after some looks, or never."""

    def __init__(self, status: int | None, looks: int = 0) -> None:
        self.status, self.looks, self.returncode = status, looks, None

    def poll(self) -> int | None:
        self.looks -= 1
        if self.looks < 0:
            self.returncode = self.status
        return self.returncode

    def kill(self) -> None:
        self.status, self.looks = -signal.SIGKILL, 0

    wait = poll


@pytest.mark.parametrize(
    "children, status, told",
    [
        ([Child(0), Child(0)], 0, ""),
        ([Child(2), Child(None)], 2, ""),
        ([Child(143, 2), Child(0)], 143, ""),
        ([Child(4, 2), Child(-9), Child(4, 3)], 4, "host 1 of 3 (b) is lost: ended by signal 9"),
        ([Child(4), Child(4), Child(None)], 4, "host 2 of 3 (c) is lost: it gave no more sign of life, and was killed"),
        ([Child(-9), Child(-6, 2)], 4, "host 0 of 2 (a) is lost: ended by signal 9"),
        ([Child(None), Child(-6)], 4, "host 0 of 2 (a) is lost: it gave no more sign of life, and was killed"),
        ([Child(4, 2), Child(255)], 4, "host 1 of 2 (b) ended with status 255"),
    ],
)
def test_the_launcher_tells_who_is_lost(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], children: Any, status: int, told: str
) -> None:
    monkeypatch.setattr(launch, "PATIENCE", 0.3)
    monkeypatch.setattr(launch, "LEAVING", 0.3)
    waiting = list(children)
    monkeypatch.setattr(launch.subprocess, "Popen", lambda *arguments, **options: waiting.pop(0))
    assert launch.launch("abc"[: len(children)], ["render", "a.toml"]) == status
    assert capsys.readouterr().err == (f"jaxrt: error: {told}\n" if told else "")


def test_other_hosts_are_reached_by_ssh(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    started: list[list[str]] = []
    monkeypatch.setattr(launch.subprocess, "Popen", lambda command, **options: started.append(command) or Child(0))
    monkeypatch.chdir(tmp_path)
    assert cli.main(["render", "a b.toml", "--hosts=me@one,two", "--spp", "4"]) == 0
    here, there = started
    assert here[:6] == [sys.executable, "-m", "jaxrt", "render", "a b.toml", "--spp"] and "0/2@one:" in here[-1]
    assert there[0] == "ssh" and there[-2] == "two"
    port = here[-1].rpartition(":")[2]
    assert there[-1].startswith(
        f"cd {tmp_path} && exec {sys.executable} -m jaxrt render 'a b.toml' --spp 4 --hosts 1/2"
    )
    assert there[-1].endswith(f"@one:{port}")


def test_seats() -> None:
    assert hosts_from("auto") == Seat()
    assert hosts_from("1/12@10.0.0.1:4711") == Seat(1, 12, "10.0.0.1:4711")
    assert hosts_from(str(Seat(0, 2, "a:1"))) == Seat(0, 2, "a:1")
    assert hosts_from("a,b-1,me@c.org,a") == ["a", "b-1", "me@c.org", "a"]


@pytest.mark.parametrize(
    "text, told",
    [
        ("2/2@a:1", "there is no rank 2 among 2"),
        ("a,-oProxyCommand=x", "names no hosts"),
        ("a,,b", "names no hosts"),
        ("", "names no hosts"),
        ("a b,c", "names no hosts"),
        ("node1", "is one host: name several"),
    ],
)
def test_what_names_no_hosts_is_refused(capsys: pytest.CaptureFixture[str], text: str, told: str) -> None:
    status, out, err = run(capsys, "render", "a.toml", f"--hosts={text}")
    assert (status, out, err.count("\n")) == (2, "", 1) and told in err


def test_auto_needs_a_scheduler(tmp_path: Path, process: Start) -> None:
    (tmp_path / "ball.toml").write_text(BALL)
    status, err = finished(process("-m", "jaxrt", "render", "ball.toml", "--hosts", "auto"))
    assert (status, err.count("\n")) == (2, 1) and "auto: no scheduler tells who is who" in err
