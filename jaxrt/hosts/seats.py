"""Which hosts there are, and which of them this process is. Imports nothing large."""

import re
from dataclasses import dataclass

from jaxrt.core.messages import show

AUTO = "auto"  # what a scheduler has set says who is who
NAME = r"(?:[a-zA-Z0-9][\w.-]*@)?[a-zA-Z0-9][\w.-]*"  # as ssh takes it, and never an option of it
SEAT = re.compile(r"(\d{1,6})/(\d{1,6})@(\S+:\d{1,5})")


@dataclass(frozen=True)
class Seat:
    """One process of several; all three are None where the scheduler knows."""

    rank: int | None = None
    count: int | None = None
    address: str | None = None  # of rank 0, host:port

    def __str__(self) -> str:
        return f"{self.rank}/{self.count}@{self.address}"


def hosts_from(text: str) -> Seat | list[str]:
    """Return the seat that `auto` or `RANK/COUNT@HOST:PORT` names, or the names of hosts to be started.

    Raises ValueError for what is neither.
    """
    if text == AUTO:
        return Seat()
    seat = SEAT.fullmatch(text)
    if seat:
        rank, count = int(seat[1]), int(seat[2])
        if rank >= count:
            raise ValueError(f"{show(text)}: there is no rank {rank} among {count}: they are 0 to {count - 1}")
        return Seat(rank, count, seat[3])
    names = text.split(",")
    if not all(re.fullmatch(NAME, name) for name in names):
        raise ValueError(f"{show(text)} names no hosts: write A,B,C, auto under a scheduler, or RANK/COUNT@HOST:PORT")
    if len(names) == 1:
        raise ValueError(f"{show(text)} is one host: name several, this one first")
    return names
