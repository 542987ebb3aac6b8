"""One process on each host: started here and by ssh, watched until all have ended. Imports nothing large."""

import os
import shlex
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import FrameType

from jaxrt.hosts.seats import Seat

LOST = 4  # exit status of those that another host has left alone
ALONE = (
    0,
    LOST,
    -signal.SIGABRT,
    128 + signal.SIGABRT,
)  # statuses of hosts that were sound; JAX aborts where rank 0 is gone
PATIENCE = 90.0  # seconds that the others have to notice a loss and to keep their work
LEAVING = 10.0  # seconds in which all end once rank 0 has
SSH = ("ssh", "-o", "BatchMode=yes", "-o", "ServerAliveInterval=10", "-o", "ServerAliveCountMax=3")
SIGNALS = (signal.SIGINT, signal.SIGTERM, *((signal.SIGHUP,) if hasattr(signal, "SIGHUP") else ()))


def launch(hosts: Sequence[str], words: Sequence[str]) -> int:
    """Run `jaxrt` with these words on each host, `--hosts` last, and return the exit status of the first.

    The first host is this one; processes on it are its own, those on others ssh's. Where one is lost, says on stderr
    which, and returns `LOST` where that is the first.
    """
    address = f"{hosts[0].rpartition('@')[2]}:{_free_port()}"
    children: list[subprocess.Popen[bytes]] = []
    try:
        with _passed_on(children):
            for rank, host in enumerate(hosts):
                seat = str(Seat(rank, len(hosts), address))
                command = [sys.executable, "-m", "jaxrt", *words, "--hosts", seat]
                # In sessions of their own: Ctrl-C is for rank 0 alone, which ends the others
                children.append(
                    subprocess.Popen(
                        command if host == hosts[0] else remote(host, command),
                        stdin=subprocess.DEVNULL,
                        stdout=subprocess.DEVNULL if rank else None,  # but for rank 0 only gloo speaks
                        start_new_session=True,
                    )
                )
            ended = _watch(children)
    finally:
        for child in children:
            if child.poll() is None:
                child.kill()
                child.wait()
    first, lost = children[0].returncode, _lost(ended, len(hosts))
    for rank in lost:
        print(f"jaxrt: error: host {rank} of {len(hosts)} ({hosts[rank]}) {_fate(ended.get(rank))}", file=sys.stderr)
    return LOST if first < 0 else first


def remote(host: str, command: Sequence[str]) -> list[str]:
    """Return what runs a command on another host, in the folder of the same name there."""
    return [*SSH, host, f"cd {shlex.quote(os.getcwd())} && exec {shlex.join(command)}"]


def _free_port() -> int:
    with socket.socket() as listener:
        listener.bind(("", 0))
        port: int = listener.getsockname()[1]
        return port


def _watch(children: Sequence[subprocess.Popen[bytes]]) -> dict[int, int]:
    """Return the exit status of each child that has ended by itself; the others are left when time is up."""
    ended: dict[int, int] = {}
    until = float("inf")
    while len(ended) < len(children) and time.monotonic() < until:
        for rank, child in enumerate(children):
            if rank not in ended and child.poll() is not None:
                ended[rank] = child.returncode
                if rank == 0 or child.returncode:
                    until = min(until, time.monotonic() + (LEAVING if rank == 0 else PATIENCE))
        time.sleep(0.05)
    return ended


def _lost(ended: dict[int, int], count: int) -> list[int]:
    """Return the ranks that others have lost: those that broke down and, where others say so, those that are silent.

    A first host that refuses, or ends for a reason that it tells, has lost nobody.
    """
    broken = [rank for rank, status in ended.items() if rank and status not in ALONE]
    if ended.get(0) is not None and ended[0] < 0 and ended[0] not in ALONE:
        broken.append(0)
    alone = any(status in ALONE[1:] for status in ended.values())
    silent = [rank for rank in range(count) if rank not in ended] if alone and not broken else []
    return sorted(broken) or silent


def _fate(status: int | None) -> str:
    if status is None:
        return "is lost: it gave no more sign of life, and was killed"
    if status < 0:
        return f"is lost: ended by signal {-status}"
    return f"ended with status {status}"


@contextmanager
def _passed_on(children: Sequence[subprocess.Popen[bytes]]) -> Iterator[None]:
    """Hand signals to rank 0, which ends the work."""

    def hand(number: int, frame: FrameType | None) -> None:
        for child in children[:1]:
            child.send_signal(number)

    before = {number: signal.signal(number, hand) for number in SIGNALS}
    try:
        yield
    finally:
        for number, old in before.items():
            signal.signal(number, old)
