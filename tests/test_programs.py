"""Compiled programs kept in a folder: the same picture, never another's program, never one that killed a process."""

import os
import pickle
import random
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrt
from jaxrt import programs
from jaxrt.cli import start
from jaxrt.programs import KEPT, is_kept, load_or_compile
from jaxrt.programs import key as key_module
from jaxrt.programs.kept import MAGIC, file_of, read_program, write_program
from jaxrt.programs.private import NotPrivate, private_folder
from jaxrt.programs.trial import on_trial
from jaxrt.render import prepare, scene_tables
from jaxrt.transport.interior import sum_share

pytestmark = pytest.mark.quick

SCENE: dict[str, Any] = {
    "camera": {"position": [0, 0, 55], "width": 16, "height": 12},
    "materials": {"white": {"type": "diffuse", "albedo": [0.8, 0.8, 0.8]}},
    "spheres": [{"center": [0, 0, 0], "radius": 10, "material": "white"}],
    "lights": [{"position": [-10, 20, 40], "intensity": 3000}],
}
FIRST = np.int32(0)
ROOT = Path(jaxrt.__file__).parents[1]


def arguments_of(changes: Any = (), **options: Any) -> Any:
    options = {"max_depth": 1} | options
    return with_tables(*prepare(jaxrt.build(SCENE | dict(changes)), 3, 0, 4, 4, **options))


def with_tables(scene: Any, drawn: Any, plan: Any) -> Any:
    return scene, scene_tables(scene), drawn, plan


def share_of(scene: Any, tables: Any, drawn: Any, plan: Any) -> Any:
    return sum_share(tables, drawn, FIRST, plan)


def key_of(scene: Any, tables: Any, drawn: Any, plan: Any) -> bytes:
    return key_module.key_of(scene, drawn, plan)


def kept_in(folder: Path, scene: Any, tables: Any, drawn: Any, plan: Any) -> bool:
    return is_kept(folder, scene, drawn, plan)


class Shared(NamedTuple):
    """One program that most tests share: its arguments, its key, its file's content, its picture."""

    arguments: Any
    program: Any
    key: bytes
    content: bytes
    picture: np.ndarray


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Shared:
    folder, arguments = tmp_path_factory.mktemp("kept"), arguments_of()
    program = load_or_compile(folder, *arguments)
    name = key_of(*arguments)
    picture = np.asarray(program(*arguments[1:3], FIRST))
    return Shared(arguments, program, name, file_of(folder, name).read_bytes(), picture)


class Kept(NamedTuple):
    """A folder with the shared program in it; what is compiled and loaded there is counted."""

    folder: Path
    file: Path
    compiled: list[str]
    loaded: list[str]
    shared: Shared

    def draw(self) -> None:
        """Ask for the program, and see that its picture is the right one."""
        program = load_or_compile(self.folder, *self.shared.arguments)
        np.testing.assert_array_equal(program(*self.shared.arguments[1:3], FIRST), self.shared.picture)

    def put(self, content: bytes) -> None:
        self.file.unlink(missing_ok=True)
        self.file.touch(mode=0o600)
        self.file.write_bytes(content)


@pytest.fixture
def kept(tmp_path: Path, shared: Shared, monkeypatch: pytest.MonkeyPatch) -> Kept:
    folder = private_folder(tmp_path / "jaxrt")
    found = Kept(folder, file_of(folder, shared.key), [], [], shared)
    found.put(shared.content)
    load = programs.deserialize_and_load

    def compiled(*arguments: Any) -> Any:
        found.compiled.append("compiled")
        return shared.program

    def loaded(*arguments: Any, **options: Any) -> Any:
        found.loaded.append("loaded")
        return load(*arguments, **options)

    monkeypatch.setattr(programs, "_compile", compiled)
    monkeypatch.setattr(programs, "deserialize_and_load", loaded)
    return found


