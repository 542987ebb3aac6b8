"""Transfer curves between linear radiance and display values, and luminance. NumPy, on the host."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

REC709 = (0.2126, 0.7152, 0.0722)  # luminance of linear RGB with the primaries of ITU-R BT.709


def luminance(rgb: ArrayLike) -> NDArray[np.floating]:
    """Return the luminance (...) of linear RGB (..., 3), in the same unit."""
    rgb = np.asarray(rgb)
    return rgb @ np.asarray(REC709, rgb.dtype)


def gamma_encode(x: ArrayLike, gamma: float = 2.2) -> NDArray[np.floating]:
    """Return the display value x^(1/gamma) of linear x; negative values become 0."""
    return np.maximum(x, 0) ** (1 / gamma)


def gamma_decode(y: ArrayLike, gamma: float = 2.2) -> NDArray[np.floating]:
    """Return the linear value y^gamma of display value y; negative values become 0."""
    return np.maximum(y, 0) ** gamma


def srgb_encode(x: ArrayLike) -> NDArray[np.floating]:
    """Return the sRGB display value of linear x (IEC 61966-2-1); negative values become 0."""
    x = np.maximum(x, 0)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def srgb_decode(y: ArrayLike) -> NDArray[np.floating]:
    """Return the linear value of sRGB display value y (IEC 61966-2-1); negative values become 0."""
    y = np.maximum(y, 0)
    return np.where(y <= 0.04045, y / 12.92, ((y + 0.055) / 1.055) ** 2.4)
