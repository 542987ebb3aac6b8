"""Pictures in and out: 8-bit PNG for the eye, float32 EXR for numbers."""

import logging
import os
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jaxrt.core.messages import SceneError, one_line
from jaxrt.core.writing import write_whole
from jaxrt.io import color
from jaxrt.io.decode import Pixels, decode_exr, decode_png
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


def save_image(path: StrPath, image: ArrayLike, exposure: float = 0.0, srgb: bool = False, finite: bool = True) -> None:
    """Write an (H, W, 3) picture of linear radiance, times 2**exposure, to a .png or .exr file.

    PNG: 8 bits, gamma 2.2 (or the sRGB curve), clipped to [0, 1]. EXR: linear float32, not clipped.
    finite: False takes pixels that are not finite too; PNG shows NaN black.
    The file appears whole or not at all. Raises ValueError for an unknown suffix, another shape, or a pixel
    that is not finite, OSError with path and reason where the file cannot be written.
    """
    suffix = check_suffix(path)
    pixels = _check_pixels(image, exposure, finite)
    write_whole(Path(path), lambda file: _WRITERS[suffix](file, pixels, srgb))


def load_image(path: StrPath, srgb: bool = False) -> Pixels:
    """Return the (H, W, 3) float32 linear picture in a .png or .exr file.

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
    try:
        if suffix == ".exr":
            return decode_exr(path, data)
        pixels = decode_png(path, data, srgb)
    except (SceneError, MemoryError):
        raise
    except Exception as error:  # whatever a decoder trips over in a broken file
        reason = str(error) or type(error).__name__
        raise ValueError(one_line(f"{path}: cannot be read as {suffix} ({reason}): check the file")) from None
    logger.info("%s: display values, linearised by %s", path, "the sRGB curve" if srgb else "gamma 2.2")
    return pixels


def _check_pixels(image: ArrayLike, exposure: float, finite: bool) -> Pixels:
    """Return the exposed picture in float32, or raise ValueError naming what is wrong."""
    try:
        pixels = np.asarray(image)
    except Exception:  # rows of different lengths; and JAX's own, of many lines, for what is traced
        raise ValueError(f"image: {type(image).__name__} is no picture: pass an array, and not under jax.jit") from None
    if pixels.dtype.kind not in "fiu":
        raise ValueError(f"image: {pixels.dtype} is no radiance: pass an array of numbers (height, width, 3)")
    if pixels.ndim != 3 or pixels.shape[2] != 3 or pixels.size == 0:
        raise ValueError(f"image: shape {pixels.shape} is no picture: pass (height, width, 3)")
    if not np.isfinite(exposure):
        raise ValueError(f"exposure: {exposure} is not finite: pass a number of stops")
    with np.errstate(over="ignore", invalid="ignore"):
        exposed = (pixels.astype(np.float64) * np.exp2(exposure)).astype(np.float32)
    if finite and not np.isfinite(exposed).all():
        i, j, c = (int(n) for n in np.argwhere(~np.isfinite(exposed))[0])
        raise ValueError(f"image[{i}, {j}, {c}]: {exposed[i, j, c]} is not finite: mend the picture before saving")
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
    shown = np.where(np.isnan(encoded), 0, encoded)
    return np.rint(255 * np.clip(shown, 0, 1)).astype(np.uint8)


def _write_png(file: BinaryIO, pixels: Pixels, srgb: bool) -> None:
    from PIL import Image

    Image.fromarray(_levels(pixels, srgb)).save(file, format="PNG")


def _write_exr(file: BinaryIO, pixels: Pixels, srgb: bool) -> None:
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    content = BytesIO()  # the library does not tell what is wrong with a disk
    with OpenEXR.File(header, {"RGB": np.ascontiguousarray(pixels)}) as picture:
        picture.write(content)
    file.write(content.getbuffer())


_WRITERS = {".png": _write_png, ".exr": _write_exr}
