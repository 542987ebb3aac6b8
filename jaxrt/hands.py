"""A picture drawn by many hands: threads on the cores of a CPU, or the devices of an accelerator.

All threads of a CPU run one and the same program, each on another share of the picture, so that their number is no part
of what is compiled. What they draw does not depend on who draws it.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from queue import SimpleQueue

import jax
import numpy as np
from numpy.typing import NDArray

from jaxrt.programs import load_or_compile
from jaxrt.render import scene_tables
from jaxrt.scene import Scene
from jaxrt.transport.film import Plan, Run, joined, shares_of


def painter(
    folder: Path | None, scene: Scene, run: Run, plan: Plan, cores: int
) -> Callable[[Run], NDArray[np.float32]]:
    """Return what draws the sums (height, width, channels, 3) of a run's samples, in parts along the last axis.

    folder: where compiled programs are kept, if anywhere. run: of no samples; programs are tried with it.
    """
    size = scene.camera.width, scene.camera.height
    hands: SimpleQueue[Callable[[Run, np.int32], jax.Array]] = SimpleQueue()
    for device in plan.devices:
        one = plan._replace(devices=(device,))
        tables = scene_tables(scene if len(plan.devices) == 1 else jax.device_put(scene, device))
        program = load_or_compile(folder, scene, tables, run, one)
        for _ in range(cores if device.platform == "cpu" else 1):
            hands.put(partial(program, tables))
    pool = ThreadPoolExecutor(hands.qsize(), thread_name_prefix="jaxrt")

    def draw_share(run: Run, share: int, parts: NDArray[np.float32]) -> None:
        hand = hands.get()
        try:
            parts[share] = hand(run, np.int32(share))
        finally:
            hands.put(hand)

    def draw(run: Run) -> NDArray[np.float32]:
        shares, turns = shares_of(size, plan)
        parts = np.empty((shares, turns, plan.lanes, plan.channels, 3), scene.dtype)
        list(pool.map(lambda share: draw_share(run, share, parts), range(shares)))
        return joined(parts, size, plan)

    return draw
