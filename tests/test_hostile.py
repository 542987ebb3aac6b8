"""Hostile input: what may be read, how much of it, and from where."""

import os
import signal
import socket
from contextlib import contextmanager

import pytest

from jaxrt.io.files import inside, read_bytes
from jaxrt.messages import SceneError


@contextmanager
def no_hang(seconds=30):
    """Fail after `seconds`, many times what is expected, instead of waiting for ever."""

    def stop(signum, frame):
        raise AssertionError(f"hangs for {seconds} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


# What may be read


def test_l6_fifo_devices_and_sockets_are_refused_unread(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe.toml")
    os.symlink("/dev/zero", "zero.toml")
    os.symlink("loop.toml", "loop.toml")
    (tmp_path / "folder.toml").mkdir()
    with socket.socket(socket.AF_UNIX) as plug, no_hang():
        plug.bind("plug.toml")
        for name, said in (
            ("pipe", "is a device, pipe or socket: copy it"),
            ("zero", "is a device, pipe or socket: copy it"),
            ("plug", "is a device, pipe or socket: copy it"),
            ("folder", "is a folder: name a file in it"),
            ("loop", "cannot be read"),
        ):
            with pytest.raises(SceneError, match=rf"^{name}\.toml: {said}"):
                read_bytes(tmp_path.__class__(f"{name}.toml"), (".toml",))


def test_l6_sizes_are_bounded_and_the_bound_can_be_raised(tmp_path, monkeypatch):
    path = tmp_path / "big.toml"
    with path.open("wb") as file:
        file.truncate(3 * 2**40)
    with pytest.raises(SceneError, match=r"has 3145728 MiB, 64 MiB are allowed: .* set JAXRT_MAX_FILE_SIZE=3145728$"):
        read_bytes(path, (".toml",), limit=64 * 2**20)
    path.write_bytes(b"x" * 100)
    with pytest.raises(SceneError, match="has 1 MiB, 9.53674e-06 MiB are allowed"):
        read_bytes(path, (".toml",), limit=10)
    monkeypatch.setenv("JAXRT_MAX_FILE_SIZE", "1")
    assert len(read_bytes(path, (".toml",), limit=10)) == 100
    monkeypatch.setenv("JAXRT_MAX_FILE_SIZE", "much")
    with pytest.raises(SceneError, match='JAXRT_MAX_FILE_SIZE: "much" is not a number of MiB: correct it'):
        read_bytes(path, (".toml",))


# From where


def test_l6_what_a_file_names_lies_in_its_folder_or_below(tmp_path):
    home, other = tmp_path / "home", tmp_path / "other"
    (home / "below").mkdir(parents=True)
    other.mkdir()
    for place in (home / "a.mtl", home / "below" / "b.mtl", other / "c.mtl"):
        place.write_text("")
    (home / "link.mtl").symlink_to(other / "c.mtl")
    (home / "link").symlink_to(other)
    for name in ("a.mtl", "below/b.mtl", "below/../a.mtl", str(home / "a.mtl"), "missing.mtl"):
        assert inside(home / name, home) == home / name
    for name in ("../other/c.mtl", "link.mtl", "link/c.mtl", str(other / "c.mtl"), "/etc/shadow", "../home2/a.mtl"):
        with pytest.raises(SceneError, match=r"lies outside of .*: move it there, or pass --allow-folder ") as told:
            inside(home / name, home)
        folder = str(told.value).split("--allow-folder ")[1].split(" (")[0]
        assert inside(home / name, home, [folder]) == home / name
