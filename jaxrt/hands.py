"""A picture drawn by many hands: threads on the cores of a CPU, the devices of an accelerator, those of other hosts.

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

from jaxrt.hosts.team import Team
from jaxrt.programs import load_or_compile
from jaxrt.render import scene_tables
from jaxrt.scene import Scene
from jaxrt.transport.film import Plan, Run, joined, shares_of


def painter(
    folder: Path | None, scene: Scene, run: Run, plan: Plan, cores: int, team: Team | None = None
) -> Callable[[Run], NDArray[np.float32]]:
    """Return what draws the sums (height, width, channels, 3) of a run's samples, in parts along the last axis.

    folder: where compiled programs are kept, if anywhere. run: of no samples; programs are tried with it. team: those
    who draw it together: each has all sums.
    """
    size = scene.camera.width, scene.camera.height
    devices = [device for device in plan.devices for _ in range(cores if device.platform == "cpu" else 1)]
    owners, plan = _owners(size, plan, len(devices), team)
    hands: SimpleQueue[Callable[[Run, np.int32], jax.Array]] = SimpleQueue()
    for device in plan.devices:
        one = plan._replace(devices=(device,))
        tables = scene_tables(scene if len(plan.devices) == 1 else jax.device_put(scene, device))
        program = load_or_compile(folder, scene, tables, run, one)
        for _ in range(devices.count(device)):
            hands.put(partial(program, tables))
    pool = ThreadPoolExecutor(hands.qsize(), thread_name_prefix="jaxrt")
    mine = np.flatnonzero(owners == (team.rank if team else 0))
    shape = np.bincount(owners).max(), shares_of(size, plan)[1], plan.lanes, plan.channels, 3

    def draw_share(run: Run, share: int, part: NDArray[np.float32]) -> None:
        hand = hands.get()
        try:
            part[:] = hand(run, np.int32(share))
        finally:
            hands.put(hand)

    def draw(run: Run) -> NDArray[np.float32]:
        parts = np.zeros(shape, scene.dtype)
        list(pool.map(partial(draw_share, run), mine, parts))
        return joined(_all_shares(parts, owners, team), size, plan)

    return draw


def _owners(size: tuple[int, int], plan: Plan, hands: int, team: Team | None) -> tuple[NDArray[np.int64], Plan]:
    """Return who draws each share, as many as all have hands at least, and the plan with so many."""
    if team is None:
        return np.zeros(shares_of(size, plan)[0], int), plan
    everyone = team.gather(np.array(hands, np.int32))
    plan = plan._replace(shares=max(plan.shares, int(everyone.sum())))
    # Dealt like cards, one to each hand
    return np.resize(np.repeat(np.arange(team.count), everyone), shares_of(size, plan)[0]), plan


def _all_shares(parts: NDArray[np.float32], owners: NDArray[np.int64], team: Team | None) -> NDArray[np.float32]:
    """Return the parts of all shares from those of this process."""
    if team is None:
        return parts
    everyone = team.gather(parts)
    turn = [np.count_nonzero(owners[:share] == owner) for share, owner in enumerate(owners)]
    return everyone[owners, turn]
