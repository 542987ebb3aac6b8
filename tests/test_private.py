"""The private folder of kept programs, and JAX's own files in it: whose they are, whole, bounded, forgotten in time."""

import os
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import pytest

import jaxrt
from jaxrt import programs
from jaxrt.cli import start
from jaxrt.programs import KEPT, jax_files
from jaxrt.programs.jax_files import lend, take_back
from jaxrt.programs.kept import file_of, write_program
from jaxrt.programs.key import key_of
from jaxrt.programs.private import NotPrivate, cache_folder, private_folder
from jaxrt.render import prepare
from tests.command import run, working_folder

ROOT = Path(jaxrt.__file__).parents[1]


def test_l1_folders_are_made_for_their_owner_only(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        folder = private_folder(tmp_path / "a/b/jaxrt")
    finally:
        os.umask(before)
    assert all(place.stat().st_mode & 0o7777 == 0o700 for place in (folder, folder.parent, folder.parents[1]))
    # One that others could only look into is shut
    folder.chmod(0o755)
    assert private_folder(folder).stat().st_mode & 0o7777 == 0o700


def test_l1_a_folder_of_the_user_may_lie_where_all_may_write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "shared").mkdir()
    (tmp_path / "shared").chmod(0o1777)
    private_folder(tmp_path / "shared/mine/jaxrt")
    # But not one that anybody made
    inode, stat_of = (tmp_path / "shared/mine").stat().st_ino, os.fstat

    def strange(descriptor: int) -> Any:
        found = stat_of(descriptor)
        return os.stat_result([*found[:4], os.getuid() + 1, *found[5:]]) if found.st_ino == inode else found

    monkeypatch.setattr("jaxrt.programs.private.os.fstat", strange)
    with pytest.raises(NotPrivate, match="mine: belongs to another user"):
        private_folder(tmp_path / "shared/mine/jaxrt")


