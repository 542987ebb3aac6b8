"""The outputs of a render as files: layers of one EXR, or PNGs beside one another.

An EXR has the picture as R, G, B, and each other output as a layer of its name: `depth.Z`, `normal.X`, …. Where there
is `foreground` with `alpha`, these are the picture, as R, G, B, A: to be laid over another.
"""

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jaxrt.core.messages import nearest, show
from jaxrt.io import color

Floats = NDArray[np.floating]
AXES = {"depth": "Z", "position": "XYZ", "normal": "XYZ", "uv": "UV", "alpha": "A"}
NO_FILE = r"[^\w\[\] .-]"  # characters of names that those of files do not have
DIM = 0.1  # of white: the farthest point in a PNG of depth
GOLDEN = 0.618034  # of the circle of hues: neighbouring numbers look different


def main_of(layers: Mapping[str, Any]) -> str | None:
    """Return which of the layers is the picture itself, None for none of them."""
    if "foreground" in layers and "alpha" in layers:
        return "foreground"
    return "radiance" if "radiance" in layers else None


def channels_of(layers: Mapping[str, Floats]) -> dict[str, Floats]:
    """Return the channels (H, W) of an EXR file by name."""
    main, channels = main_of(layers), {}
    for name, layer in layers.items():
        planes = layer[..., None] if layer.ndim == 2 else layer
        names = AXES.get(name, "RGB" if planes.shape[2] == 3 else "Y")
        prefix = "" if name == main or (name == "alpha" and main == "foreground") else f"{name}."
        for axis, plane in zip(names, np.moveaxis(planes, -1, 0), strict=True):
            channels[prefix + axis] = np.ascontiguousarray(plane, np.float32)
    return channels


def layer_in(channels: Mapping[str, Any], name: str) -> list[str]:
    """Return the channels of a layer, in the order of its numbers. Raises ValueError where there is none."""
    axes = AXES.get(name, "RGB" if f"{name}.R" in channels else "Y")
    whole = [f"{name}.{axis}" for axis in axes]
    if all(channel in channels for channel in whole):
        return whole
    if name == "alpha" and "A" in channels:
        return ["A"]
    known = dict.fromkeys(channel.rpartition(".")[0] for channel in channels if "." in channel)
    raise ValueError(f"has no layer {show(name)}{nearest(name, known)}: it has {', '.join(known) or 'none'}")


def is_light(name: str) -> bool:
    """Return whether an output is radiance, which exposure brightens."""
    return name in ("radiance", "foreground", "sky")


def shown(name: str, layer: Floats, alpha: Floats | None) -> Floats | None:
    """Return a layer as display values (H, W, 3) in [0, 1]; None for one that is light.

    alpha: the share of pixels that shows anything, if known: depth at outlines is then that of what is there.
    """
    base = name.partition("[")[0]
    if base == "depth" and alpha is not None:
        layer = np.divide(layer, alpha, out=np.zeros_like(layer), where=alpha > 0)
    return _SHOWN[base](layer) if base in _SHOWN else None


def png_beside(path: Path, name: str) -> Path:
    """Return where the PNG of a layer goes: `room.depth.png` beside `room.png`."""
    return path.with_name(f"{path.stem}.{re.sub(NO_FILE, '_', name)}{path.suffix}")


def with_alpha(foreground: Floats, alpha: Floats, srgb: bool) -> Floats:
    """Return display values (H, W, 4) in [0, 1], as PNG has them: colours are not multiplied by their alpha."""
    share = np.clip(alpha, 0, 1)[..., None]
    light = np.divide(foreground, share, out=np.zeros_like(foreground), where=share > 0)
    return np.concatenate([color.srgb_encode(light) if srgb else color.gamma_encode(light), share], -1)


def _grey(layer: Floats) -> Floats:
    return np.repeat(layer[..., None], 3, -1)


def _depth(layer: Floats) -> Floats:
    """Return white for what is nearest, black for nothing."""
    met = layer > 0
    if not met.any():
        return _grey(layer)
    near, far = layer[met].min(), layer[met].max()
    share = (layer - near) / (far - near) if far > near else np.zeros_like(layer)
    return _grey(np.where(met, 1 - (1 - DIM) * share, 0))


def _position(layer: Floats) -> Floats:
    low, high = layer.min((0, 1), keepdims=True), layer.max((0, 1), keepdims=True)
    return (layer - low) / np.where(high > low, high - low, 1)


def _uv(layer: Floats) -> Floats:
    return np.concatenate([layer, np.zeros_like(layer[..., :1])], -1)


def _numbers(layer: Floats) -> Floats:
    """Return a colour of its own for each number, black for nothing."""
    hue = 6 * (layer[..., None] * GOLDEN % 1)
    colours = np.clip(np.abs((hue + np.asarray([[[0, 4, 2]]])) % 6 - 3) - 1, 0, 1)
    return np.where(layer[..., None] >= 0, 0.25 + 0.75 * colours, 0)


_SHOWN: dict[str, Callable[[Floats], Floats]] = {
    "alpha": _grey,
    "mask": _grey,
    "depth": _depth,
    "position": _position,
    "normal": lambda layer: (layer + 1) / 2,
    "uv": _uv,
    "shape": _numbers,
    "material": _numbers,
}
