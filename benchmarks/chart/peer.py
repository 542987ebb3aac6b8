"""Mitsuba as a method of the charts: one child process that draws whatever it is asked for."""

import json
import subprocess
import tempfile
from collections.abc import Sequence
from types import TracebackType
from typing import Any

import numpy as np

from benchmarks.chart.subjects import Draw, Drawn, Subject
from benchmarks.processes import HERE, PROJECT

SAMPLERS = ("independent", "stratified", "multijitter", "orthogonal", "ldsampler")
ANSWER = "ANSWER "


class Peer:
    """A running Mitsuba, on one core; a context manager."""

    def __init__(self, python: str) -> None:
        command = [python, str(HERE / "mitsuba_server.py")]
        self._folder = tempfile.TemporaryDirectory()
        self._child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=PROJECT)
        self.version: str = self._answer()["version"]

    def __enter__(self) -> "Peer":
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        assert self._child.stdin
        self._child.stdin.close()
        self._child.wait()
        self._folder.cleanup()

    def method(self, subject: Subject, sampler: str = "independent", **derivative: Any) -> Draw:
        """Return how Mitsuba draws a scene, or with `integrator` and `axis` its derivative. Raises RuntimeError."""

        def draw(seed: int, lengths: Sequence[int]) -> Drawn:
            return {spp: self._draw(subject, sampler, spp, seed, derivative) for spp in lengths}

        return draw

    def _draw(
        self, subject: Subject, sampler: str, spp: int, seed: int, derivative: dict[str, Any]
    ) -> tuple[np.ndarray, float]:
        out = f"{self._folder.name}/image.npy"
        size = {"width": subject.size, "height": subject.size}
        task = {"scene": subject.path, **size, "sampler": sampler, "spp": spp, "seed": seed, "out": out, **derivative}
        assert self._child.stdin
        self._child.stdin.write(json.dumps(task) + "\n")
        self._child.stdin.flush()
        answer = self._answer()
        if "error" in answer:
            raise RuntimeError(f"Mitsuba: {answer['error']}")
        return np.load(out).astype(np.float64), answer["seconds"]

    def _answer(self) -> dict[str, Any]:
        assert self._child.stdout
        for line in self._child.stdout:
            if line.startswith(ANSWER):
                return json.loads(line.removeprefix(ANSWER))
        raise RuntimeError(f"Mitsuba: ended with exit status {self._child.wait()}; its messages are above")


def best_sampler(
    peer: Peer, subject: Subject, reference: np.ndarray, spp: int, seeds: int
) -> tuple[str, dict[str, float]]:
    """Return the sampler of least RMSE × √(CPU time), `independent` apart, and that figure of all over its."""
    costs = {}
    methods = {name: peer.method(subject, name) for name in SAMPLERS}
    for draw in methods.values():
        draw(0, [spp])
    drawn: dict[str, list[tuple[np.ndarray, float]]] = {name: [] for name in SAMPLERS}
    for seed in range(1, seeds + 1):
        for name, draw in methods.items():
            drawn[name].append(draw(seed, [spp])[spp])
    for name, images in drawn.items():
        mean_square = np.mean([((image - reference) ** 2).mean() for image, _ in images])
        costs[name] = float(np.sqrt(mean_square * np.median([seconds for _, seconds in images])))
    relative = {name: cost / costs["independent"] for name, cost in costs.items()}
    return min(SAMPLERS[1:], key=relative.__getitem__), relative
