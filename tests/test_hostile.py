"""Hostile input: what may be read, how much of it, and from where; what must be refused in one line."""

import json
import os
import signal
import socket
import struct
import zlib
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from command import BALL, run, working_folder
from PIL import Image

import jaxrt
from jaxrt.core.messages import SceneError, nearest, show
from jaxrt.fit import FitError, unknowns_of
from jaxrt.fit.files import read_progress
from jaxrt.io.files import read_bytes
from jaxrt.io.folders import named_file
from jaxrt.io.image import load_image, save_image
from jaxrt.scene.selectors import parse_selector


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
    with pytest.raises(SceneError, match="lies outside of"):
        named_file("/etc/shadow", owner, "line 1", str(other))  # one folder, not its letters
    assert named_file(str(other / "c.mtl"), owner, "line 1", str(other)) == other / "c.mtl"
    for name in ("loop", "a\0b", "x" * 5000):
        with pytest.raises(SceneError) as told, no_hang():
            read_bytes(named_file(name, owner, "line 1"), (".mtl",))
        assert len(str(told.value)) <= 1000 and str(told.value).isprintable()


def test_l6_a_scene_names_meshes_beside_its_folder_and_an_obj_materials_below_its_own(tmp_path, monkeypatch, capsys):
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


def test_l6_pictures_and_reports_are_regular_files_too(tmp_path, monkeypatch, capsys):
    working_folder(tmp_path, monkeypatch)
    os.mkfifo("pipe.exr")
    os.symlink("/dev/zero", "zero.png")
    os.symlink("nowhere.png", "lost.png")
    save_image("a.png", np.zeros((2, 2, 3)))
    with no_hang():
        for name, said in (
            ("pipe.exr", "is a pipe or a device"),
            ("zero.png", "is a pipe or a device"),
            ("lost.png", ""),
        ):
            status, out, err = run(capsys, "diff", "a.png", name)
            assert (status, out) == (2, "") and err.startswith(f"jaxrt: error: {name}: {said}") and err.count("\n") == 1


# Values and texts


LONG_HEX = "0x" + "f" * 5000
TEXTS = {
    "radius": (BALL.replace("radius   = 10", f"radius = {LONG_HEX}"), "spheres[0].radius: 0xfff"),
    "width": (BALL.replace("width    = 16", f"width = {LONG_HEX}"), "camera.width: 0xfff"),
    "material": (BALL.replace('material = "white"', f"material = {LONG_HEX}"), "spheres[0].material: 0xfff"),
    "type": (
        BALL.replace('type   = "diffuse"', f"type = {LONG_HEX}"),
        "materials.white.type: unknown material type 0xfff",
    ),
    "position": (BALL.replace("[0, 0, 30]", f"[0, {LONG_HEX}, 30]"), "camera.position[1]: 0xfff"),
    "decimals": (
        BALL.replace("radius   = 10", "radius = " + "9" * 5000),
        "a whole number of thousands of digits: shorten it",
    ),
    "tiny": (BALL.replace("radius   = 10", "radius = 1e-200"), "spheres[0].radius: 1e-200 is too small for float32"),
    "tiny light": (BALL + "radius = 1e-200", "lights[0].radius: 1e-200 is too small for float32"),
    "dotted": (BALL + ".".join("a" * 3000) + " = 1", "a key of more than 64 parts, nested too deeply: flatten it"),
    "long dotted": (BALL + "a." * 300_000 + "a = 1", "a key of more than 64 parts"),
    "nested": (BALL + "a = " + "[" * 5000 + "]" * 5000, "nested too deeply: flatten it"),
    "nested value": (BALL.replace("[0, 0, 30]", "[" * 200 + "]" * 200), "camera.position: [[["),
    "sky": (BALL + "[environment]\nradiance = [1, 3e38, 1]", "environment.radiance[1]: 3e+38 is so bright that"),
    "lamp": (BALL.replace("2000", "3e38"), "lights[0].intensity: 3e+38 is so bright that"),
    "control": (BALL.replace('material = "white"', 'material = "\\u001b[2J\\u0085\\u202e"'), "\\u001b[2J\\x85\\u202e"),
    "zero byte": (BALL + "\0", "not valid TOML: Invalid statement"),
    "CR": (BALL.replace("\n", "\r"), "its lines end with CR alone, which TOML does not know: save it with LF"),
    "UTF-16": (BALL.encode("utf-16"), "UTF-16 text, and TOML is UTF-8: save it as UTF-8"),
    "Latin-1": (BALL.encode() + b"# \xe9", "not UTF-8 text at byte "),
}


