"""`jaxrt render --hosts`: rank 0 leads, the others draw their shares of what it asks for."""

import hashlib
import sys
from collections.abc import Callable, Sequence
from functools import partial

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from jaxrt.cli.errors import UsageError
from jaxrt.cli.signals import noted
from jaxrt.cli.start import warn
from jaxrt.hosts.launch import launch
from jaxrt.hosts.seats import Seat
from jaxrt.hosts.team import NobodyThere, Team, join
from jaxrt.io.partial import MACHINE, Facts
from jaxrt.transport.film import Run

Paint = Callable[[Run], NDArray[np.float32]]


def start(hosts: Sequence[str], words: Sequence[str]) -> int:
    """Run the command that has these words on each host, and return the exit status."""
    place = next(i for i, word in enumerate(words) if word.partition("=")[0] == "--hosts")
    return launch(hosts, [*words[:place], *words[place + (1 if "=" in words[place] else 2) :]])


def joined(seat: Seat) -> Team:
    """Return this process's place among those that draw together. Raises UsageError."""
    try:
        team = join(seat, lambda ranks: None)
    except NobodyThere as error:
        raise UsageError(f"argument --hosts: {error}") from None
    team.lost = partial(tell_loss, team)
    return team


def check_alike(team: Team, facts: Facts) -> None:
    """Refuse hosts that would draw something else than rank 0; warn of those whose processor rounds otherwise."""
    digests = [hashlib.sha256(f"{name} {value}".encode()).digest() for name, value in facts.items()]
    everyone = team.gather(np.array([list(digest) for digest in digests], np.uint8))
    for i, name in enumerate(facts):
        others = [rank for rank in range(team.count) if (everyone[rank, i] != everyone[0, i]).any()]
        if others and name != MACHINE:
            team.leave()
            raise UsageError(f"argument --hosts: host {others[0]} has another {name} than host 0: give all the same")
        if others and team.rank == 0:
            warn(f"host {others[0]} has another processor: the picture is right to 1e-6, not to the bit")


def loss(team: Team, ranks: Sequence[int]) -> str:
    """Return in words which hosts are lost."""
    one = len(ranks) == 1
    return f"host{'' if one else 's'} {', '.join(map(str, ranks))} of {team.count} {'is' if one else 'are'} lost"


def tell_loss(team: Team, ranks: Sequence[int]) -> None:
    """Say which hosts are lost before anything was drawn, once if that can be."""
    if team.rank == 0 or 0 in ranks:
        print(f"jaxrt: error: {loss(team, ranks)}: nothing written", file=sys.stderr)


def leading(team: Team, paint: Paint) -> Paint:
    """Return what draws a run with all that follow."""

    def draw(run: Run) -> NDArray[np.float32]:
        team.first_says(int(run.first), int(run.end))
        return paint(run)

    return draw


def follow(team: Team, paint: Paint, run: Run) -> int:
    """Draw what rank 0 asks for until it asks no more, and return the exit status. It is rank 0 that signals end."""
    with noted():
        while any(samples := team.first_says(0, 0)):
            paint(run._replace(first=jnp.int32(samples[0]), end=jnp.int32(samples[1])))
        team.leave()
    return 0
