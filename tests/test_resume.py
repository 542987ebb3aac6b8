"""A render is never lost: interrupted, killed, diverted, drawn in ranges, it ends as the same picture to the bit."""

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command import BALL, run, working_folder

import jaxrt
from jaxrt import chunks
from jaxrt.cli import progress, signals, streams
from jaxrt.cli.commands import render as command
from jaxrt.io.image import load_image
from jaxrt.io.partial import Partial, read_partial
from jaxrt.transport.film import BLOCK

ROOT = Path(__file__).parents[1]
SPP = 38  # nine blocks and a half
SIDE = Path("ball.exr.partial")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working folder with ball.toml in it, blocks drawn one at a time, and other places for what does not fit."""
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "work").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "elsewhere"))
    monkeypatch.setattr(chunks, "_next_blocks", lambda *_: 1)
    return working_folder(tmp_path / "work", monkeypatch)


def render(capsys, *options, output="ball.exr", scene="ball.toml"):
    options = options if "--spp" in options else ("--spp", SPP, *options)
    return run(capsys, "render", scene, "-o", output, "--sampler", "independent", *options)


@pytest.fixture
def whole(folder, capsys):
    """The bytes of the picture, drawn in one go."""
    assert render(capsys, output="whole.exr")[0] == 0
    return (folder / "whole.exr").read_bytes()


class Struck(BaseException):
    """The end of a process."""


def strike(monkeypatch, at, blow):
    """Let `blow` happen when a chunk is about to be drawn, the one numbered `at`; returns None or another sum."""
    original = command.painter

    def painter(*arguments):
        program, count = original(*arguments), iter(range(10**6))

        def draw(run):
            parts = program(run)
            other = blow(parts) if next(count) == at else None
            return parts if other is None else other

        return draw

    monkeypatch.setattr(command, "painter", painter)


def raising(error):
    def blow(parts):
        raise error

    return blow


@pytest.mark.parametrize("seed", range(20))
def test_l4_interrupted_at_any_block_and_resumed_is_the_same_file(folder, capsys, whole, monkeypatch, seed):
    rng = np.random.default_rng(seed)
    number = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP][seed % 3]
    how = (lambda parts: os.kill(os.getpid(), number)) if seed % 2 else raising(signals.Interrupted(number))
    drawn, resumed = 0, []
    while drawn < SPP:
        with monkeypatch.context() as patch:
            strike(patch, int(rng.integers(0, 5)), how)
            status, out, err = render(capsys, *resumed)
        resumed = ["--resume"]
        now = read_partial(SIDE).end if SIDE.exists() else SPP if status == 0 else 0
        if status:
            assert (status, out) == (128 + number, "")
        if status and now:
            assert f"jaxrt: interrupted: {now} of {SPP} samples a pixel are in ball.exr: go on with --resume\n" in err
            assert now % BLOCK == 0 or now == SPP
            # The picture so far is that of its samples
            expected = jaxrt.render(jaxrt.load_scene("ball.toml"), 0, spp=now, sampler="independent")
            np.testing.assert_array_equal(load_image("ball.exr"), expected)
        drawn = now
    assert (folder / "ball.exr").read_bytes() == whole and not SIDE.exists()


def test_l4_before_the_first_sample_nothing_is_written(folder, capsys, monkeypatch):
    strike(monkeypatch, 0, raising(KeyboardInterrupt()))
    assert render(capsys) == (130, "", "jaxrt: interrupted, nothing written\n")
    assert [p.name for p in folder.iterdir()] == ["ball.toml"]


def test_l4_a_killed_render_goes_on_from_its_checkpoint(folder, capsys, whole, monkeypatch):
    monkeypatch.setenv("JAXRT_CHECKPOINT_SECONDS", "0")
    for at, end in ((2, 2), (3, 5)):
        with monkeypatch.context() as patch:
            strike(patch, at, raising(Struck()))
            with pytest.raises(Struck):
                render(capsys, "--resume")
        assert read_partial(SIDE).end == end * BLOCK and not Path("ball.exr").exists()
    assert render(capsys, "--resume")[0] == 0
    assert (folder / "ball.exr").read_bytes() == whole and not SIDE.exists()


def test_l4_a_failure_keeps_the_sums(folder, capsys, whole, monkeypatch):
    with monkeypatch.context() as patch:
        strike(patch, 3, raising(RuntimeError("out of memory")))
        status, out, err = render(capsys)
    assert (status, out) == (70, "") and err.startswith("jaxrt: error: internal error: RuntimeError: out of memory")
    assert read_partial(SIDE).end == 3 * BLOCK
    assert render(capsys, "--resume")[0] == 0
    assert (folder / "ball.exr").read_bytes() == whole


def interrupted(capsys, monkeypatch, at=2):
    with monkeypatch.context() as patch:
        strike(patch, at, raising(KeyboardInterrupt()))
        assert render(capsys)[0] == 130


OTHERS = [
    (["--seed", 1], "seed 0, not 1"),
    (["--sampler", "stratified"], 'sampler "independent", not "stratified"'),
    (["--spp", 40], "spp 38, not 40"),
    (["--max-depth", 2], "max_depth 1, not 2"),
    (["--width", 8], "width 16, not 8"),
]


@pytest.mark.parametrize(("options", "what"), [*OTHERS, ([], "another scene"), ([], "another version of jaxrt")])
def test_l4_sums_of_another_picture_are_refused(folder, capsys, monkeypatch, options, what):
    interrupted(capsys, monkeypatch)
    before = SIDE.read_bytes()
    if what == "another scene":
        Path("ball.toml").write_text(BALL.replace("0.8, 0.8, 0.8", "0.8, 0.8, 0.7"))
    if "version" in what:
        monkeypatch.setattr("jaxrt.cli.job.code_of", lambda *_: "newer")
    status, out, err = render(capsys, "--resume", *options)
    remedy = "give what it was drawn with, or leave --resume out"
    assert (status, out, err) == (2, "", f"jaxrt: error: {SIDE}: drawn with {what}: {remedy}\n")
    assert SIDE.read_bytes() == before


def test_l4_sums_of_another_processor_are_taken_with_a_warning(folder, capsys, monkeypatch):
    interrupted(capsys, monkeypatch)
    monkeypatch.setattr("jaxrt.cli.job._processor", lambda device: "newer")
    status, _, err = render(capsys, "--resume")
    assert status == 0 and "drawn on another processor: the picture is right to 1e-6, not to the bit" in err


@pytest.mark.parametrize("seed", range(30))
def test_l4_damaged_sums_are_refused_in_one_line(folder, capsys, monkeypatch, seed):
    interrupted(capsys, monkeypatch)
    rng, data = np.random.default_rng(seed), bytearray(SIDE.read_bytes())
    if seed % 3 == 0:
        data = data[: rng.integers(len(data))]
    elif seed % 3 == 1:
        data += bytes(rng.integers(1, 100))
    else:
        # The head is where most can go wrong
        place = rng.integers(len(data) if seed % 2 else 400)
        data[place] ^= 1 << rng.integers(8)
    SIDE.write_bytes(data)
    status, out, err = render(capsys, "--resume")
    assert (status, out) == (2, "") and err.startswith(f"jaxrt: error: {SIDE}: ") and err.count("\n") == 1


def test_l4_sums_are_read_while_another_process_writes_newer_ones(tmp_path):
    """Files of other lengths take each other's place; a reader has one of them, whole."""
    facts, file = {"width": 2, "height": 2, "spp": 10**9}, tmp_path / "a.partial"
    parts = [replace(Partial.nothing(facts, 0), end=10**digits) for digits in range(10)]
    parts[0].write(file)
    with ThreadPoolExecutor(1) as pool:
        writing = pool.submit(lambda: [part.write(file) for part in parts * 60])
        read = []
        while not writing.done():
            read.append(read_partial(file).end)
        writing.result()
    assert len(set(read)) > 1 and set(read) <= {part.end for part in parts}


