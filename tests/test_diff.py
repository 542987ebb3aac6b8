"""`jaxrt diff`: figures of what can be compared, a picture where one is asked for."""

import re

import numpy as np
import pytest
from command import run
from PIL import Image

from jaxrt.io.image import load_image, save_image


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """An empty working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def figure(out: str, name: str) -> float:
    found = re.search(rf"^{name} +([\d.e-]+)", out, re.M)
    assert found, out
    return float(found[1])


def test_measures_and_draws_the_error(capsys):
    reference = np.full((4, 6, 3), 0.5, np.float32)
    image = reference.copy()
    image[1, 2, 0] += 0.25
    save_image("a.exr", image)
    save_image("b.exr", reference)
    status, out, _ = run(capsys, "diff", "a.exr", "b.exr", "-o", "error.exr")
    assert status == 0
    assert f"RMSE          {0.25 / 72**0.5:.6g}\n" in out
    assert f"relative MSE  {0.0625 / 0.26 / 72:.6g}\n" in out
    assert "max error     0.25 at column 2, row 1\n" in out and "left out" not in out
    picture = load_image("error.exr")
    assert picture[1, 2].tolist() == [1, 0, 0] and picture.sum() == 1


def test_s8_writes_a_picture_only_where_one_is_asked_for(folder, capsys):
    save_image("a.png", np.full((4, 6, 3), 0.5, np.float32))
    status, out, err = run(capsys, "diff", "a.png", "a.png")
    assert (status, err) == (0, "") and "RMSE          0\n" in out and "error picture" not in out
    assert [path.name for path in folder.iterdir()] == ["a.png"]
    status, out, _ = run(capsys, "diff", "a.png", "a.png", "-o", "error.png")
    assert status == 0 and "error picture error.png" in out and load_image("error.png").max() == 0


@pytest.mark.parametrize("srgb", [False, True])
@pytest.mark.parametrize("png_first", [True, False])
def test_s8_pixels_clipped_in_the_png_are_left_out(capsys, srgb, png_first):
    """0 and 255 say no more than that the value is there or beyond: in either order, by either curve."""
    image = np.random.default_rng(0).uniform(0.05, 0.8, (8, 10, 3)).astype(np.float32)
    image[0, :3, 1] = (1.5, 40, 1.001)  # one channel is enough
    image[7, 4] = 0
    save_image("a.exr", image)
    save_image("a.png", image, srgb=srgb)
    names = ["a.png", "a.exr"] if png_first else ["a.exr", "a.png"]
    status, out, _ = run(capsys, "diff", *names, *(["--srgb"] if srgb else []))
    assert status == 0
    assert "left out      4 of 80 pixels: 4 clipped in the PNG (0 or 255)\n" in out
    assert figure(out, "RMSE") < 4e-3 and figure(out, "max error") < 6e-3
    assert figure(out, " +clipped alike, they differ by up to") < 6e-3


def test_s8_clipping_hides_no_fault(capsys):
    """A white pixel that should be dark is left out of the figures, and told."""
    image = np.full((4, 4, 3), 0.25, np.float32)
    save_image("a.exr", image)
    image[2, 1] = 7
    save_image("a.png", image)
    _, out, _ = run(capsys, "diff", "a.png", "a.exr")
    assert "left out      1 of 16 pixels" in out
    assert figure(out, " +clipped alike, they differ by up to") == 0.75


def test_s8_two_png_clip_alike(capsys):
    save_image("a.png", np.full((2, 2, 3), 1, np.float32))
    save_image("b.png", np.full((2, 2, 3), 0.5, np.float32))
    _, out, _ = run(capsys, "diff", "a.png", "b.png")
    assert figure(out, "max error") == pytest.approx(0.5, abs=5e-3) and "left out" not in out


def test_s8_sixteen_bits_of_grey_clip_at_their_own_end(capsys):
    levels = np.array([[0, 65535, 255, 30000]], np.uint16)
    Image.fromarray(levels).save("a.png")
    save_image("a.exr", np.repeat(load_image("a.png")[..., :1] * np.float32(1.0), 3, -1))
    _, out, _ = run(capsys, "diff", "a.png", "a.exr")
    assert "left out      2 of 4 pixels" in out and "RMSE          0\n" in out


def test_pixels_that_are_not_finite_are_left_out(capsys):
    image = np.full((3, 3, 3), 0.5, np.float32)
    save_image("b.exr", image)
    image[0, 0, 2], image[1, 1, 0] = np.nan, np.inf
    save_image("a.exr", image, finite=False)
    status, out, _ = run(capsys, "diff", "a.exr", "b.exr", "-o", "error.png")
    assert status == 0 and "RMSE          0\n" in out
    assert "left out      2 of 9 pixels: 2 not finite\n" in out


REFUSED = [
    (("a.png", "b.png"), "a.png, b.png: sizes differ, 6x4 and 5x4: render both in one size"),
    (("a.png", "a.exr"), "no pixel is left to compare, all are 24 clipped in the PNG (0 or 255)"),
    (("a.png", "a.exr", "-o", "a.exr"), "a.exr: is one of the pictures to compare: choose another name"),
    (("a.png", "x.png"), "x.png: no such file (did you mean"),
    (("a.png",), "the following arguments are required: B: see jaxrt diff --help"),
    (("a.png", "b.png", "c.png"), "unrecognized arguments: c.png (did you mean -o c.png?): see jaxrt diff --help"),
]


@pytest.mark.parametrize(("argv", "message"), REFUSED)
def test_refusals(folder, capsys, argv, message):
    save_image("a.png", np.zeros((4, 6, 3)))
    save_image("a.exr", np.zeros((4, 6, 3)))
    save_image("b.png", np.zeros((4, 5, 3)))
    before = {path: path.read_bytes() for path in folder.iterdir()}
    status, out, err = run(capsys, "diff", *argv)
    assert (status, out) == (2, "") and message in err and err.count("\n") == 1
    assert {path: path.read_bytes() for path in folder.iterdir()} == before
