"""Pictures in and out: 8-bit PNG for the eye, float32 EXR for numbers."""

import logging
import os
from collections.abc import Mapping
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jaxrt.core.messages import show as show_name
from jaxrt.core.writing import write_whole
from jaxrt.io import color, layers
from jaxrt.io.decode import Pixels, decode_exr, decode_png, decoding
from jaxrt.io.files import PICTURE_BYTES, StrPath, instead_of, read_bytes

if TYPE_CHECKING:
    from PIL import Image

logger = logging.getLogger(__name__)
Levels = NDArray[np.uint8]


def check_suffix(path: StrPath) -> str:
    """Return the suffix of `path` in lower case. Raises ValueError where it names no known format."""
    suffix = Path(path).suffix.lower()
    if suffix not in _WRITERS:
        culprit = f'unknown suffix "{suffix}"' if suffix else "no suffix"
        raise ValueError(f"{path}: {culprit}: use {' or '.join(_WRITERS)}")
    return suffix


def save_image(
    path: StrPath,
    image: ArrayLike | Mapping[str, ArrayLike],
    exposure: float = 0.0,
    srgb: bool = False,
    finite: bool = True,
) -> None:
    """Write an (H, W, 3) picture of linear radiance, times 2**exposure, to a .png or .exr file.

    Or what `jaxrt.render(outputs=...)` returns: an EXR has a layer for each output, besides a PNG stands one for each,
    `room.depth.png` beside `room.png`. "foreground" with "alpha" is a picture that can be laid over another.

    PNG: 8 bits, gamma 2.2 (or the sRGB curve), clipped to [0, 1]. EXR: linear float32, not clipped.
    finite: False takes pixels that are not finite too; PNG shows NaN black.
    The file appears whole or not at all. Raises ValueError for an unknown suffix, another shape, or a pixel
    that is not finite, OSError with path and reason where the file cannot be written.
    """
    suffix = check_suffix(path)
    if isinstance(image, Mapping):
        _save_layers(Path(path), suffix, image, exposure, srgb, finite)
        return
    pixels = _check_pixels(image, exposure, finite)
    write_whole(Path(path), lambda file: _WRITERS[suffix](file, pixels, srgb))


def _save_layers(
    path: Path, suffix: str, image: Mapping[str, ArrayLike], exposure: float, srgb: bool, finite: bool
) -> None:
    """Write outputs as layers of one file, or as files beside one another."""
    found = {name: _check_layer(name, layer, exposure, finite) for name, layer in image.items()}
    if suffix == ".exr":
        write_whole(path, lambda file: _write_channels(file, layers.channels_of(found)))
        return
    main = layers.main_of(found)
    for name, layer in found.items():
        if name == "alpha" and main == "foreground":
            continue
        display = layers.shown(name, layer, found.get("alpha"))
        if name == main == "foreground":
            display = layers.with_alpha(layer, found["alpha"], srgb)
        levels = _levels(layer, srgb) if display is None else _rounded(display)
        write_whole(path if name == main else layers.png_beside(path, name), partial(_write_levels, levels))


def _check_layer(name: str, layer: ArrayLike, exposure: float, finite: bool) -> Pixels:
    """Return an output in float32, exposed if it is light. Raises ValueError naming what is wrong."""
    if layers.is_light(name):
        return _check_pixels(layer, exposure, finite, name)
    values = np.asarray(layer)
    if values.ndim not in (2, 3) or values.size == 0 or values.dtype.kind not in "fiu":
        raise ValueError(f"{show_name(name)}: {values.dtype} {values.shape} is no output: pass what render returns")
    if finite and not np.isfinite(values).all():
        raise ValueError(f"{show_name(name)}: has pixels that are not finite: mend it before saving")
    return values.astype(np.float32)


