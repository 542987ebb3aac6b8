"""Compiled programs kept in a folder: the same picture, another file for another structure, damage mended."""

import os
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrt
from jaxrt.programs import KEPT, load_or_compile
from jaxrt.render import prepare, sum_parts

SCENE = {
    "camera": {"position": [0, 0, 55], "width": 16, "height": 8},
    "materials": {"white": {"type": "diffuse", "albedo": [0.8, 0.8, 0.8]}},
    "spheres": [{"center": [0, 0, 0], "radius": 10, "material": "white"}],
    "lights": [{"position": [-10, 20, 40], "intensity": 3000}],
}


def programs(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.program"))


@pytest.mark.parametrize("devices", [1, 2])
def test_a_kept_program_draws_the_same_picture(tmp_path: Path, devices: int) -> None:
    scene, run, plan = prepare(jaxrt.build(SCENE), 3, 0, 4, 4, max_depth=1, devices=jax.devices()[:devices])
    expected = np.asarray(sum_parts(scene, run, plan))
    for _ in range(2):  # compiled, then loaded
        np.testing.assert_array_equal(load_or_compile(tmp_path, scene, run, plan)(scene, run), expected)
    (file,) = programs(tmp_path)
    # Other values, the same program
    other, run, plan = prepare(
        jaxrt.with_parameters(scene, {"lights.position": jnp.array([[10.0, 20, 40]])}), 3, 0, 4, 4,
        max_depth=1, devices=jax.devices()[:devices],
    )  # fmt: skip
    loaded = load_or_compile(tmp_path, other, run, plan)
    np.testing.assert_array_equal(loaded(other, run), sum_parts(other, run, plan))
    assert programs(tmp_path) == [file]


def test_another_structure_is_another_program(tmp_path: Path) -> None:
    for change in ({}, {"environment": {"radiance": [1, 1, 1]}}, {"camera": SCENE["camera"] | {"width": 17}}):
        load_or_compile(tmp_path, *prepare(jaxrt.build(SCENE | change), 0, 0, 1, 1, max_depth=1))
    load_or_compile(tmp_path, *prepare(jaxrt.build(SCENE), 0, 0, 1, 1, max_depth=2))
    assert len(programs(tmp_path)) == 4


def test_a_program_that_loads_but_does_not_run_is_compiled_anew(tmp_path: Path) -> None:
    arguments = prepare(jaxrt.build(SCENE), 0, 0, 1, 1, max_depth=1)
    load_or_compile(tmp_path, *prepare(jaxrt.build(SCENE | {"environment": {"radiance": [1, 1, 1]}}), 0, 0, 1, 1))
    (other,) = programs(tmp_path)
    load_or_compile(tmp_path, *arguments)
    (file,) = {*programs(tmp_path)} - {other}
    wrong = other.read_bytes()
    file.write_bytes(wrong)
    np.testing.assert_array_equal(load_or_compile(tmp_path, *arguments)(*arguments[:2]), sum_parts(*arguments))
    assert file.read_bytes() != wrong


def test_a_program_is_kept_whole_and_for_its_owner_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    arguments = prepare(jaxrt.build(SCENE), 0, 0, 1, 1, max_depth=1)

    def full(source: Path, target: Path) -> None:
        raise OSError(28, "No space left on device", str(target))

    with monkeypatch.context() as context:
        context.setattr("jaxrt.writing.os.replace", full)
        program = load_or_compile(tmp_path, *arguments)
    assert list(tmp_path.iterdir()) == [] and program(*arguments[:2]).shape[-1] == 3
    load_or_compile(tmp_path, *arguments)
    (file,) = tmp_path.iterdir()
    assert file.suffix == ".program" and file.stat().st_mode & 0o777 == 0o600


def test_programs_not_used_for_long_are_forgotten(tmp_path: Path) -> None:
    for i in range(KEPT):
        file = tmp_path / f"{i}.program"
        file.touch()
        os.utime(file, (i, i))
    load_or_compile(tmp_path, *prepare(jaxrt.build(SCENE), 0, 0, 1, 1, max_depth=1))
    assert len(programs(tmp_path)) == KEPT and not (tmp_path / "0.program").exists()


def test_a_damaged_program_is_compiled_anew(tmp_path: Path) -> None:
    arguments = prepare(jaxrt.build(SCENE), 0, 0, 1, 1, max_depth=1)
    load_or_compile(tmp_path, *arguments)
    (file,) = programs(tmp_path)
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2])
    np.testing.assert_array_equal(load_or_compile(tmp_path, *arguments)(*arguments[:2]), sum_parts(*arguments))
    assert programs(tmp_path) == [file] and len(file.read_bytes()) > len(whole) // 2