def test_a_kept_program_draws_the_same_picture(kept: Kept) -> None:
    np.testing.assert_array_equal(kept.shared.picture, share_of(*kept.shared.arguments))
    kept.draw()
    # Other values, the same program
    scene, _, drawn, plan = kept.shared.arguments
    other = jaxrt.with_parameters(scene, {"lights.position": jnp.array([[10.0, 20, 40]])})
    arguments = with_tables(other, drawn, plan)
    loaded = load_or_compile(kept.folder, *arguments)
    np.testing.assert_array_equal(loaded(*arguments[1:3], FIRST), share_of(*arguments))
    assert kept.compiled == [] and list(kept.folder.iterdir()) == [kept.file]


def test_what_changes_the_program_changes_the_key(shared: Shared) -> None:
    changes = ({"environment": {"radiance": [1, 1, 1]}}, {"camera": SCENE["camera"] | {"width": 17}})
    keys = [shared.key, *(key_of(*arguments_of(change)) for change in changes)]
    keys += [
        key_of(*arguments_of(**option))
        for option in ({"max_depth": 2}, {"devices": jax.devices()[1:]}, {"sampler": "stratified"})
    ]
    assert len(set(keys)) == 6
    bright = arguments_of({"lights": [{"position": [1, 2, 40], "intensity": 5}]})
    assert key_of(*bright) == shared.key


OTHERS = {
    "jaxrt.programs.key.cpu_features": lambda: "flags: sse2",
    "jaxrt.programs.key.code": lambda: "other sources",
    "jaxrt.programs.key.platform.python_version": lambda: "3.0",
    "jaxrt.programs.key.platform.libc_ver": lambda: ("musl", "1"),
    "jax.__version__": "0.0.1",
    "jaxlib.__version__": "0.0.1",
}


@pytest.mark.parametrize("change", [*OTHERS, "XLA_FLAGS", "precision"])
def test_l2_the_machine_and_the_settings_are_in_the_key(kept: Kept, monkeypatch, change: str) -> None:
    assert kept_in(kept.folder, *kept.shared.arguments)
    with monkeypatch.context() as context, jax.default_matmul_precision("float32" if change == "precision" else None):
        if change in OTHERS:
            context.setattr(change, OTHERS[change])
        if change == "XLA_FLAGS":
            context.setenv("XLA_FLAGS", "--xla_cpu_enable_fast_math=true")
        assert not kept_in(kept.folder, *kept.shared.arguments)
    assert kept_in(kept.folder, *kept.shared.arguments)


def test_l2_settings_that_change_no_code_are_not_in_the_key(shared: Shared, monkeypatch) -> None:
    monkeypatch.setitem(jax.config.values, "jax_compilation_cache_dir", "/elsewhere")
    monkeypatch.setenv("XDG_CACHE_HOME", "/elsewhere")
    assert key_of(*shared.arguments) == shared.key


# Trust


class Planted:
    """What runs when it is unpickled."""

    def __init__(self, trace: Path) -> None:
        self.trace = trace

    def __reduce__(self) -> Any:
        return (os.mkdir, (str(self.trace),))


@pytest.mark.parametrize("head", ["none", "magic", "magic and key", "another's key"])
def test_l1_a_planted_pickle_is_not_loaded(kept: Kept, tmp_path: Path, head: str) -> None:
    heads = {
        "none": b"",
        "magic": MAGIC,
        "magic and key": MAGIC + kept.shared.key + b"\n" + bytes(32),
        "another's key": kept.shared.content[: len(MAGIC)] + b"{}\n" + bytes(32),
    }
    kept.put(heads[head] + pickle.dumps(Planted(tmp_path / "ran")))
    kept.draw()
    assert (kept.loaded, kept.compiled) == ([], ["compiled"]) and not (tmp_path / "ran").exists()
    # Now there is a good one
    kept.draw()
    assert kept.loaded == ["loaded"] and read_program(kept.file, kept.shared.key)


@pytest.mark.parametrize("mode", [0o644, 0o620, 0o602])
def test_l1_a_file_that_others_may_touch_is_not_loaded(kept: Kept, mode: int) -> None:
    kept.file.chmod(mode)
    kept.draw()
    assert (kept.loaded, kept.compiled) == ([], ["compiled"])
    assert kept.file.stat().st_mode & 0o7777 == 0o600