def load_image(path: StrPath, srgb: bool = False, layer: str | None = None) -> Pixels:
    """Return the (H, W, 3) float32 linear picture in a .png or .exr file.

    layer: return that output of an EXR file instead, such as "depth" (H, W) or "normal" (H, W, 3).

    PNG holds display values: they are linearised by gamma 2.2, or by the sRGB curve, and that is logged.
    Alpha is dropped. Raises ValueError for an unknown suffix, for what is broken or too large, FileNotFoundError for
    no file.
    """
    path = Path(path)
    if os.path.isdir(path):
        raise ValueError(f"{path}: is a folder: name a picture in it")
    suffix = check_suffix(path)
    if not os.path.lexists(path):
        raise FileNotFoundError(f"{path}: no such file{instead_of(path, tuple(_WRITERS))}")
    data = read_bytes(path, tuple(_WRITERS), "a picture", limit=PICTURE_BYTES)
    with decoding(path, suffix, ValueError):
        if suffix == ".exr":
            return decode_exr(path, data, layer)
        if layer is not None:
            raise ValueError("a PNG has no layers")
        pixels = decode_png(path, data, color.srgb_decode if srgb else color.gamma_decode)
    logger.info("%s: display values, linearised by %s", path, "the sRGB curve" if srgb else "gamma 2.2")
    return pixels


def _check_pixels(image: ArrayLike, exposure: float, finite: bool, name: str = "image") -> Pixels:
    """Return the exposed picture in float32, or raise ValueError naming what is wrong."""
    try:
        pixels = np.asarray(image)
    except Exception:  # rows of different lengths; and JAX's own, of many lines, for what is traced
        raise ValueError(
            f"{name}: {type(image).__name__} is no picture: pass an array, and not under jax.jit"
        ) from None
    if pixels.dtype.kind not in "fiu":
        raise ValueError(f"{name}: {pixels.dtype} is no radiance: pass an array of numbers (height, width, 3)")
    if pixels.ndim != 3 or pixels.shape[2] != 3 or pixels.size == 0:
        raise ValueError(f"{name}: shape {pixels.shape} is no picture: pass (height, width, 3)")
    if not np.isfinite(exposure):
        raise ValueError(f"exposure: {exposure} is not finite: pass a number of stops")
    with np.errstate(over="ignore", invalid="ignore"):
        exposed = (pixels.astype(np.float64) * np.exp2(exposure)).astype(np.float32)
    if finite and not np.isfinite(exposed).all():
        i, j, c = (int(n) for n in np.argwhere(~np.isfinite(exposed))[0])
        raise ValueError(f"{name}[{i}, {j}, {c}]: {exposed[i, j, c]} is not finite: mend the picture before saving")
    return exposed


def tonemap(image: ArrayLike, exposure: float = 0.0, srgb: bool = False, finite: bool = True) -> Levels:
    """Return an (H, W, 3) picture of linear radiance, times 2**exposure, as 8-bit display values: those of a PNG.

    The arguments, and what is raised, are those of `save_image`.
    """
    return _levels(_check_pixels(image, exposure, finite), srgb)


def show(image: ArrayLike, exposure: float = 0.0, srgb: bool = False, finite: bool = True) -> "Image.Image":
    """Return an (H, W, 3) picture of linear radiance as a Pillow image, which notebooks draw: what `tonemap` makes."""
    from PIL import Image

    return Image.fromarray(tonemap(image, exposure, srgb, finite))


def _levels(pixels: Pixels, srgb: bool) -> Levels:
    encoded = color.srgb_encode(pixels) if srgb else color.gamma_encode(pixels)
    return _rounded(encoded)


def _rounded(display: NDArray[np.floating]) -> Levels:
    shown = np.where(np.isnan(display), 0, display)
    return np.rint(255 * np.clip(shown, 0, 1)).astype(np.uint8)


def _write_png(file: BinaryIO, pixels: Pixels, srgb: bool) -> None:
    _write_levels(_levels(pixels, srgb), file)


def _write_levels(levels: Levels, file: BinaryIO) -> None:
    from PIL import Image

    Image.fromarray(levels).save(file, format="PNG")


def _write_exr(file: BinaryIO, pixels: Pixels, srgb: bool) -> None:
    _write_channels(file, {"RGB": np.ascontiguousarray(pixels)})


def _write_channels(file: BinaryIO, channels: Mapping[str, Pixels]) -> None:
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    content = BytesIO()  # the library does not tell what is wrong with a disk
    with OpenEXR.File(header, dict(channels)) as picture:
        picture.write(content)
    file.write(content.getbuffer())


_WRITERS = {".png": _write_png, ".exr": _write_exr}
