"""Files appear whole or not at all: whoever else writes, whatever was planted, and however it ends."""

import errno
import os
import resource
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from jaxrt import cli
from jaxrt.cli.errors import UsageError
from jaxrt.cli.start import check_output
from jaxrt.core.writing import write_whole
from jaxrt.fit.files import Target, draw_before_after, draw_losses, write_report
from jaxrt.io.image import load_image, save_image
from tests.command import run, working_folder

PICTURE = np.linspace(0, 1, 40 * 30 * 3, dtype=np.float32).reshape(30, 40, 3)


def draw_errors(path: Path) -> None:
    draw_before_after(path, [Target(PICTURE, np.ones_like(PICTURE), ())], PICTURE / 2, PICTURE / 3)


WRITERS: dict[str, Callable[[Path], None]] = {
    "a.png": lambda path: save_image(path, PICTURE),
    "a.exr": lambda path: save_image(path, PICTURE),
    "fit.json": lambda path: write_report(path, {"losses": PICTURE[..., 0]}),
    "loss.png": lambda path: draw_losses(path, (3.0, 2.0, 1.0)),
    "before_after.png": draw_errors,
}


@contextmanager
def files_of_at_most(size: int) -> Iterator[None]:
    """Let the system refuse larger files, as a full disk does."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("name", WRITERS)
def test_l3_a_planted_link_is_replaced_and_its_target_untouched(tmp_path: Path, name: str) -> None:
    precious, path = tmp_path / "precious", tmp_path / name
    precious.write_text("precious")
    path.symlink_to(precious)
    WRITERS[name](path)
    assert precious.read_text() == "precious" and path.is_file() and not path.is_symlink()
    assert {p.name for p in tmp_path.iterdir()} == {"precious", name}


@pytest.mark.parametrize("name", WRITERS)
def test_l3_l5_a_full_disk_is_one_reason_and_the_old_file_stays(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(b"old")
    with files_of_at_most(100), pytest.raises(OSError) as caught:
        WRITERS[name](path)
    assert (caught.value.errno, caught.value.filename) == (errno.EFBIG, str(path))
    assert path.read_bytes() == b"old" and list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("output", ["a.png", "a.exr"])
def test_l5_the_command_says_in_one_line_why_nothing_is_written(tmp_path, monkeypatch, capsys, output) -> None:
    folder = working_folder(tmp_path, monkeypatch)
    for name in ("b.exr", "c.exr"):
        save_image(folder / name, PICTURE if name[0] == "b" else 2 * PICTURE)
    with files_of_at_most(100):
        status, _, err = run(capsys, "diff", "b.exr", "c.exr", "-o", output)
    assert (status, err) == (2, f"jaxrt: error: {output}: File too large: choose another file\n")
    assert not (folder / output).exists()


def test_l3_a_disk_that_fails_at_last_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("jaxrt.core.writing.os.fsync", fail)
    with pytest.raises(OSError, match="No space left on device: .*a.png"):
        save_image(tmp_path / "a.png", PICTURE)
    assert list(tmp_path.iterdir()) == []


def test_l5_an_error_without_a_number_has_a_reason_all_the_same(tmp_path: Path) -> None:
    def write(file: object) -> None:
        raise OSError("encoder error -2 when writing image file")

    with pytest.raises(OSError) as caught:
        write_whole(tmp_path / "a", write)
    assert (caught.value.strerror, caught.value.filename) == (
        "encoder error -2 when writing image file",
        f"{tmp_path}/a",
    )


@pytest.mark.parametrize("suffix", [".png", ".exr", ".json"])
def test_l3_threads_that_write_one_path_leave_one_whole_file(tmp_path: Path, suffix: str) -> None:
    path, troubles = tmp_path / f"a{suffix}", []
    pictures = [np.full((20, 20, 3), shade / 8, np.float32) for shade in range(4)]

    def save(i: int) -> None:
        if suffix == ".json":
            write_whole(path, lambda file: [file.write(bytes([i])) for _ in range(1000)])
        else:
            save_image(path, pictures[i])

    def write(i: int) -> None:
        try:
            for _ in range(25):
                save(i)
                content = path.read_bytes() if suffix == ".json" else load_image(path)
                whole = len(set(content)) == 1 if suffix == ".json" else float(np.ptp(content)) == 0
                if not whole or len(content) != (1000 if suffix == ".json" else 20):
                    troubles.append("a broken file")
        except Exception as error:
            troubles.append(repr(error))

    threads = [threading.Thread(target=write, args=(i,)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert troubles == [] and list(tmp_path.iterdir()) == [path]


def test_l3_parts_of_dead_processes_are_swept_and_those_of_live_ones_are_not(tmp_path: Path) -> None:
    code = (
        "import sys, time; from pathlib import Path; from jaxrt.core.writing import write_whole\n"
        "def write(file):\n    file.write(b'half'); file.flush(); print('writing', flush=True); time.sleep(600)\n"
        "write_whole(Path('a.png'), write)"
    )
    environment = os.environ | {"PYTHONPATH": str(Path(cli.__file__).parents[2])}
    with subprocess.Popen([sys.executable, "-c", code], cwd=tmp_path, stdout=subprocess.PIPE, env=environment) as child:
        assert child.stdout is not None and child.stdout.readline() == b"writing\n"
        (part,) = tmp_path.iterdir()
        (tmp_path / ".jaxrt-0123456789abcdef").write_bytes(b"left by a dead one")
        os.mkfifo(tmp_path / ".jaxrt-fedcba9876543210")
        (tmp_path / ".jaxrt-notes").write_bytes(b"the user's own")
        save_image(tmp_path / "b.png", PICTURE)
        assert {p.name for p in tmp_path.iterdir()} - {".jaxrt-fedcba9876543210"} == {
            part.name,
            "b.png",
            ".jaxrt-notes",
        }
        child.kill()
    save_image(tmp_path / "b.png", PICTURE)
    assert not part.exists() and (tmp_path / ".jaxrt-notes").exists()


def test_l3_an_interrupted_writer_leaves_nothing(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_bytes(b"old")

    def interrupted(file: object) -> None:
        signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        write_whole(path, interrupted)
    assert path.read_bytes() == b"old" and list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("suffix", [".png", ".exr"])
def test_l3_every_legal_name_can_be_written(tmp_path: Path, suffix: str) -> None:
    longest = "n" * (255 - len(suffix)) + suffix
    save_image(tmp_path / longest, PICTURE)
    assert [p.name for p in tmp_path.iterdir()] == [longest]


@pytest.mark.parametrize("suffix", [".png", ".exr"])
def test_l3_names_that_are_no_text_can_be_written(tmp_path: Path, suffix: str) -> None:
    folder = tmp_path / os.fsdecode(b"caf\xe9")
    folder.mkdir()
    save_image(folder / os.fsdecode(b"\xff" + suffix.encode()), PICTURE)
    assert os.listdir(os.fsencode(folder)) == [b"\xff" + suffix.encode()]


def test_l3_names_too_long_are_refused_before_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for path in (Path("n" * 252 + ".png"), Path("é" * 126 + ".png"), tmp_path / "/".join(["d" * 200] * 25) / "a.png"):
        with pytest.raises(UsageError, match="File name too long: choose another file"):
            check_output(path)
    check_output(Path("n" * 251 + ".png"))
    assert list(tmp_path.iterdir()) == []


def test_l3_pipes_and_folders_are_no_place_for_a_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.png")
    (tmp_path / "b.png").mkdir()
    for name, message in (("a.png", "is a device or a pipe, not a file"), ("b.png", "is a folder")):
        with pytest.raises(UsageError, match=message):
            check_output(tmp_path / name)
        with pytest.raises(OSError, match=name):
            save_image(tmp_path / name, PICTURE)
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize("mode", [0o600, 0o640, 0o444, 0o755])
def test_l3_a_file_keeps_its_mode(tmp_path: Path, mode: int) -> None:
    path = tmp_path / "a.png"
    path.touch()
    path.chmod(mode)
    save_image(path, PICTURE)
    assert path.stat().st_mode & 0o7777 == mode and path.stat().st_size


@pytest.mark.parametrize(("umask", "mode"), [(0o022, 0o644), (0o077, 0o600), (0o002, 0o664)])
def test_l3_a_new_file_has_the_mode_of_new_files(tmp_path: Path, umask: int, mode: int) -> None:
    (tmp_path / "secret").touch(mode=0o600)
    (tmp_path / "b.png").symlink_to(tmp_path / "secret")
    before = os.umask(umask)
    try:
        for name in ("a.png", "b.png"):
            save_image(tmp_path / name, PICTURE)
            assert (tmp_path / name).stat().st_mode & 0o7777 == mode
    finally:
        os.umask(before)


def test_l3_content_and_name_reach_the_disk_in_this_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[str] = []
    fsync, replace = os.fsync, os.replace

    def synced(descriptor: int) -> None:
        done.append("folder" if os.path.isdir(f"/dev/fd/{descriptor}") else "file")
        fsync(descriptor)

    def renamed(source: Path, target: Path) -> None:
        done.append("name")
        replace(source, target)

    monkeypatch.setattr("jaxrt.core.writing.os.fsync", synced)
    monkeypatch.setattr("jaxrt.core.writing.os.replace", renamed)
    save_image(tmp_path / "a.png", PICTURE)
    assert done == ["file", "name", "folder"]
