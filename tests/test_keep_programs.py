"""Programs kept between Python processes: found again, in silence, in a folder of the user's own."""

import hashlib
import os
import stat
import subprocess
import sys
import zlib
from pathlib import Path

import jax
import pytest

import jaxrt
from jaxrt.programs import keep
from jaxrt.programs.matching import matching

ROOT = Path(jaxrt.__file__).parents[1]
PROCESS = """
import sys, jaxrt, jax, jax.numpy as jnp
jax.monitoring.register_event_listener(lambda event, **_: event.endswith("cache_misses") and print("compiled"))
jnp.ones(7) + 1
assert jaxrt.keep_programs(sys.argv[1]) == jaxrt.keep_programs(sys.argv[1])
scene = jaxrt.build({
    "camera": {"position": [0, 0, 3], "width": 4, "height": 4},
    "spheres": [{"center": [0, 0, 0], "radius": 1, "material": "white"}],
    "materials": {"white": {"type": "diffuse", "albedo": [0.5, 0.5, 0.5]}},
    "environment": {"radiance": [1, 1, 1]},
})
print(jaxrt.render(scene, 0, spp=1, max_depth=1).sum())
"""


def process(folder):
    """Return what a process prints that keeps its programs there, without a line "compiled" for each compilation."""
    told = subprocess.run(
        [sys.executable, "-c", PROCESS, str(folder)],
        env={**os.environ, "PYTHONPATH": str(ROOT), "TF_CPP_MIN_LOG_LEVEL": "0", "JAX_COMPILATION_CACHE_DIR": ""},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert told.returncode == 0, told.stderr
    *compiled, radiance = told.stdout.splitlines()
    return len(compiled), radiance, [line for line in told.stderr.splitlines() if not line.startswith("I")]


def as_if_compiled_for_avx512(content):
    """Return a kept file whose program says that it needs what no CPU has, as XLA has it for CPUs with AVX-512."""
    plain = zlib.decompress(content)
    return zlib.compress(plain.replace(b"-avx512bf16,-avx512bitalg", b"+prefer-no-gather,-avx512"))


def test_s5_a_second_process_compiles_nothing_and_says_nothing(tmp_path):
    folder = tmp_path / "kept"
    compiled, radiance, told = process(folder)
    assert compiled and told == []
    assert {stat.S_IMODE(place.stat().st_mode) for place in (folder, folder / "jax")} == {0o700}
    for file in list((folder / "jax").iterdir()):
        assert stat.S_IMODE(file.stat().st_mode) == 0o600
        content = matching(as_if_compiled_for_avx512(file.read_bytes()))
        file.unlink()
        file.with_suffix(f".{hashlib.sha256(content).hexdigest()[:32]}").write_bytes(content)
    assert process(folder) == (0, radiance, [])


def test_s2_preferences_are_stored_as_not_needed():
    plain = b"\0features+avx2,+prefer-no-gather,+prefer-no-scatter,-rtm\0" * 3
    wanted = plain.replace(b"+prefer", b"-prefer")
    assert matching(plain) == wanted and matching(wanted) == wanted
    assert zlib.decompress(matching(zlib.compress(plain))) == wanted
    for other in (b"", b"\x28\xb5\x2f\xfdcut", zlib.compress(b"nothing to do", 1), zlib.compress(plain)[:-1]):
        assert matching(other) == other


@pytest.mark.parametrize("folder", [3, "", None.__class__, ["a"]])
def test_s5_what_names_no_folder(folder):
    with pytest.raises(ValueError, match="^keep_programs: folder is .+: pass a path, or none for the folder of your"):
        jaxrt.keep_programs(folder)


@pytest.fixture
def nowhere_yet():
    """Let JAX keep its programs nowhere, whatever ran before in this process."""
    before = jax.config.values["jax_compilation_cache_dir"]
    jax.config.update("jax_compilation_cache_dir", None)
    yield
    jax.config.update("jax_compilation_cache_dir", before)


def test_s5_folders_that_others_can_write_in(tmp_path, monkeypatch, nowhere_yet):
    monkeypatch.setattr(keep, "_kept", [])
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o777)
    (tmp_path / "link").symlink_to(tmp_path)
    (tmp_path / "file").touch()
    for name, told in (
        ("open", "others may write in it"),
        ("link", "is a link or no folder"),
        ("file", "is a link or"),
    ):
        with pytest.raises(ValueError, match=told) as refused:
            jaxrt.keep_programs(tmp_path / name / "programs" if name == "link" else tmp_path / name)
        assert "XDG_CACHE_HOME" not in str(refused.value) and str(refused.value).isprintable()


def test_s5_one_folder_a_process(tmp_path, monkeypatch):
    line = (
        "^keep_programs: JAX keeps its programs in .+ already: call it once, and without jax_compilation_cache_dir or"
    )
    monkeypatch.setattr(keep, "_kept", [tmp_path / "a"])
    assert jaxrt.keep_programs(tmp_path / "a") == tmp_path / "a"
    with pytest.raises(ValueError, match=line):
        jaxrt.keep_programs(tmp_path / "b")
    monkeypatch.setattr(keep, "_kept", [])
    before = jax.config.values["jax_compilation_cache_dir"]
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    try:
        with pytest.raises(ValueError, match=line):
            jaxrt.keep_programs(tmp_path / "b")
    finally:
        jax.config.update("jax_compilation_cache_dir", before)