def test_l1_a_planted_link_or_pipe_is_not_loaded(kept: Kept, tmp_path: Path) -> None:
    for plant in ("link", "pipe", "link to nowhere"):
        kept.file.unlink()
        if plant == "link":
            (tmp_path / "other").touch(mode=0o600)
            (tmp_path / "other").write_bytes(kept.shared.content)
        if plant == "pipe":
            os.mkfifo(kept.file, 0o600)
        else:
            kept.file.symlink_to(tmp_path / ("other" if plant == "link" else "none"))
        kept.draw()
        assert kept.loaded == [] and kept.file.is_file() and not kept.file.is_symlink(), plant
    assert (tmp_path / "other").read_bytes() == kept.shared.content and not (tmp_path / "none").exists()


@pytest.mark.parametrize("plant", ["link", "link above", "open", "open to the group", "open above", "a stranger's"])
def test_l1_a_folder_that_may_be_anothers_is_not_used(
    kept: Kept, tmp_path: Path, monkeypatch, capsys, plant: str
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    stat_of, uid = os.fstat, os.getuid()
    match plant:
        case "link":
            kept.folder.rename(tmp_path / "real")
            kept.folder.symlink_to(tmp_path / "real")
        case "link above":
            (tmp_path / "way").symlink_to(tmp_path)
            kept = kept._replace(folder=tmp_path / "way/jaxrt")
            monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "way"))
        case "open":
            kept.folder.chmod(0o777)
        case "open to the group":
            kept.folder.chmod(0o770)
        case "open above":
            tmp_path.chmod(0o777)
        case "a stranger's":
            inode = kept.folder.stat().st_ino

            def strange(descriptor: int) -> Any:
                found = stat_of(descriptor)
                return os.stat_result([*found[:4], uid + 1, *found[5:]]) if found.st_ino == inode else found

            monkeypatch.setattr("jaxrt.programs.private.os.fstat", strange)
    with pytest.raises(NotPrivate):
        private_folder(kept.folder)
    kept.draw()
    assert (kept.loaded, kept.compiled) == ([], [])  # nothing is kept, so JAX's own way is taken
    # And the command says so
    monkeypatch.setattr(start, "use_cpu_cores", lambda cores: None)
    monkeypatch.setattr(start.gc, "disable", lambda: None)
    assert start.start_jax(1) is None
    err = capsys.readouterr().err
    assert err.startswith(f"jaxrt: warning: compiled programs are not kept: {tmp_path}") and err.count("\n") == 1


# Damage