@pytest.mark.parametrize("name", TEXTS)
def test_l7_texts_and_values_of_all_kinds_are_one_line(name, tmp_path, monkeypatch, capsys):
    text, message = TEXTS[name]
    working_folder(tmp_path, monkeypatch)
    Path("bad.toml").write_bytes(text if isinstance(text, bytes) else text.encode())
    with no_hang():
        status, out, err = run(capsys, "info", "bad.toml")
    assert (status, out) == (2, "") and err.startswith("jaxrt: error: bad.toml: ") and message in err
    assert err.endswith("\n") and err[:-1].isprintable() and len(err) < 300


def test_l7_a_byte_order_mark_is_no_part_of_a_scene(tmp_path):
    (tmp_path / "a.toml").write_bytes(b"\xef\xbb\xbf" + BALL.replace("\n", "\r\n").encode())
    assert jaxrt.load_scene(tmp_path / "a.toml").camera.width == 16


def test_l7_messages_are_bounded_and_printable():
    names = [f"material {i}" for i in range(100_000)]
    with no_hang():
        assert len(nearest("qqq", names)) < 300 and nearest("qqq", names).endswith(" and 99988 more)")
        assert nearest("material  17", names) == ' (did you mean "material 17"?)'
        assert len(nearest("x" * 10**6, ["x" * 10**6])) < 100
    deep = [1]
    for _ in range(10_000):
        deep = [deep]
    for value in (deep, [16**9999], 16**9999, -(16**9999), "x" * 10**7, {"a": deep}, [[0.5] * 3] * 10**5):
        assert len(show(value)) <= 60
    text = str(SceneError("a.toml: \x1b[31m\n\u2028" + "x" * 10**6 + ": mend it"))
    assert (
        len(text) <= 1000 and text.isprintable() and text.startswith("a.toml: \\x1b[31m") and text.endswith(": mend it")
    )


def test_l7_folders_that_cannot_be_listed(tmp_path, monkeypatch):
    def refuse(path):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(os, "scandir", refuse)
    with pytest.raises(SceneError, match=r"a\.toml: no such file: check the path$"):
        read_bytes(tmp_path / "a.toml", (".toml",))


# Pictures


def _png(width, height, pixels=b""):
    """Return a PNG of 8 bits RGB that announces a size."""
    chunks = (
        (b"IHDR", struct.pack(">2I5B", width, height, 8, 2, 0, 0, 0)),
        (b"IDAT", zlib.compress(pixels)),
        (b"IEND", b""),
    )
    body = [struct.pack(">I", len(c)) + kind + c + struct.pack(">I", zlib.crc32(kind + c)) for kind, c in chunks]
    return b"\x89PNG\r\n\x1a\n" + b"".join(body)


def test_l7_picture_bombs_are_refused_before_they_are_decoded(tmp_path, monkeypatch):
    bombs = {"a.png": _png(30_000, 30_000), "b.png": _png(2**31 - 1, 2**31 - 1), "c.png": _png(0, 5)}
    save_image(tmp_path / "d.exr", np.zeros((2, 2, 3), np.float32))
    whole = (tmp_path / "d.exr").read_bytes()
    place = whole.index(b"dataWindow\0box2i\0") + 21
    bombs["d.exr"] = whole[:place] + struct.pack("<4i", 0, 0, 99_999, 99_999) + whole[place + 16 :]
    bombs["e.exr"] = whole[:place] + struct.pack("<4i", -(2**31), -(2**31), 2**31 - 1, 2**31 - 1) + whole[place + 16 :]
    for name, content in bombs.items():
        (tmp_path / name).write_bytes(content)
        said = r"decodes to \d+ MiB, 1024 MiB are allowed: make it smaller, or set JAXRT_MAX_FILE_SIZE=\d+$"
        with pytest.raises(ValueError, match="cannot be read as" if name == "c.png" else said), no_hang():
            load_image(tmp_path / name)
    monkeypatch.setenv("JAXRT_MAX_FILE_SIZE", "1e6")
    with pytest.raises(ValueError, match=r"a\.png: cannot be read as \.png \("):
        load_image(tmp_path / "a.png")


