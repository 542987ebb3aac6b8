"""Pictures from bytes that may be anything: sizes are read and bounded before anything is decoded."""

import io
import os
import struct
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from jaxrt.core.messages import SceneError, one_line
from jaxrt.io.files import PICTURE_BYTES, check_size
from jaxrt.io.layers import layer_in

Pixels = NDArray[np.float32]
Curve = Callable[[NDArray[np.float64]], NDArray[np.floating]]  # from display values to linear ones

PNG_START = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR"
EXR_START = b"\x76\x2f\x31\x01"


@contextmanager
def decoding(path: Path, suffix: str, error: type[ValueError]) -> Iterator[None]:
    """Raise such an error, in one line, for whatever a decoder trips over in a broken file."""
    try:
        yield
    except (SceneError, MemoryError):
        raise
    except Exception as trouble:
        reason = str(trouble) or type(trouble).__name__
        raise error(one_line(f"{path}: cannot be read as {suffix} ({reason}): check the file")) from None


def decode_png(path: Path, data: bytes, curve: Curve) -> Pixels:
    """Return the (H, W, 3) linear picture in the PNG file `data`, of 8 or 16 bits. curve: from its display values."""
    from PIL.PngImagePlugin import PngImageFile

    if not data.startswith(PNG_START):
        raise ValueError("is no PNG file")
    width, height = struct.unpack_from(">2I", data, len(PNG_START))
    check_size(path, width * height * 12, PICTURE_BYTES, "decodes to")
    _check_chunks(data)
    # Image.open would try all kinds of files that Pillow knows
    with PngImageFile(io.BytesIO(data)) as picture:
        # Pillow's conversion to RGB clips 16 bits of grey to 8
        grey = picture.mode.startswith("I")
        levels = np.asarray(picture if grey else picture.convert("RGB"))
    shades = np.arange(65536) / 65535 if grey else np.arange(256) / 255
    picked = curve(shades).astype(np.float32)[levels]
    return np.repeat(picked[..., None], 3, axis=-1) if grey else picked


def decode_jpg(path: Path, data: bytes, curve: Curve) -> Pixels:
    """Return the (H, W, 3) linear picture in the JPG file `data`. curve: from its display values."""
    from PIL.JpegImagePlugin import JpegImageFile

    with JpegImageFile(io.BytesIO(data)) as picture:
        check_size(path, picture.width * picture.height * 12, PICTURE_BYTES, "decodes to")
        levels = np.asarray(picture.convert("RGB"))
    picked: Pixels = curve(np.arange(256) / 255).astype(np.float32)[levels]
    return picked


def _check_chunks(data: bytes) -> None:
    """Raise ValueError where a chunk is cut off or damaged: Pillow makes what it can of such pixels."""
    place, kind = 8, b""
    while kind != b"IEND":
        if place + 12 > len(data):
            raise ValueError("is cut off")
        size, kind = struct.unpack_from(">I4s", data, place)
        end = place + 8 + size
        if end + 4 > len(data):
            raise ValueError("is cut off")
        # Those in lower case are notes that pixels do not depend on
        if kind[:1].isupper() and zlib.crc32(data[place + 4 : end]) != int.from_bytes(data[end : end + 4]):
            raise ValueError(f"its chunk {kind.decode('latin-1')} is damaged")
        place = end + 4


def decode_exr(path: Path, data: bytes, layer: str | None = None) -> Pixels:
    """Return the (H, W, 3) picture of the channels R, G, B, or Y alone, in the EXR file at `path` with `data`.

    layer: return that output (H, W) or (H, W, c) instead.
    """
    import OpenEXR

    if not data.startswith(EXR_START):
        raise ValueError("is no EXR file")
    check_size(path, _exr_bytes(data), PICTURE_BYTES, "decodes to")
    with _hushed(), OpenEXR.File(str(path), separate_channels=True) as file:
        channels = {name: channel.pixels for name, channel in file.channels().items()}
    names = ["R", "G", "B"] if "R" in channels else ["Y", "Y", "Y"]
    if layer is not None:
        names = layer_in(channels, layer)
    missing = [name for name in names if name not in channels]
    if missing:
        raise ValueError(f"has no channel {missing[0]}")
    planes = [np.asarray(channels[name], np.float32) for name in names]
    if planes[0].ndim != 2 or any(plane.shape != planes[0].shape for plane in planes) or planes[0].size == 0:
        raise ValueError("its channels are of different sizes")
    return planes[0] if len(planes) == 1 else np.stack(planes, axis=-1)


def _exr_bytes(data: bytes) -> int:
    """Return the bytes of all channels of all parts, each number four, as the headers announce them."""
    total, area, channels, place = 0, 0, 0, 8
    many_parts = bool(data[5] & 16)
    while True:
        name, place = _word(data, place)
        if not name:
            total, area, channels = total + 4 * area * channels, 0, 0
            # The headers of several parts end with an empty one
            if not many_parts or data[place : place + 1] in (b"\0", b""):
                return total
            continue
        _, place = _word(data, place)
        (size,) = struct.unpack_from("<i", data, place)
        value, place = data[place + 4 : place + 4 + size], place + 4 + size
        if size < 0 or place > len(data):
            raise ValueError("its header is damaged")
        if name == b"channels":
            channels = _count_channels(value)
        elif name == b"dataWindow":
            left, top, right, bottom = struct.unpack("<4i", value)
            area = max(right - left + 1, 0) * max(bottom - top + 1, 0)


def _count_channels(value: bytes) -> int:
    """Return how many channels a list of them names, each followed by 16 bytes."""
    count, place = 0, 0
    while value[place : place + 1] not in (b"\0", b""):
        count, place = count + 1, _word(value, place)[1] + 16
    return count


def _word(data: bytes, place: int) -> tuple[bytes, int]:
    """Return the bytes up to the next zero, and the place behind that."""
    end = data.find(b"\0", place)
    if end < 0:
        raise ValueError("its header is damaged")
    return data[place:end], end + 1


@contextmanager
def _hushed() -> Iterator[None]:
    """Keep OpenEXR from telling the terminal what its errors tell as well."""
    before, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        with redirect_stdout(io.StringIO()):
            yield
    finally:
        os.dup2(before, 2)
        os.close(before)
        os.close(nowhere)
