"""A long sum of samples in chunks, between which there is progress to tell."""

import math
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

CHUNK_SECONDS = 0.5  # between two steps of the progress bar, more for long runs
CHUNKS = 20  # about as many steps a run
CHUNK_SECONDS_MAX = 5.0
IDLE_SHARE = 0.1  # of a chunk's time may go into what it takes besides its samples, such as the tables of a mesh


def accumulate(
    draw: Callable[[int, int], NDArray[np.float32]], spp: int, report: Callable[[int], None]
) -> NDArray[np.float64]:
    """Return the sum of `spp` samples, drawn as draw(first, count) in chunks, powers of two, of about CHUNK_SECONDS."""
    total = np.zeros((), np.float64)
    first, count, single = 0, 1, 0.0
    while first < spp:
        count = min(count, spp - first)
        start = time.perf_counter()
        total = total + draw(first, count)
        seconds = max(time.perf_counter() - start, 1e-9)
        single = single or seconds
        first += count
        report(first)
        count = _next_count(spp, count, seconds, single)
    return total


def _next_count(spp: int, count: int, seconds: float, single: float) -> int:
    """Return how many samples to draw next, after `count` took `seconds`. single: seconds that one sample took."""
    most = seconds / count
    each = most if count == 1 else max((seconds - single) / (count - 1), most * 1e-3)
    idle = max(seconds - each * count, 0)
    wanted = min(max(CHUNK_SECONDS, idle / IDLE_SHARE, spp * each / CHUNKS), CHUNK_SECONDS_MAX)
    # No more than are sure to fit, or twice as many; two where they fit, which tell what a chunk takes idly
    sure = CHUNK_SECONDS_MAX / most
    samples = max(min((wanted - idle) / each, max(sure, 2 * count)), min(2, sure))
    return 1 << max(0, math.floor(math.log2(samples)))
