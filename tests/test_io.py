"""Scene files and pictures: round trips, refusals, and files that appear whole or not at all."""

import logging
from io import BytesIO
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import OpenEXR
import pytest
from PIL import Image

import jaxrt
from jaxrt.description import SceneError
from jaxrt.io import color
from jaxrt.io.image import load_image, save_image
from jaxrt.io.scene_file import read_description

SCENES = Path(__file__).parents[1] / "scenes"
MINIMAL = "[camera]\nposition = [0, 0, 5]\n[[lights]]\nposition = [0, 5, 5]\nintensity = 9\n"


def picture(shape=(5, 7, 3), seed=0):
    return np.random.default_rng(seed).random(shape, np.float32)


def test_exr_keeps_every_bit(tmp_path):
    image = picture() * np.float32(1e3) - 1
    save_image(tmp_path / "a.exr", image)
    loaded = load_image(tmp_path / "a.exr")
    assert loaded.dtype == np.float32
    np.testing.assert_array_equal(loaded, image)


@pytest.mark.parametrize("srgb", [False, True])
def test_png_is_within_half_a_level(tmp_path, srgb):
    image = picture()
    save_image(tmp_path / "a.png", image, srgb=srgb)
    levels = np.asarray(Image.open(tmp_path / "a.png"))
    encode = color.srgb_encode if srgb else color.gamma_encode
    assert levels.dtype == np.uint8 and levels.shape == image.shape
    assert np.abs(levels / 255 - encode(image)).max() <= 0.5 / 255 + 1e-6
    assert np.abs(encode(load_image(tmp_path / "a.png", srgb=srgb)) - encode(image)).max() <= 0.5 / 255 + 1e-6


def test_png_is_clipped_and_middle_grey_is_gamma_2_2(tmp_path):
    save_image(tmp_path / "a.png", np.array([[[-1, 0, 0.5], [1, 2, 1e30]]], np.float32))
    levels = np.asarray(Image.open(tmp_path / "a.png"))
    assert levels.tolist() == [[[0, 0, 186], [255, 255, 255]]]


def test_exposure_doubles_per_stop(tmp_path):
    image = picture()
    save_image(tmp_path / "a.exr", image, exposure=-2)
    np.testing.assert_array_equal(load_image(tmp_path / "a.exr"), image / 4)


def test_loading_a_png_says_that_it_linearises(tmp_path, caplog):
    save_image(tmp_path / "a.png", picture())
    with caplog.at_level(logging.INFO):
        load_image(tmp_path / "a.png")
    assert "linearised by gamma 2.2" in caplog.text


def test_jax_arrays_float64_and_suffix_case(tmp_path):
    import jax.numpy as jnp

    image = picture()
    save_image(tmp_path / "a.EXR", jnp.asarray(image))
    save_image(tmp_path / "b.exr", image.astype(np.float64))
    np.testing.assert_array_equal(load_image(tmp_path / "a.EXR"), load_image(tmp_path / "b.exr"))
    assert jaxrt.save_image is save_image and jaxrt.load_image is load_image


def test_exr_of_half_floats_and_of_luminance_alone(tmp_path):
    grey = picture((4, 6)).astype(np.float16)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"Y": grey}).write(str(tmp_path / "y.exr"))
    loaded = load_image(tmp_path / "y.exr")
    np.testing.assert_array_equal(loaded, np.repeat(grey[..., None], 3, -1).astype(np.float32))


@pytest.mark.parametrize(
    ("name", "image", "message"),
    [
        ("a.jpg", picture(), r'a\.jpg: unknown suffix "\.jpg": use \.png or \.exr'),
        ("a", picture(), r"a: no suffix: use \.png or \.exr"),
        ("a.png", picture((5, 7)), r"image: shape \(5, 7\) is no picture: pass \(height, width, 3\)"),
        ("a.png", picture((0, 7, 3)), "is no picture"),
    ],
)
def test_what_cannot_be_saved_is_refused(tmp_path, name, image, message):
    with pytest.raises(ValueError, match=message):
        save_image(tmp_path / name, image)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("suffix", [".png", ".exr"])
def test_the_first_pixel_that_is_not_finite_is_named(tmp_path, suffix, bad):
    image = picture()
    image[2, 3, 1] = image[4, 0, 0] = bad
    with pytest.raises(ValueError, match=rf"image\[2, 3, 1\]: {bad} is not finite"):
        save_image(tmp_path / f"a{suffix}", image)
    with pytest.raises(ValueError, match="exposure: nan is not finite"):
        save_image(tmp_path / f"a{suffix}", picture(), exposure=np.nan)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("suffix", [".png", ".exr"])
def test_an_interrupted_write_leaves_the_old_file_and_nothing_else(tmp_path, suffix, monkeypatch):
    path = tmp_path / f"a{suffix}"
    save_image(path, picture())
    before = path.read_bytes()

    def interrupt(source, target):
        raise KeyboardInterrupt

    monkeypatch.setattr("jaxrt.core.writing.os.replace", interrupt)
    with pytest.raises(KeyboardInterrupt):
        save_image(path, picture(seed=1))
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("suffix", [".png", ".exr"])
def test_broken_and_missing_pictures_are_refused(tmp_path, suffix):
    with pytest.raises(FileNotFoundError, match="no such file"):
        load_image(tmp_path / f"none{suffix}")
    (tmp_path / f"bad{suffix}").write_bytes(b"nothing like a picture")
    with pytest.raises(ValueError, match=rf"bad\{suffix}: cannot be read as \{suffix}"):
        load_image(tmp_path / f"bad{suffix}")


