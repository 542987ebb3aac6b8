"""A long sum of samples in chunks, between which there is progress to tell and work to keep.

Chunks are whole blocks of samples, as many as the clock suggests: their sums are exact, so that this changes no bit.
"""

import math
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from jaxrt.io.partial import Partial
from jaxrt.transport.film import BLOCK

CHUNK_SECONDS = 0.5  # between two steps of the progress bar, more for long runs
CHUNKS = 20  # about as many steps a run
CHUNK_SECONDS_MAX = 5.0
IDLE_SHARE = 0.1  # of a chunk's time may go into what it takes besides its samples, such as the tables of a mesh

Draw = Callable[[int, int], NDArray[np.float32]]  # (first, count) -> parts of the sum along the last axis


def accumulate(draw: Draw, total: Partial, end: int, keep: Callable[[Partial], bool]) -> Partial:
    """Return `total` with samples up to `end` added, in chunks. `keep` gets each new sum, and says whether to go on."""
    blocks, single, whole = 1, 0.0, -(-(end - total.end) // BLOCK)
    while total.end < end:
        first, count = total.end, min(blocks * BLOCK, end - total.end)
        start = time.perf_counter()
        total = total.plus(first + count, *np.moveaxis(draw(first, count), -1, 0))
        seconds = max(time.perf_counter() - start, 1e-9)
        single = single or seconds
        if not keep(total):
            break
        blocks = _next_blocks(whole, blocks, seconds, single)
    return total


def _next_blocks(whole: int, blocks: int, seconds: float, single: float) -> int:
    """Return how many blocks to draw next, after `blocks` of `whole` took `seconds`. single: seconds that one took."""
    most = seconds / blocks
    each = most if blocks == 1 else max((seconds - single) / (blocks - 1), most * 1e-3)
    idle = max(seconds - each * blocks, 0)
    wanted = min(max(CHUNK_SECONDS, idle / IDLE_SHARE, whole * each / CHUNKS), CHUNK_SECONDS_MAX)
    # No more than are sure to fit, or twice as many; two where they fit, which tell what a chunk takes idly
    sure = CHUNK_SECONDS_MAX / most
    wanted_blocks = max(min((wanted - idle) / each, max(sure, 2 * blocks)), min(2, sure))
    return 1 << max(0, math.floor(math.log2(wanted_blocks)))
