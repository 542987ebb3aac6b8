"""CPU time of a call."""

import time
from collections.abc import Callable
from typing import Any

import jax


def cpu_seconds(f: Callable[..., Any], *arguments: Any) -> tuple[Any, float]:
    """Return f(*arguments), finished, and the CPU seconds that it took, of all threads of this process."""
    start = time.process_time()
    result = jax.block_until_ready(f(*arguments))
    return result, time.process_time() - start
