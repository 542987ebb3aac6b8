"""What cost work is written where it should be, or else where it can be."""

import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from jaxrt.cli.errors import UsageError
from jaxrt.io.image import save_image

Picture = NDArray[np.float32] | Mapping[str, NDArray[np.float32]]

ELSEWHERE = 3  # exit status of a picture that is not where it should be, or not sound


def save_picture(output: Path, image: Picture, exposure: float, srgb: bool) -> int:
    """Write the picture and return the exit status: 0, or 3 where it is elsewhere or has pixels that are not finite.

    image: the picture, or outputs of which it is the first.

    Raises UsageError where it could be written nowhere.
    """

    def write(path: Path) -> None:
        save_image(path, image, exposure=exposure, srgb=srgb, finite=False)

    broken = _tell_broken(output, next(iter(image.values())) if isinstance(image, Mapping) else image)
    return ELSEWHERE if not save(output, write, "picture") or broken else 0


def save(path: Path, write: Callable[[Path], object], thing: str) -> bool:
    """Let `write` write the file; return whether it is at `path`, having told where it is if not.

    Elsewhere is a new folder in that for temporary files, or in the home folder. Raises UsageError where it could be
    written nowhere.
    """
    try:
        write(path)
        return True
    except OSError as error:
        reason = error.strerror or str(error)
    for base in (tempfile.gettempdir, Path.home):
        try:
            place = Path(tempfile.mkdtemp(prefix="jaxrt-", dir=base())) / path.name
            write(place)
        except OSError:
            continue
        print(f"jaxrt: error: {path}: {reason}: written to {place} instead", file=sys.stderr)
        return False
    raise UsageError(f"{path}: {reason}, and no room for the {thing} elsewhere: make room")


def _tell_broken(output: Path, image: NDArray[np.float32]) -> bool:
    """Return whether there are pixels that are not finite, having told of them."""
    broken = np.argwhere(~np.isfinite(image).all(-1))
    if len(broken) == 0:
        return False
    (i, j), more = broken[0], f" and {len(broken) - 1} more are" if len(broken) > 1 else " is"
    kept = "kept as they are" if output.suffix.lower() == ".exr" else "black or clipped in a PNG"
    print(
        f"jaxrt: warning: {output}: pixel at column {j}, row {i}{more} not finite, {kept}: "
        "look for numbers near 1e38 in the scene",
        file=sys.stderr,
    )
    return True