HEADS = [
    b"", b"jaxrt partial 1\n", b"jaxrt partial 1\n[]\n", b"jaxrt partial 1\n{}\n", b"PK\x03\x04",
    b"jaxrt partial 1\n" + b"[" * 60000, b"jaxrt partial 1\n" + b'{"facts": []}\n',
    b"jaxrt partial 1\n" + json.dumps({"facts": {"width": 10**9, "height": 10**9, "spp": 4}, "first": 0, "end": 4,
                                       "sha256": ""}).encode() + b"\n",
]  # fmt: skip


@pytest.mark.parametrize("head", HEADS, ids=range(len(HEADS)))
def test_l4_files_that_hold_no_sums_are_refused(folder, capsys, head):
    SIDE.write_bytes(head)
    status, _, err = render(capsys, "--resume")
    assert status == 2 and err.count("\n") == 1
    assert "holds no sums of samples" in err or "is damaged" in err


def test_l4_a_pipe_for_sums_does_not_hang(folder, capsys):
    os.mkfifo(SIDE)
    status, _, err = render(capsys, "--resume")
    assert status == 2 and "is no file" in err


def test_l4_without_resume_a_render_begins_anew_and_says_so(folder, capsys, whole, monkeypatch):
    interrupted(capsys, monkeypatch)
    status, _, err = render(capsys)
    assert status == 0 and f"{SIDE}: an interrupted render left it: this one begins anew, --resume would go on" in err
    assert (folder / "ball.exr").read_bytes() == whole
    status, _, err = render(capsys, "--resume")
    assert status == 0 and f"there is no {SIDE}: drawn from the start" in err