def test_l1_only_absolute_places_count(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    for relative in ("", "cache", "./cache", "../cache", "~/cache"):
        monkeypatch.setenv("XDG_CACHE_HOME", relative)
        assert cache_folder() == tmp_path / "home/.cache/jaxrt"
    monkeypatch.setenv("XDG_CACHE_HOME", f"{tmp_path}/x/../y")
    assert cache_folder() == tmp_path / "y/jaxrt"
    monkeypatch.setenv("XDG_CACHE_HOME", "cache")
    monkeypatch.setenv("HOME", "home")
    with pytest.raises(NotPrivate, match="no home folder is known"):
        cache_folder()
    with pytest.raises(NotPrivate, match="not absolute"):
        private_folder(Path("cache"))


# JAX's own files


def names(folder: Path) -> set[str]:
    return {file.name for file in folder.iterdir()}


@pytest.fixture
def lent(tmp_path: Path) -> Iterator[Path]:
    """A folder in which two of JAX's files are kept."""
    folder = private_folder(tmp_path / "jaxrt")
    loan = lend(folder)
    for name in ("jit_a-1-cache", "jit_b-2-cache"):
        (loan.run / name).write_bytes(name.encode())
    take_back(loan)
    assert names(folder) == {"jax"}
    yield folder


def test_l1_files_of_jax_are_for_their_owner_only(lent: Path) -> None:
    loan = lend(lent)
    assert names(loan.run) == {"jit_a-1-cache", "jit_b-2-cache"}
    for place in (lent, loan.store, loan.run):
        assert place.stat().st_mode & 0o7777 == 0o700
    assert all(file.stat().st_mode & 0o7777 == 0o600 for file in loan.store.iterdir())
    take_back(loan)
    (lent / "jax").chmod(0o777)
    with pytest.raises(NotPrivate):
        lend(lent)


def test_l2_a_damaged_file_of_jax_is_not_lent(lent: Path) -> None:
    first, second = sorted((lent / "jax").iterdir())
    first.write_bytes(first.read_bytes()[:-1] + b"!")
    loan = lend(lent)
    assert names(loan.run) == {"jit_b-2-cache"} and names(loan.store) == {second.name}
    take_back(loan)


def test_l2_a_killed_run_has_jax_forget_its_files_and_a_living_one_has_not(lent: Path) -> None:
    living = lend(lent)
    beside = lend(lent)
    assert len(names(beside.run)) == 2
    take_back(beside)
    os.close(living.lock)  # as when a process is killed
    after = lend(lent)
    assert names(after.run) == names(after.store) == set() and not living.run.exists()
    take_back(after)


def test_l2_files_of_jax_are_bounded(lent: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for i, file in enumerate(sorted((lent / "jax").iterdir())):
        os.utime(file, (i, i))
    monkeypatch.setattr(jax_files, "LARGEST", 26)
    loan = lend(lent)
    (loan.run / "jit_c-3-cache").write_bytes(b"new".ljust(13))
    take_back(loan)
    assert {name[:5] for name in names(lent / "jax")} == {"jit_b", "jit_c"}


def test_jax_is_lent_its_files(lent: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    options: dict[str, Any] = {}
    at_exit: list[Any] = []
    monkeypatch.setattr(jax.config, "update", options.__setitem__)
    monkeypatch.setattr("jaxrt.programs.jax_files.atexit.register", lambda *call: at_exit.append(call))
    programs.lend_jax_files(lent)
    run_folder = Path(options["jax_compilation_cache_dir"])
    assert len(names(run_folder)) == 2 and options["jax_persistent_cache_enable_xla_caches"] == "none"
    ((back, loan),) = at_exit
    back(loan)
    assert not run_folder.exists() and len(names(lent / "jax")) == 2


def test_without_locks_jax_is_lent_nothing(lent: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(*arguments: Any) -> None:
        raise OSError(37, "No locks available")

    monkeypatch.setattr("jaxrt.programs.jax_files.fcntl.flock", unknown)
    with pytest.raises(OSError, match="No locks available"):
        lend(lent)
    assert names(lent) == {"jax"}


def test_a_folder_without_room_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    def full(folder: Path) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR", raising=False)
    monkeypatch.setattr(start, "use_cpu_cores", lambda cores: None)
    monkeypatch.setattr(start.gc, "disable", lambda: None)
    monkeypatch.setattr(start, "lend_jax_files", full)
    assert start.start_jax(1) is None
    assert capsys.readouterr().err == (
        f"jaxrt: warning: compiled programs are not kept: {tmp_path}/jaxrt: No space left on device: "
        "make room, or set XDG_CACHE_HOME\n"
    )


def test_info_says_whether_a_program_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    """From its key: nothing is compiled or loaded."""
    working, folder = working_folder(tmp_path, monkeypatch), private_folder(tmp_path / "jaxrt")
    monkeypatch.setattr(programs, "_compile", None)
    monkeypatch.setattr(programs, "deserialize_and_load", None)
    assert run(capsys, "info", "ball.toml")[1].endswith("\nprogram: not kept, the first render compiles\n")
    monkeypatch.setattr(start, "start_jax", lambda cores: folder)
    assert run(capsys, "info", "ball.toml")[1].endswith("\nprogram: not kept, the first render compiles\n")
    key = key_of(*prepare(jaxrt.load_scene(working / "ball.toml"), 0, 0, 0, 2))
    write_program(file_of(folder, key), key, b"not even looked into")
    assert run(capsys, "info", "ball.toml")[1].endswith("\nprogram: kept\n")


def test_the_page_tells_how_the_folder_is_emptied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = (ROOT / "docs/kept-programs.md").read_text()
    info, empty = re.findall(r"^```sh\n(.*?)\n```", page, re.MULTILINE | re.DOTALL)
    assert info.startswith("jaxrt info")  # tested above
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    folder = private_folder(cache_folder())
    subprocess.run(["sh", "-c", empty], check=True)
    assert not folder.exists() and folder.parent.exists()
    assert f"the {KEPT} programs" in page and f"{jax_files.LARGEST >> 20} MiB" in page
