"""fit.json, damaged: flipped bits, lost pieces, every value replaced by every odd one."""

import json
import random
from collections.abc import Iterator
from typing import Any

import numpy as np

from benchmarks.fuzz.judge import Case

VECTOR = [0.25, -1.5, 3.0]  # three numbers of one light's position
REPORT = {
    "verdict": None,
    "parameters": {"lights.position[0]": {"value": [0.0, 4.0, 5.0]}},
    "iterations": 2,
    "progress": {"stage": 1, "vector": VECTOR, "losses": [0.5, 0.25]},
}
# fmt: off
ODD = [
    "null", "true", "-1", "1.5", "NaN", "Infinity", "1e999", "1e39", '"1"', "[]", "{}", "[[1]]", "[1, 2]",
    "[null, 1, 2]",
    "9" * 5000, "9" * 400, "[" * 50_000, '{"a":' * 50_000, '"\\ud800"', "[true, 1, 2]", "", "\x00",
    "[" + "1," * 20_000 + "1]",
]
# fmt: on
PLACES = [(), ("parameters",), ("progress",), ("progress", "stage"), ("progress", "vector"), ("progress", "losses")]


def mutations(seed: int, n: int) -> Iterator[Case]:
    """Return n cases: the report as it is, odd values in all places, then drawn damage."""
    rng = random.Random(f"reports {seed}")
    whole = json.dumps(REPORT, indent=2).encode()
    cases = [Case("as it is", whole, ".json", taken=True, check=_check_of(whole)), *_odd(), *_lost()]
    yield from cases[:n]
    for i in range(n - len(cases)):
        content = _damaged(rng, whole)
        yield Case(f"damage {i}", content, ".json", check=_check_of(content))


def _odd() -> Iterator[Case]:
    for place in PLACES:
        for value in ODD:
            text = json.dumps(_replaced(REPORT, place, "@"), indent=2).replace('"@"', value)
            content = text.encode()
            # An empty list of losses and true numbers in it are sound
            sound = place == ("progress", "losses") and value in ("[]", "[1, 2]") or value.startswith("[1,1")
            yield Case(
                f"{'.'.join(place)} = {value[:30]}",
                content,
                ".json",
                taken=None if sound else False,
                check=_check_of(content),
            )


def _lost() -> Iterator[Case]:
    for place in PLACES[1:]:
        report = json.loads(json.dumps(REPORT))
        table = report
        for key in place[:-1]:
            table = table[key]
        del table[place[-1]]
        yield Case(f"{'.'.join(place)} is lost", json.dumps(report).encode(), ".json", taken=False)
    other = json.dumps(REPORT).replace("lights.position[0]", "camera.fov")
    yield Case("another parameter", other.encode(), ".json", taken=False)


def _replaced(report: Any, place: tuple[str, ...], value: str) -> Any:
    if not place:
        return value
    return {**report, place[0]: _replaced(report[place[0]], place[1:], value)}


def _damaged(rng: random.Random, content: bytes) -> bytes:
    damaged = bytearray(content)
    for _ in range(rng.choice([1, 1, 2, 4])):
        at = rng.randrange(len(damaged))
        match rng.randrange(3):
            case 0:
                damaged[at] ^= 1 << rng.randrange(8)
            case 1:
                del damaged[at : at + rng.randint(1, 30)]
            case _:
                damaged[at:at] = rng.choice([*(odd.encode() for odd in ODD if len(odd) < 99), rng.randbytes(4)])
        if not damaged:
            return b""
    return bytes(damaged)


def _check_of(content: bytes) -> Any:
    """Return a check of a fit's progress against the same text, read by the json module alone."""

    def check(progress: Any) -> str:
        told = json.loads(content)["progress"]
        same = (
            np.array_equal(progress.vector, np.asarray(told["vector"], np.float32)) and progress.stage == told["stage"]
        )
        sound = progress.vector.shape == (3,) and np.isfinite(progress.vector).all() and 0 <= progress.stage <= 3
        finite = np.isfinite(progress.losses).all() and list(progress.losses) == [float(x) for x in told["losses"]]
        return "" if same and sound and finite and type(told["stage"]) is int else repr(progress)

    return check