# Places that fail


@pytest.mark.parametrize("name", ["ball.exr", "ball.png"])
def test_l4_l5_the_picture_of_a_vanished_folder_is_elsewhere(folder, capsys, whole, monkeypatch, name):
    (folder / "gone").mkdir()
    strike(monkeypatch, 3, lambda parts: shutil.rmtree(folder / "gone"))
    status, _, err = render(capsys, output=f"gone/{name}")
    (place,) = (folder.parent / "elsewhere").glob(f"*/{name}")
    assert status == 3 and f"gone/{name}: No such file or directory: written to {place} instead\n" in err
    if name == "ball.exr":
        assert place.read_bytes() == whole


@pytest.mark.parametrize("name", ["ball.exr", "ball.png"])
def test_l5_the_picture_of_a_full_disk_is_elsewhere(folder, capsys, whole, name):
    """A file system of four pages, all taken."""
    small = folder / "small"
    small.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=16k", "tmpfs", str(small)]
    if subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("no file system can be mounted here")
    try:
        (small / "much").write_bytes(bytes(3 * 4096))
        (small / "more").write_bytes(bytes(4096))
    except OSError:
        pass
    try:
        status, _, err = render(capsys, output=f"small/{name}")
    finally:
        subprocess.run(["umount", str(small)], check=True)
    (place,) = (folder.parent / "elsewhere").glob(f"*/{name}")
    assert status == 3 and err.startswith(f"jaxrt: error: small/{name}: ") and f": written to {place} instead\n" in err
    if name == "ball.exr":
        assert place.read_bytes() == whole


def test_l4_an_interruption_on_a_full_disk_names_where_both_files_are(folder, capsys, whole, monkeypatch):
    def full(part, path):
        if path.parent == Path():
            raise OSError(errno.ENOSPC, "No space left on device")
        os.rename(part, path)

    with monkeypatch.context() as patch:
        patch.setattr("jaxrt.core.writing.os.replace", full)
        strike(patch, 2, raising(KeyboardInterrupt()))
        status, _, err = render(capsys)
    assert status == 130 and "ball.exr: No space left on device: written to " in err
    (sums,) = (folder.parent / "elsewhere").glob(f"*/{SIDE}")
    assert f"{SIDE}: No space left on device: written to {sums} instead\n" in err
    sums.rename(SIDE)
    assert render(capsys, "--resume")[0] == 0
    assert (folder / "ball.exr").read_bytes() == whole


def test_l4_no_place_at_all_is_refused(folder, capsys, monkeypatch):
    def full(part, path):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("jaxrt.core.writing.os.replace", full)
    monkeypatch.setenv("HOME", str(folder.parent / "elsewhere"))
    status, out, err = render(capsys)
    assert (status, out) == (2, "") and "ball.exr: No space left on device, and no room for the picture" in err


