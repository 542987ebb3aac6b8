"""Processes that compute together, by JAX's own means: `jax.distributed`, and gathering over all devices.

On CPUs the exchange is gloo's, over TCP.
"""

import atexit
import os
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import jax
import numpy as np
from jax.experimental import multihost_utils
from numpy.typing import NDArray

from jaxrt.hosts.launch import LOST
from jaxrt.hosts.seats import Seat

SILENCE = 30  # seconds without a sign of life after which a host is lost
START = 100  # seconds in which all have to come
LOOK = 2.0  # seconds between two looks at who is there

Lost = Callable[[list[int]], object]


class NobodyThere(ValueError):
    """Hosts that do not find together."""


@dataclass
class Team:
    """This process among `count`, which do the same calls in the same order."""

    rank: int
    count: int
    lost: Lost  # what is called with the ranks that are lost, before this process ends with status `LOST`
    _ended: threading.Event = field(default_factory=threading.Event)
    _watcher: threading.Thread = field(init=False)

    def __post_init__(self) -> None:
        """Begin to look for lost hosts: in a thread, for another may wait for ever for what they were to send."""
        atexit.register(self._ended.set)  # before JAX parts from the others, which would look like a loss
        self._watcher = threading.Thread(target=self._look, daemon=True)
        self._watcher.start()

    def gather(self, x: NDArray[Any]) -> NDArray[Any]:
        """Return the arrays (count, …) of all, which are of one shape."""
        try:
            return np.asarray(multihost_utils.process_allgather(x)).reshape(self.count, *x.shape)
        except Exception:
            # Who is lost is known when it has been silent long enough; the watcher ends this process then
            self._ended.wait(3 * SILENCE)
            raise

    def first_says(self, *numbers: int) -> tuple[int, ...]:
        """Return the numbers that rank 0 has."""
        return tuple(self.gather(np.array(numbers, np.int32))[0].tolist())

    def leave(self, *last: int) -> None:
        """Miss nobody from now on. Rank 0 says its last numbers, if any, and goes last: the others need it to part."""
        self._ended.set()
        if self.rank == 0:
            with suppress(Exception):
                if last:
                    self.first_says(*last)
            self._watcher.join(2 * SILENCE)

    def _look(self) -> None:
        everyone = set(range(self.count))
        missing: set[int] = set()
        while not (self._ended.is_set() and everyone - missing <= {self.rank}):
            missing = self._missing()
            if missing and not self._ended.is_set():
                try:
                    self.lost(sorted(missing))
                finally:
                    os._exit(LOST)

    def _missing(self) -> set[int]:
        """Return the ranks that are gone, after a while."""
        try:
            with multihost_utils.live_devices(jax.devices()) as there:
                self._ended.wait(LOOK)
            return set(range(self.count)) - {device.process_index for device in there}
        except multihost_utils.ProcessFailureError as error:
            return {device.process_index for device in error.failed_devices}
        except Exception:  # of many types: who is there is known to rank 0, which does not answer
            return set(range(self.count)) - {self.rank} if self._ended.is_set() or self.rank == 0 else {0}


def join(seat: Seat, lost: Lost) -> Team:
    """Return this process's place among those that have come together. Must come before JAX computes anything.

    lost: called with the ranks of hosts that are lost; the process ends then.

    Raises NobodyThere where no scheduler has said who is who, or they do not come in time.
    """
    # The others live on when one is lost, to keep what they have
    jax.config.update("jax_enable_recoverability", True)
    given = seat.address is not None
    try:
        jax.distributed.initialize(
            seat.address,
            seat.count,
            seat.rank,
            cluster_detection_method="deactivate" if given else None,
            heartbeat_timeout_seconds=SILENCE,
            initialization_timeout=START,
            shutdown_timeout_seconds=SILENCE,
        )
    except ValueError:
        if given:
            raise
        raise NobodyThere("auto: no scheduler tells who is who: start with srun or mpirun, or name the hosts") from None
    except RuntimeError as error:
        raise NobodyThere(f"{seat if given else 'auto'}: the hosts do not find together: {error}") from None
    return Team(jax.process_index(), jax.process_count(), lost)
