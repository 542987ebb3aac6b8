"""Pictures of all kinds, damaged: flipped bits, lost and foreign pieces, headers that lie."""

import io
import random
import struct
import tempfile
import zlib
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import numpy as np

from benchmarks.fuzz.judge import Case

SIZE = (7, 5)  # width, height
NUMBERS = [0, 1, 2, 255, 256, 2**16, 2**24, 2**31 - 1, 2**31, 2**32 - 1]
PNG_START = 8


def _png(mode: str) -> bytes:
    from PIL import Image

    levels = np.random.default_rng(0).integers(0, 256, (SIZE[1], SIZE[0], 3), np.uint8)
    picture = Image.fromarray(levels).convert("L" if mode == "I;16" else mode)
    if mode == "I;16":
        picture = Image.fromarray(np.asarray(picture).astype(np.uint16) * 257)
    file = io.BytesIO()
    picture.save(file, format="PNG")
    return file.getvalue()


def _exr(compression: str) -> bytes:
    import OpenEXR

    pixels = np.random.default_rng(0).random((SIZE[1], SIZE[0], 3), np.float32)
    header = {"compression": getattr(OpenEXR, f"{compression}_COMPRESSION"), "type": OpenEXR.scanlineimage}
    with tempfile.TemporaryDirectory() as folder:
        OpenEXR.File(header, {"RGB": pixels}).write(f"{folder}/a.exr")
        return Path(folder, "a.exr").read_bytes()


@cache
def wholes() -> dict[str, bytes]:
    """Return undamaged files by name, which ends in their suffix."""
    pngs = {f"{mode}.png": _png(mode) for mode in ("RGB", "RGBA", "L", "LA", "P", "1", "I;16")}
    return pngs | {f"{kind}.exr": _exr(kind) for kind in ("NO", "ZIP", "ZIPS", "RLE", "PIZ", "PXR24", "B44", "DWAA")}


def mutations(seed: int, n: int) -> Iterator[Case]:
    """Return n cases; the first are undamaged and must be read."""
    rng = random.Random(f"pictures {seed}")
    names = list(wholes())
    yield from (Case(name, wholes()[name], _suffix(name), taken=True, check=_has_size) for name in names[:n])
    for i in range(n - len(names)):
        name = rng.choice(names)
        damage: Callable[[random.Random, bytes], tuple[bytes, bool]] = rng.choice(
            [_flip, _cut, _splice, _header, _header]
        )
        content, whole = damage(rng, wholes()[name])
        # A PNG guards all of its chunks with checksums, which no accident passes; an EXR file guards nothing
        guarded = whole and (name.endswith(".png") or damage is _cut)
        check = _same_as(name) if guarded else _has_any_size(content, _suffix(name))
        yield Case(f"{name} {damage.__name__[1:]} {i}", content, _suffix(name), check=check)


def _suffix(name: str) -> str:
    return name[name.index(".") :]


def _flip(rng: random.Random, content: bytes) -> tuple[bytes, bool]:
    damaged = bytearray(content)
    for _ in range(rng.choice([1, 1, 1, 2, 8])):
        damaged[rng.randrange(len(damaged))] ^= 1 << rng.randrange(8)
    return bytes(damaged), True


def _cut(rng: random.Random, content: bytes) -> tuple[bytes, bool]:
    start = rng.randrange(len(content))
    return content[:start] + (content[start + rng.randint(1, 40) :] if rng.random() < 0.5 else b""), True


def _splice(rng: random.Random, content: bytes) -> tuple[bytes, bool]:
    """Put a piece of another file, of the same or of noise into the content, or in the place of some."""
    other = rng.choice([rng.choice(list(wholes().values())), content, rng.randbytes(200)])
    start, at = rng.randrange(len(other)), rng.randrange(len(content))
    piece = other[start : start + rng.randint(1, 60)]
    return content[:at] + piece + content[at + rng.choice([0, len(piece)]) :], True


def _header(rng: random.Random, content: bytes) -> tuple[bytes, bool]:
    """Write a number into the header; a PNG's checksum is made to fit, so that only sense can tell."""
    damaged = bytearray(content)
    if content.startswith(b"\x89PNG"):
        at = rng.choice([16, 20])
        damaged[at : at + 4] = struct.pack(">I", rng.choice(NUMBERS))
        if rng.random() < 0.5:
            damaged[rng.randrange(24, 29)] = rng.randrange(256)
        damaged[29:33] = struct.pack(">I", zlib.crc32(damaged[12:29]))
        return bytes(damaged), False
    at = rng.randrange(4, min(len(damaged) - 4, 420))
    place = content.find(b"box2i\0")
    if rng.random() < 0.5:
        at = place + 10 + 4 * rng.randrange(4)
    damaged[at : at + 4] = struct.pack("<I", rng.choice(NUMBERS))
    return bytes(damaged), False


def _has_size(picture: np.ndarray) -> str:
    good = picture.shape == (SIZE[1], SIZE[0], 3) and picture.dtype == np.float32
    return "" if good else f"{picture.dtype} {picture.shape}"


def _has_any_size(content: bytes, suffix: str) -> Callable[[np.ndarray], str]:
    """Return a check that the picture has the size that its header gives."""

    def check(picture: np.ndarray) -> str:
        if suffix == ".png":
            width, height = struct.unpack_from(">2I", content, 16)
        else:
            place = content.index(b"dataWindow\0box2i\0") + 21
            left, top, right, bottom = struct.unpack_from("<4i", content, place)
            width, height = right - left + 1, bottom - top + 1
        good = picture.shape == (height, width, 3) and picture.dtype == np.float32
        return "" if good else f"{picture.dtype} {picture.shape}, header {width}x{height}"

    return check


def _same_as(name: str) -> Callable[[np.ndarray], str]:
    """Return a check that the picture is that of the undamaged file."""

    def check(picture: np.ndarray) -> str:
        expected = _decoded(name)
        return (
            "" if picture.shape == expected.shape and np.allclose(picture, expected, atol=1e-6) else "another picture"
        )

    return check


@cache
def _decoded(name: str) -> np.ndarray:
    """Return the picture (H, W, 3) in an undamaged file, as Pillow and OpenEXR read it."""
    import OpenEXR
    from PIL import Image

    if name.endswith(".exr"):
        with tempfile.TemporaryDirectory() as folder:
            Path(folder, "a.exr").write_bytes(wholes()[name])
            return OpenEXR.File(f"{folder}/a.exr").channels()["RGB"].pixels
    with Image.open(io.BytesIO(wholes()[name])) as whole:
        levels = np.asarray(whole if whole.mode == "I;16" else whole.convert("RGB"), float)
    picture = (levels / (65535 if levels.ndim == 2 else 255)) ** 2.2
    return picture if picture.ndim == 3 else np.repeat(picture[..., None], 3, -1)
