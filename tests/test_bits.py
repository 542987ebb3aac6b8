"""Which pictures are the same to the bit, and which to 1e-6 only: CONVENTIONS, Bits."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest
from command import BALL

import jaxrt
from jaxrt import chunks
from jaxrt.hands import painter
from jaxrt.io.partial import Partial, PartialError, read_partial
from jaxrt.render import prepare
from jaxrt.transport.film import BLOCK, SHARES, Plan, joined, shares_of

ROOT = Path(__file__).parents[1]
SPP = 23


def small(name: str) -> jaxrt.Scene:
    scene = jaxrt.load_scene(ROOT / "scenes" / name)
    return replace(scene, camera=replace(scene.camera, width=24, height=16))


SCENES = ["room.toml", "seed/several_balls_and_triangles.toml"]


@pytest.fixture(scope="module", params=SCENES)
def scene(request):
    return small(request.param)


@pytest.fixture(scope="module")
def picture(scene):
    return np.asarray(jaxrt.render(scene, 3, spp=SPP, max_depth=2, sampler="stratified"))


def drawn(scene, cuts, cores=1, devices=1, folder=None):
    """Return the picture of samples 0 … SPP − 1, drawn in ranges between the cuts by as many hands."""
    options = dict(max_depth=2, sampler="stratified", devices=jax.devices()[:devices])
    nothing = prepare(scene, 3, 0, 0, SPP, **options)
    draw, total = painter(folder, *nothing, cores), Partial.nothing({"width": 24, "height": 16, "spp": SPP}, 0)
    for first, end in zip([0, *cuts], [*cuts, SPP], strict=True):
        run = prepare(scene, 3, first, end - first, SPP, **options)[1]
        total = total.plus(end, *np.moveaxis(draw(run), -1, 0))
    return total.picture()


@pytest.mark.parametrize("devices", [1, 2])
def test_s11_ranges_of_blocks_cores_and_devices_do_not_change_a_bit(scene, picture, devices):
    rng = np.random.default_rng(devices)
    for n in range(6):
        cuts = sorted(BLOCK * rng.choice(np.arange(1, 6), n, replace=False))
        np.testing.assert_array_equal(drawn(scene, cuts, n + 1, devices), picture)


def test_s4_any_number_of_cores_draws_by_one_program(tmp_path, picture, scene):
    for cores in (1, 2, 7):
        np.testing.assert_array_equal(drawn(scene, [], cores, folder=tmp_path / "jaxrt"), picture)
    assert len([*(tmp_path / "jaxrt").glob("*.program")]) == 1


@pytest.mark.parametrize("size", [(1, 1), (16, 8), (17, 9), (300, 200), (2000, 11)])
def test_shares_make_up_the_picture(size):
    plan = Plan(1, "sobol", False, (16, 8), (None,))
    shares, turns = shares_of(size, plan)
    columns = -(-size[0] // 16)
    x, y = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    packet, lane = y // 8 * columns + x // 16, y % 8 * 16 + x % 16
    numbers = np.arange(shares * turns * 128).reshape(turns, shares, 128).swapaxes(0, 1)[..., None]
    np.testing.assert_array_equal(joined(numbers, size, plan)[..., 0], packet * 128 + lane)
    assert shares <= SHARES and shares * (turns - 1) < columns * -(-size[1] // 8)


def test_s11_a_torn_block_changes_bits_but_no_more_than_1e_6(scene, picture):
    # So the blocks are there: else the test above would hold of anything
    torn = drawn(scene, [BLOCK + 1, 2 * BLOCK + 3, 18])
    assert (torn != picture).any()
    np.testing.assert_allclose(torn, picture, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("options", [{"tile": (10, 6)}, {"unroll": True}], ids=str)
def test_s11_tile_and_unroll_change_the_picture_by_1e_6(options):
    scene, same = small(SCENES[0]), dict(spp=SPP, max_depth=2, devices=jax.devices()[:1])
    picture, other = jaxrt.render(scene, 3, **same), jaxrt.render(scene, 3, **same, **options)
    np.testing.assert_allclose(other, picture, rtol=2e-6, atol=1e-8)


@pytest.mark.parametrize("seed", range(10))
def test_s11_the_clock_changes_no_bit(monkeypatch, seed):
    """However long chunks take, as on a loaded machine."""
    rng, clock, sizes = np.random.default_rng(seed), [0.0], []
    values = (np.random.default_rng(0).random((500, 3, 3, 3)) ** 8).astype(np.float32)

    def draw(first, count):
        sizes.append(count)
        clock[0] += count * 10 ** rng.uniform(-4, 0)
        # What the kernel does: blocks rounded, their sum exact
        blocks = [values[i : min(i + BLOCK, first + count)].sum(0, dtype=np.float32)
                  for i in range(first, first + count, BLOCK)]  # fmt: skip
        total = np.sum(blocks, 0, dtype=np.longdouble)
        high = total.astype(np.float32)
        middle = (total - high).astype(np.float32)
        return np.stack([high, middle, (total - high - middle).astype(np.float32)], -1)

    monkeypatch.setattr(chunks.time, "perf_counter", lambda: clock[0])
    nothing = Partial.nothing({"width": 3, "height": 3, "spp": 500}, 0)
    total = chunks.accumulate(draw, nothing, 500, lambda sums: True)
    blocks = [values[i : i + BLOCK].sum(0, dtype=np.float32) for i in range(0, 500, BLOCK)]
    np.testing.assert_array_equal(total.high, np.sum(blocks, 0, dtype=np.longdouble).astype(np.float64))
    assert len(set(sizes)) > 1


# Processes

BIG = BALL.replace("16", "160").replace("12\n", "120\n").replace("= 2\n", "= 3000\n", 1)
GUARD = 300  # seconds: at least thirty times what it should take
started: list[subprocess.Popen[str]] = []


@pytest.fixture
def place(tmp_path):
    (tmp_path / "ball.toml").write_text(BIG)
    yield tmp_path
    while started:  # what a failed test leaves running
        with started.pop() as process:
            process.kill()


def start(place, *options, output="ball.exr"):
    environment = os.environ | {
        "PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(place / "cache"), "JAXRT_CHECKPOINT_SECONDS": "0.2",
    }  # fmt: skip
    command = [sys.executable, "-m", "jaxrt", "render", "ball.toml", "-o", output, "--sampler", "independent", *options]
    started.append(subprocess.Popen(command, cwd=place, env=environment, stderr=subprocess.PIPE, text=True))
    return started[-1]


def end_of(file):
    """Return how many samples a file of sums holds, none where it is gone: who draws them may remove it meanwhile."""
    try:
        return read_partial(file).end
    except PartialError:
        if file.exists():
            raise
        return 0


def wait_for(process, file, before):
    """Wait until the file holds more samples than before."""
    begun = time.perf_counter()
    while end_of(file) <= before and process.poll() is None:
        assert time.perf_counter() - begun < GUARD
        time.sleep(0.01)


def finished(process):
    _, err = process.communicate(timeout=GUARD)
    return process.returncode, err


def test_l4_killed_resumed_and_merged_processes_draw_one_picture(place):
    assert finished(start(place, "--cores", "1", output="whole.exr"))[0] == 0
    sums = place / "ball.exr.partial"
    for number in (signal.SIGKILL, signal.SIGTERM, signal.SIGINT):
        before = end_of(sums)
        process = start(place, "--resume")
        wait_for(process, sums, before)
        process.send_signal(number)
        status, err = finished(process)
        if status == 0 and number != signal.SIGKILL:  # drawn to the end before the signal came
            break
        assert status == (-9 if number == signal.SIGKILL else 128 + number), err
        assert "Traceback" not in err and read_partial(sums).end > before
        if number != signal.SIGKILL:
            assert err.endswith("are in ball.exr: go on with --resume\n") and (place / "ball.exr").exists()
    if status != 0:
        assert finished(start(place, "--resume"))[0] == 0
    assert not sums.exists()
    assert (place / "ball.exr").read_bytes() == (place / "whole.exr").read_bytes()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_l7_a_signal_while_modules_are_loaded_is_one_line(number):
    code = (
        "import importlib, os, signal, sys, time; from jaxrt.cli import main\n"
        f"if signal.getsignal({int(number)}) == signal.SIG_IGN: signal.signal({int(number)}, signal.SIG_DFL)\n"
        f"importlib.import_module = lambda name: (os.kill(os.getpid(), {int(number)}), time.sleep({GUARD}))\n"
        "sys.exit(main(['info', 'a.toml']))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=GUARD)
    assert (done.returncode, done.stderr) == (128 + number, "jaxrt: interrupted, nothing written\n")


def test_closed_descriptors_are_nobodys_files(place):
    """With stderr closed, the first file that is opened would be descriptor 2, and get what libraries print."""
    code = "import os, sys; from jaxrt.cli import main; sys.exit(main(['merge', 'a.partial', '-o', 'b.exr']))"
    shell = f'exec "$0" -c "{code}" >&- 2>&- <&-'
    done = subprocess.run(["sh", "-c", shell, sys.executable], cwd=place, env=os.environ | {"PYTHONPATH": str(ROOT)})
    assert done.returncode == 2