def test_l4_a_checkpoint_that_does_not_fit_does_not_end_the_render(folder, capsys, whole, monkeypatch):
    def full(part, path):
        if path.suffix == ".partial":
            raise OSError(errno.ENOSPC, "No space left on device")
        os.rename(part, path)

    monkeypatch.setenv("JAXRT_CHECKPOINT_SECONDS", "0")
    monkeypatch.setattr("jaxrt.core.writing.os.replace", full)
    status, _, err = render(capsys)
    assert status == 0 and f"{SIDE}: No space left on device: drawing on, make room" in err
    assert (folder / "ball.exr").read_bytes() == whole


@pytest.mark.parametrize("stream", ["stdout", "stderr"])
def test_l4_a_closed_stream_costs_no_picture(folder, whole, monkeypatch, stream):
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "w") as broken, monkeypatch.context() as patch:
        patch.setattr(sys, stream, broken)
        patch.setenv("JAXRT_CHECKPOINT_SECONDS", "0")
        patch.setattr(progress, "FIRST_SECONDS", 0)
        patch.setattr(progress, "NEXT_SECONDS", 0)
        argv = ["render", "ball.toml", "-o", "ball.exr", "--spp", str(SPP), "--sampler", "independent"]
        assert jaxrt.cli.main(argv) == 0
    assert (folder / "ball.exr").read_bytes() == whole


def test_a_character_that_a_stream_lacks_is_no_broken_stream(tmp_path):
    with (tmp_path / "out").open("w", encoding="ascii") as file:
        patient = streams._Patient(file)
        with pytest.raises(UnicodeEncodeError):
            patient.write("é")
        patient.write("e")
    assert (tmp_path / "out").read_text() == "e"