def test_l7_damaged_pictures_are_never_drawn(tmp_path, capfd):
    """Pillow draws what it can of a PNG that is cut off; OpenEXR talks to the terminal."""
    save_image(tmp_path / "a.png", np.random.default_rng(0).random((9, 9, 3)))
    save_image(tmp_path / "a.exr", np.random.default_rng(0).random((9, 9, 3), np.float32))
    for name in ("a.png", "a.exr"):
        whole = (tmp_path / name).read_bytes()
        for end in range(8, len(whole), 7):
            (tmp_path / name).write_bytes(whole[:end])
            with pytest.raises(ValueError, match=r"^/.*: cannot be read as \.... \(.+\): check the file$"):
                load_image(tmp_path / name)
    assert capfd.readouterr() == ("", "")


def test_l7_sixteen_bits_of_grey_are_not_clipped_to_eight(tmp_path):
    Image.fromarray(np.array([[0, 300, 65535]], np.uint16)).save(tmp_path / "a.png")
    expected = (np.array([0, 300, 65535]) / 65535) ** 2.2
    np.testing.assert_allclose(load_image(tmp_path / "a.png"), np.repeat(expected[None, :, None], 3, -1), rtol=1e-6)


def test_l7_only_png_is_read_as_png(tmp_path):
    Image.fromarray(np.zeros((2, 2, 3), np.uint8)).save(tmp_path / "a.gif")
    (tmp_path / "a.gif").rename(tmp_path / "a.png")
    with pytest.raises(ValueError, match="is no PNG file"):
        load_image(tmp_path / "a.png")
    OpenEXR.File({}, {"Z": np.zeros((2, 2), np.float32)}).write(str(tmp_path / "z.exr"))
    with pytest.raises(ValueError, match=r"has no channel Y"):
        load_image(tmp_path / "z.exr")


# Reports of fits


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\xff\xfe", "is no report of a fit"),
        ("[" * 100_000, "is no report of a fit"),
        ({"parameters": [1]}, "is no report of a fit"),
        ({"progress": {"stage": 1, "vector": [1, 2, "3"], "losses": []}}, "is no report of a fit"),
        ({"progress": {"stage": 1, "vector": [1, 2, 1e39], "losses": []}}, "is no report of a fit"),
        ({"progress": {"stage": 1, "vector": [1, 2, 10**400], "losses": []}}, "is no report of a fit"),
        ({"progress": {"stage": 1, "vector": [1, 2], "losses": []}}, "has 2 unknowns where the fit has others"),
        ({"progress": {"stage": 9, "vector": [1, 2, 3], "losses": []}}, "stage 9 is none of a fit"),
        ({"parameters": {"camera.fov" * 999: {}}}, "is of another fit"),
    ],
)
def test_l7_damaged_reports_of_fits(tmp_path, content, message):
    sound = {"parameters": {"lights.position[0]": {}}, "progress": {"stage": 1, "vector": [1, 2, 3], "losses": [0.5]}}
    (tmp_path / "a.toml").write_text(BALL)
    scene = jaxrt.load_scene(tmp_path / "a.toml")
    unknowns = unknowns_of(scene, {"lights.position[0]": parse_selector("lights.position[0]", scene)})
    path = tmp_path / "fit.json"
    path.write_text(json.dumps(sound))
    assert read_progress(path, unknowns).losses == (0.5,)
    text = json.dumps(sound | content) if isinstance(content, dict) else content
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(FitError, match=message) as told:
        read_progress(path, unknowns)
    assert str(told.value).startswith(f"{path}: ") and len(str(told.value)) < 300