def test_l2_of_fifty_flipped_bits_none_is_loaded(kept: Kept) -> None:
    chosen = random.Random(14)
    whole = kept.shared.content
    head = 8 * (len(whole) - len(read_program(kept.file, kept.shared.key) or b""))
    bits = [chosen.randrange(8 * len(whole)) for _ in range(40)] + [chosen.randrange(head) for _ in range(10)]
    for bit in bits:
        broken = bytearray(whole)
        broken[bit // 8] ^= 1 << bit % 8
        kept.put(bytes(broken))
        assert read_program(kept.file, kept.shared.key) is None, bit
        assert not kept_in(kept.folder, *kept.shared.arguments)
    kept.draw()
    assert (kept.loaded, kept.compiled) == ([], ["compiled"]) and kept_in(kept.folder, *kept.shared.arguments)


@pytest.mark.parametrize("length", [0, 1, 100, 0.5, -1])
def test_l2_a_cut_or_prolonged_program_is_compiled_anew(kept: Kept, length: float) -> None:
    whole = kept.shared.content
    kept.put(whole + b"\0" if length == -1 else whole[: int(length * len(whole)) if 0 < length < 1 else int(length)])
    kept.draw()
    assert (kept.loaded, kept.compiled) == ([], ["compiled"])
    assert read_program(kept.file, kept.shared.key)


def test_l2_another_program_under_the_name_is_not_loaded(kept: Kept) -> None:
    other = key_of(*arguments_of({"environment": {"radiance": [1, 1, 1]}}))
    write_program(file_of(kept.folder, other), other, b"another program")
    os.replace(file_of(kept.folder, other), kept.file)
    kept.draw()
    assert (kept.loaded, kept.compiled) == ([], ["compiled"])


def test_a_program_that_does_not_load_is_compiled_anew(kept: Kept) -> None:
    write_program(kept.file, kept.shared.key, b"whole, but no program")
    kept.draw()
    assert (kept.loaded, kept.compiled) == (["loaded"], ["compiled"])
    assert list(kept.folder.iterdir()) == [kept.file]


# Crashes


def test_l2_a_program_that_killed_a_process_is_not_tried_again(kept: Kept, monkeypatch: pytest.MonkeyPatch) -> None:
    code = (
        "import os, signal, sys; from pathlib import Path; from jaxrt.programs.trial import on_trial\n"
        "with on_trial(Path(sys.argv[1])) as died:\n    assert not died\n    os.kill(os.getpid(), signal.SIGILL)"
    )
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    child = subprocess.run([sys.executable, "-c", code, kept.file], env=environment, capture_output=True)
    assert child.returncode == -4
    unlink = os.unlink

    def unmarked(path: Path) -> None:
        if Path(path).suffix == ".trial":
            assert not kept.file.exists()  # else another might try it between
        unlink(path)

    with monkeypatch.context() as context:
        context.setattr("jaxrt.programs.trial.os.unlink", unmarked)
        kept.draw()
    assert (kept.loaded, kept.compiled) == ([], ["compiled"])
    kept.draw()
    assert (kept.loaded, kept.compiled) == (["loaded"], ["compiled"])
    assert list(kept.folder.iterdir()) == [kept.file]


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_l2_a_refused_or_interrupted_trial_is_no_crash(kept: Kept, error: type[BaseException]) -> None:
    with pytest.raises(error), on_trial(kept.file):
        raise error
    kept.draw()
    assert kept.compiled == []


def test_l2_a_trial_of_a_living_process_is_no_crash(kept: Kept) -> None:
    """While one tries, another waits, and then tries too; two at once draw the same picture."""
    order: list[str] = []

    def second() -> None:
        with on_trial(kept.file) as died:
            order.append(f"second, died {died}")

    thread = threading.Thread(target=second)
    with on_trial(kept.file):
        thread.start()
        thread.join(0.3)
        order.append("first")
    thread.join()
    assert order == ["first", "second, died False"]
    threads = [threading.Thread(target=kept.draw) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert kept.compiled == [] and len(kept.loaded) == 3 and list(kept.folder.iterdir()) == [kept.file]


def test_l2_a_trial_without_end_does_not_hold_others_up(kept: Kept, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("jaxrt.programs.trial.PATIENCE", 0.05)
    with on_trial(kept.file):
        kept.draw()
    assert (kept.loaded, kept.compiled) == ([], ["compiled"]) and kept.file.exists()


def test_a_program_that_fails_at_once_is_not_kept(kept: Kept, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*arguments: Any) -> Any:
        def program(*arguments: Any) -> Any:
            raise RuntimeError("does not run")

        return program

    kept.file.unlink()
    monkeypatch.setattr(programs, "_compile", broken)
    with pytest.raises(RuntimeError, match="does not run"):
        kept.draw()
    assert list(kept.folder.iterdir()) == []


# Room


def test_a_full_disk_keeps_nothing_and_draws_all_the_same(kept: Kept, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(source: Path, target: Path) -> None:
        raise OSError(28, "No space left on device", str(target))

    kept.file.unlink()
    with monkeypatch.context() as context:
        context.setattr("jaxrt.core.writing.os.replace", full)
        kept.draw()
    assert list(kept.folder.iterdir()) == []
    kept.draw()
    assert kept.file.stat().st_mode & 0o777 == 0o600


def test_programs_not_used_for_long_are_forgotten(kept: Kept) -> None:
    kept.file.unlink()
    for i in range(KEPT):
        file = kept.folder / f"{i}.program"
        file.touch()
        os.utime(file, (i, i))
    kept.draw()
    assert len(list(kept.folder.iterdir())) == KEPT and not (kept.folder / "0.program").exists()
