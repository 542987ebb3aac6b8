"""Hostile input: what may be read, how much of it, and from where."""

import os
import signal
import socket
from contextlib import contextmanager
from pathlib import Path

import pytest

import jaxrt
from jaxrt.io.files import read_bytes
from jaxrt.io.folders import named_file
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
            ("pipe", "is a pipe or a device, no regular file: copy its content"),
            ("zero", "is a pipe or a device, no regular file: copy its content"),
            ("plug", "is a pipe or a device, no regular file: copy its content"),
            ("folder", "is a folder: name a file in it"),
            ("loop", "cannot be read"),
        ):
            with pytest.raises(SceneError, match=rf"^{name}\.toml: {said}"):
                read_bytes(Path(f"{name}.toml"), (".toml",))


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
    (home / "loop").symlink_to("loop")
    owner = home / "a.obj"
    for name in ("a.mtl", "below/b.mtl", "below/../a.mtl", str(home / "a.mtl"), "missing.mtl"):
        assert named_file(name, owner, "line 1") == home / name
    for name in ("../other/c.mtl", "link.mtl", "link/c.mtl", str(other / "c.mtl"), "/etc/shadow", "../home2/a.mtl"):
        with pytest.raises(SceneError, match=r"a\.obj: line 1: .* lies outside of .* --allow-folder "):
            named_file(name, owner, "line 1")
        assert named_file(name, owner, "line 1", [(home / name).resolve().parent]) == home / name
    for name in ("loop", "a\0b", "x" * 5000):
        with pytest.raises(SceneError) as told, no_hang():
            read_bytes(named_file(name, owner, "line 1"), (".mtl",))
        assert len(str(told.value)) <= 1000 and str(told.value).isprintable()


def test_l6_a_scene_names_meshes_beside_its_folder_and_an_obj_materials_below_its_own(tmp_path, monkeypatch, capsys):
    from command import run, working_folder

    triangle = "v 0 0 0\nv 9 0 0\nv 0 9 0\nusemtl red\nf 1 2 3\n"
    (tmp_path / "work").mkdir()
    work = working_folder(tmp_path / "work", monkeypatch)
    for folder in ("scenes", "meshes", "far/off"):
        (work / folder).mkdir(parents=True)
    (work / "paint.mtl").write_text("newmtl red\nKd 1 0 0\n")
    (work / "meshes" / "a.obj").write_text("mtllib ../paint.mtl\n" + triangle)
    (work / "far" / "off" / "b.obj").write_text(triangle)

    def info(file, *more):
        (work / "scenes" / "s.toml").write_text(Path("ball.toml").read_text() + f"[[meshes]]\nfile = '{file}'\n")
        return run(capsys, "info", "scenes/s.toml", *more)

    status, _, err = info("../meshes/a.obj")
    assert status == 2 and "paint.mtl" in err and "lies outside of" in err and err.count("\n") == 1
    assert info("../meshes/a.obj", "--allow-folder", ".")[0] == 0
    assert info("../meshes/a.obj", "--allow-folder", "meshes")[0] == 2
    (work.parent / "up.obj").write_text(triangle)
    material = "'\nmaterial = 'white"
    assert info(f"../far/off/b.obj{material}")[0] == 0
    status, _, err = info(f"../../up.obj{material}")
    assert status == 2 and err.startswith('jaxrt: error: scenes/s.toml: meshes[0].file: "../../up.obj" lies outside of')
    assert info(f"../../up.obj{material}", "--allow-folder", "nowhere", "--allow-folder", "..")[0] == 0
    assert jaxrt.load_scene("scenes/s.toml", allow_folders=[".."]).triangles.faces.shape == (1, 3)