@pytest.mark.parametrize("name", ["ball.exr", "ball.png"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_l4_a_pixel_that_is_not_finite_does_not_lose_the_picture(folder, capsys, whole, monkeypatch, name, value):
    def spoil(parts):
        return np.array(parts) + np.where(np.arange(16 * 12).reshape(12, 16, 1, 1) % 90 == 5, np.float32(value), 0)

    render(capsys, output=name)
    sound = load_image(name)
    strike(monkeypatch, 1, spoil)
    status, _, err = render(capsys, output=name)
    assert status == 3
    assert f"jaxrt: warning: {name}: pixel at column 5, row 0 and 2 more are not finite, " in err
    found, spoilt = load_image(name), np.arange(16 * 12).reshape(12, 16) % 90 == 5
    np.testing.assert_array_equal(found[~spoilt], sound[~spoilt])
    if name == "ball.exr":
        assert not np.isfinite(found[spoilt]).any()
    else:
        assert not found[spoilt].any()


# Ranges


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("sampler", ["sobol", "stratified", "independent"])
def test_s11_ranges_merge_to_the_same_file(folder, capsys, sampler, seed):
    rng = np.random.default_rng(seed)
    assert render(capsys, "--sampler", sampler, output="whole.exr")[0] == 0
    cuts = [0, *sorted(BLOCK * rng.choice(np.arange(1, 10), 1 + seed, replace=False)), SPP]
    names = [f"{a}.partial" for a in cuts[:-1]]
    for name, first, end in zip(names, cuts, cuts[1:], strict=False):
        status, out, _ = render(capsys, "--sampler", sampler, "--samples", f"{first}:{end}", output=name)
        assert status == 0 and out.startswith(f"{name}: 16x12, {end - first} spp of {SPP} (samples {first}:{end}), ")
    rng.shuffle(names)
    status, out, err = run(capsys, "merge", *names, "-o", "merged.exr")
    assert (status, out, err) == (0, f"merged.exr: {SPP} spp from {len(names)} files\n", "")
    assert Path("merged.exr").read_bytes() == Path("whole.exr").read_bytes()


def test_l4_a_range_is_interrupted_and_resumed(folder, capsys, whole, monkeypatch):
    render(capsys, "--samples", f"20:{SPP}", output="b.partial")
    with monkeypatch.context() as patch:
        strike(patch, 3, raising(signals.Interrupted(signal.SIGTERM)))
        status, _, err = render(capsys, "--samples", "0:20", output="a.partial")
    assert status == 143
    assert err == "jaxrt: interrupted: 12 of 20 samples a pixel are in a.partial: go on with --resume\n"
    assert run(capsys, "merge", "a.partial", "b.partial", "-o", "m.exr") == (
        2, "", "jaxrt: error: samples 12:20 are missing: draw them with --samples 12:20\n",
    )  # fmt: skip
    assert render(capsys, "--samples", "0:20", "--resume", output="a.partial")[0] == 0
    assert run(capsys, "merge", "a.partial", "b.partial", "-o", "m.exr")[0] == 0
    assert Path("m.exr").read_bytes() == whole


RANGES = [
    ("0:10", "0:10 tears a block of 4 samples: use 0:12"),
    ("3:20", "3:20 tears a block of 4 samples: use 4:20"),
    ("5:6", "5:6 tears a block of 4 samples: use 4:8"),
    ("37:38", "37:38 tears a block of 4 samples: use 36:38"),
    ("0:64", "0:64 goes past 38 spp: give --spp, the number in all"),
    ("8:8", '"8:8" is no range: write FIRST:END, such as 0:512'),
    ("9", '"9" is no range: write FIRST:END, such as 0:512'),
    ("a:4", '"a" is not a whole number'),
]


@pytest.mark.parametrize(("text", "message"), RANGES)
def test_ranges_that_cannot_be_drawn_are_refused(folder, capsys, text, message):
    status, out, err = render(capsys, "--samples", text, output="a.partial")
    assert (status, out) == (2, "") and f"argument --samples: {message}" in err and err.count("\n") == 1


def test_a_range_is_no_picture(folder, capsys):
    status, _, err = render(capsys, "--samples", "0:8")
    assert status == 2 and "--samples: writes sums, not a picture: name them with -o, such as -o a.partial\n" in err


def test_merge_refuses_what_makes_no_picture(folder, capsys):
    ranges = {"a": "0:20", "b": "20:38", "c": "16:38", "d": "24:38"}
    for name, samples in ranges.items():
        render(capsys, "--samples", samples, output=f"{name}.partial")
    render(capsys, "--samples", "20:38", "--seed", 1, output="e.partial")
    Path("ball.toml").write_text(BALL.replace("0.8, 0.8, 0.8", "0.8, 0.8, 0.7"))
    render(capsys, "--samples", "20:38", output="f.partial")
    Path("g.partial").write_bytes(Path("b.partial").read_bytes()[:-1])
    for names, message in {
        "ac": "c.partial: samples 16:20 are in a.partial too: leave one of them out",
        "ad": "samples 20:24 are missing: draw them with --samples 20:24",
        "a": "samples 20:38 are missing: draw them with --samples 20:38",
        "b": "samples 0:20 are missing: draw them with --samples 0:20",
        "ae": "e.partial: seed 1, not 0 as in a.partial: merge parts of one picture",
        "af": "f.partial: another scene as in a.partial: merge parts of one picture",
        "ag": "g.partial: is damaged: remove it, and draw its samples again",
        "ax": 'x.partial: no such file',
        "aa": "merge: a file is named twice: name each once",
    }.items():  # fmt: skip
        status, out, err = run(capsys, "merge", *(f"{name}.partial" for name in names), "-o", "m.exr")
        assert (status, out) == (2, "") and err.startswith(f"jaxrt: error: {message}"), err
        assert err.count("\n") == 1 and not Path("m.exr").exists()


# Sums


def test_s11_sums_are_exact_in_any_order():
    rng = np.random.default_rng(0)
    terms = (rng.standard_normal((200, 4, 5, 3)) * 2.0 ** rng.integers(-30, 30, (200, 4, 5, 3))).astype(np.float32)
    facts = {"width": 5, "height": 4, "spp": 200}
    nothing, results = Partial.nothing(facts, 0), []
    for _ in range(5):
        rng.shuffle(terms)
        half = nothing.plus(100, *terms[:100])
        rest = nothing.plus(100, *terms[100:])
        results.append(half.plus(200, rest.high, rest.low))
    for other in results[1:]:
        np.testing.assert_array_equal(other.high, results[0].high)
        np.testing.assert_array_equal(other.low, results[0].low)