def test_color_curves_invert_and_meet_known_values():
    x = np.linspace(0, 1, 101)
    np.testing.assert_allclose(color.gamma_decode(color.gamma_encode(x)), x, atol=1e-12)
    np.testing.assert_allclose(color.srgb_decode(color.srgb_encode(x)), x, atol=1e-6)
    assert color.srgb_encode(0.5) == pytest.approx(0.7353569, abs=1e-6)
    assert color.gamma_encode(-1.0) == 0
    np.testing.assert_allclose(color.luminance(np.ones((2, 3), np.float32)), 1, rtol=1e-6)


def test_the_files_in_scenes_are_all_read():
    files = sorted(SCENES.glob("**/*.toml"))
    assert len(files) >= 7
    for file in files:
        assert read_description(file).lights


def test_the_room_is_the_room():
    room = read_description(SCENES / "room.toml")
    floor, *_, front, white, mirror, glass = room.spheres
    assert (floor.center, floor.radius, floor.material) == ((0, -1000, 0), 990, "floor")
    assert (front.center, front.radius) == ((0, 0, 1000), 940)
    assert [(s.center[0], s.radius) for s in (white, mirror, glass)] == [(0, 10), (-20, 8), (20, 8)]
    assert room.materials["floor"].albedo == (0.4, 0.4, 0.8)
    assert (room.lights[0].position, room.lights[0].radius) == ((-10, 25, 20), 5)
    assert (room.camera.width, room.camera.height) == (256, 256)
    assert (room.render.spp, room.render.max_depth) == (64, 4)


def read(tmp_path, text):
    path = tmp_path / "room.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(SceneError) as caught:
        read_description(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ") and "\n" not in message
    return message.removeprefix(f"{path}: ")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[camera\nfov = 60", "line 1, column 8: not valid TOML: "),
        ("[camera]\nfov = ", "not valid TOML: Invalid value"),
        (
            "[camera]\nfov = 60\nfov = 61\n",
            "line 3, column 9: not valid TOML: Cannot overwrite a value: correct",
        ),
        (b"[camera]\nup = '\xff'", "not UTF-8 text at byte 15: save it as UTF-8"),
        ("a = " + "[" * 5000, "not valid TOML: nested too deeply: flatten it"),
        ("a = " + "9" * 5000, "not valid TOML: "),
        ("", '"camera" is missing: add a table [camera]'),
        (MINIMAL + "radius = 1e999", "lights[0].radius: inf is not finite"),
        (MINIMAL + "radius = nan", "lights[0].radius: nan is not finite"),
        (MINIMAL + "radius = 1979-05-27", "lights[0].radius: datetime.date(1979, 5, 27) is not a number"),
    ],
)
def test_i8_malformed_files_are_refused(tmp_path, text, message):
    assert message in read(tmp_path, text)


def test_missing_files_are_refused_with_the_nearest_name(tmp_path):
    with pytest.raises(SceneError, match=r'rom\.toml: no such file \(did you mean ".*scenes/room\.toml"\?\)'):
        read_description(SCENES / "rom.toml")
    with pytest.raises(SceneError, match=r"no such file: the folder .* does not exist, check the path"):
        read_description(tmp_path / "nowhere" / "room.toml")
    with pytest.raises(SceneError, match=r"is a folder: name a scene file in it"):
        read_description(tmp_path)


def test_load_scene_builds(tmp_path):
    (tmp_path / "a.toml").write_text(MINIMAL)
    scene = jaxrt.load_scene(tmp_path / "a.toml")
    assert scene.lights.position.shape == (1, 3) and scene.lights.radius is None


@pytest.mark.parametrize(("exposure", "srgb"), [(0.0, False), (-1.5, True)])
def test_s5_tonemap_is_what_a_png_holds(tmp_path, exposure, srgb):
    image = 2 * picture()
    save_image(tmp_path / "a.png", image, exposure, srgb)
    levels = jaxrt.tonemap(jnp.asarray(image), exposure, srgb)
    assert levels.dtype == np.uint8
    np.testing.assert_array_equal(levels, np.asarray(Image.open(tmp_path / "a.png")))
    shown = jaxrt.show(image, exposure, srgb)
    np.testing.assert_array_equal(np.asarray(Image.open(BytesIO(shown._repr_png_()))), levels)


def test_s5_what_is_no_picture_is_refused_in_one_line():
    for image, line in (
        (np.zeros((4, 5)), r"image: shape \(4, 5\) is no picture: pass \(height, width, 3\)"),
        (np.full((1, 1, 3), np.nan), r"image\[0, 0, 0\]: nan is not finite: mend the picture before saving"),
        ("room.png", r"image: <U8 is no radiance: pass an array of numbers \(height, width, 3\)"),
        (None, r"image: object is no radiance: pass an array of numbers \(height, width, 3\)"),
        ([[1], [1, 2]], "image: list is no picture: pass an array, and not under jax.jit"),
    ):
        for use in (jaxrt.tonemap, jaxrt.show):
            with pytest.raises(ValueError, match=f"^{line}$"):
                use(image)
    with pytest.raises(ValueError, match="^image: .+ is no picture: pass an array, and not under jax.jit"):
        jax.jit(jaxrt.tonemap)(picture())
