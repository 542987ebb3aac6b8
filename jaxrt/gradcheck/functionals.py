"""Numbers of a picture that see shadows move. Its mean does not: what one edge gains the other loses."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jaxrt.io.color import REC709

Numbers = NDArray[np.float64]

LUMINANCE = np.array(REC709)
BUMPS = 8  # Gaussians along each axis
MOMENTS, BUMPS_NAME = "first moments", "Gaussian bumps"


def functionals(picture: ArrayLike) -> dict[str, Numbers]:
    """Return linear functionals of a picture (height, width, 3) by group, each divided by the number of pixels.

    First moments: Σ x p and Σ y p, x and y from −1 to 1, over the picture for luminance and each channel, then over
    its quadrants for luminance. Gaussian bumps: luminance under 8×8 Gaussians that just overlap: they see
    a shadow's edge where the light around it changes little.
    """
    p = np.asarray(picture, np.float64)
    height, width, _ = p.shape
    bright = p @ LUMINANCE
    moments = [_moments(channel, *_axes(height, width)) for channel in (bright, *np.moveaxis(p, -1, 0))]
    for rows in _halves(height):
        for columns in _halves(width):
            part = bright[rows, columns]
            moments.append(_moments(part, *_axes(*part.shape)))
    bumps = _gaussians(height) @ bright @ _gaussians(width).T
    return {MOMENTS: np.concatenate(moments) / bright.size, BUMPS_NAME: bumps.ravel() / bright.size}


def loss_slope(residual: ArrayLike, change: ArrayLike) -> float:
    """Return the derivative of the loss ½ mean(residual²) along a change of the picture."""
    return float(np.mean(np.asarray(residual, np.float64) * np.asarray(change, np.float64)))


def _axes(height: int, width: int) -> tuple[Numbers, Numbers]:
    """Return y and x of the pixels, from −1 to 1; y grows downwards."""
    return _axis(height), _axis(width)


def _axis(n: int) -> Numbers:
    return (2 * np.arange(n) + 1) / max(n, 1) - 1


def _moments(p: Numbers, y: Numbers, x: Numbers) -> Numbers:
    return np.array([p.sum(0) @ x, p.sum(1) @ y])


def _halves(n: int) -> tuple[slice, slice]:
    return slice(0, n // 2), slice(n // 2, n)


def _gaussians(n: int) -> Numbers:
    """Return the weights (BUMPS, n) of Gaussians along an axis, their centres evenly spread."""
    centers = _axis(BUMPS)[:, None]
    return np.exp(-0.5 * ((_axis(n)[None, :] - centers) * BUMPS / 1.2) ** 2)
