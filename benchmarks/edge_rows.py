"""How far derivatives are from finite differences, by nine smooth functionals, row by row.

All figures are relative L2 distances of the functionals' means over independent seeds. The estimate's own noise and
that of the finite differences are standard errors of these means; seeds are added until both are small beside the
row's bound: those of edges, and those inside of them, each as their own noise wants. `step` is what steps twice as long
say of the truncation: a third of how far they are away.
"""

import hashlib
import json
import time
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

import jaxrt
from benchmarks.edge_scenes import SCENES, Row, built, direction, rows
from jaxrt.core.writing import write_whole
from jaxrt.scene.measures import moves_lamps

SPP = 64  # of the estimate
FD_BATCH, FD_FIRST = 4, 100_000  # keys of the finite differences: so many at a time, and the first
INTERIOR_SPP, INTERIOR_SEEDS = 1024, 4
INSIDE, INSIDE_FIRST = 32, 1_000_000  # seeds inside of edges: so many for one of edges at most, and the first
WIDTH = 1 / 8  # of a functional's Gaussian, in pictures
# 1 − (r/h)² is the light of a white plane under a black ball
CLOSED_FORMS = {"plane under a black ball, height": 2 * 0.5**2 / 1.2**3}

Pictures = np.ndarray  # (seeds, height, width, 3) derivatives
Values = np.ndarray  # (seeds, functionals)


class Reference(NamedTuple):
    """What a derivative is compared with."""

    near: Pictures  # finite differences
    wide: Pictures  # of steps twice as long, by the first of every FD_BATCH keys
    interior: Pictures  # without edges


class Result(NamedTuple):
    """What is known of one row."""

    row: Row
    error: float
    noise: float
    noises: tuple[float, float]  # that of edges, and that inside of them
    fd_noise: float
    step: float
    interior: float
    seeds: tuple[int, int]  # of edges, and inside of them
    keys: int
    second: float  # the estimate's noise after one CPU second
    pictures: tuple[np.ndarray, np.ndarray, np.ndarray]  # finite differences, without edges, with edges

    @property
    def word(self) -> str:
        """Return whether the row holds, or what is too noisy to tell."""
        if max(self.fd_noise, self.step) > self.row.bound / 5:
            return "reference too noisy"
        if self.noise > self.row.bound / 3:
            return "too noisy"
        return "holds" if self.error <= self.row.bound else "FAILS"


def bumps(picture: Any) -> np.ndarray:
    """Return nine means (..., 27) of pictures (..., height, width, 3), weighted by Gaussians."""
    picture = np.asarray(picture, float)
    h, w = picture.shape[-3:-1]
    y, x = np.mgrid[:h, :w] + 0.5
    middles = (np.arange(3) + 0.5) / 3
    weights = np.stack(
        [np.exp(-((y / h - a) ** 2 + (x / w - b) ** 2) / (2 * WIDTH**2)) for a in middles for b in middles]
    )
    return np.einsum("khw,...hwc->...kc", weights / (h * w), picture).reshape(*picture.shape[:-3], 27)


def view(row: Row, scene: jaxrt.Scene, key: Any, spp: int, boundary_samples: int = 0) -> Array:
    """Return the picture that the row is about."""
    picture, *less = (
        jaxrt.render(scene, key, spp=spp, max_depth=depth, boundary_samples=boundary_samples)
        for depth in (row.depth, row.less)
        if depth
    )
    return picture - less[0] if less else picture


def _alike(row: Row) -> Row:
    """Return what rows have in common that share their programs."""
    return row._replace(name="", parameter="", motion="", bound=0, step=0, seeds=0)


@cache
def _drawn(row: Row) -> Callable[..., Array]:
    """Return the program (scene, key) -> picture that finite differences are of."""
    return jax.jit(lambda scene, key: view(row, scene, key, row.fd_spp))


def difference(row: Row, step: float, key: int) -> np.ndarray:
    """Return the central difference, both pictures drawn with the same random numbers."""
    scene = built(row)
    program = _drawn(_alike(row)._replace(samples=0))
    value, along = jaxrt.parameters(scene, row.parameter), direction(row, scene)
    ends = [program(jaxrt.with_parameters(scene, {row.parameter: value + h * along}), key) for h in (step, -step)]
    return np.asarray((ends[0] - ends[1]) / (2 * step))


@cache
def _slope(row: Row, names: tuple[str, ...], spp: int) -> Callable[..., Array]:
    """Return the program (changes of parameters, key) -> derivative, with so many boundary samples a pixel."""
    scene = built(row)
    start = {name: jaxrt.parameters(scene, name) for name in names}

    @jax.jit
    def slope(changes: dict[str, Array], key: Array) -> Array:
        def picture(values: dict[str, Array]) -> Array:
            return view(row, jaxrt.with_parameters(scene, values), key, spp, row.samples * row.size**2)

        return jax.jvp(picture, (start,), (changes,))[1]

    return slope


def _of_lights(row: Row) -> bool:
    return moves_lamps(row.parameter.split("[")[0])


def derivatives(row: Row, samples: int, spp: int = SPP, first: int = 0) -> Iterator[np.ndarray]:
    """Yield the derivative of seed after seed, by a program for all that moves in the scene, or all its lights."""
    names = {row.parameter}
    for other in rows():
        if _alike(other) == _alike(row) and _of_lights(other) == _of_lights(row):
            names.add(other.parameter)
    program = _slope(_alike(row)._replace(samples=samples), tuple(sorted(names)), spp)
    scene = built(row)
    changes = {name: jnp.zeros_like(jaxrt.parameters(scene, name)) for name in names}
    changes[row.parameter] = direction(row, scene)
    for seed in range(first, 2**31):
        yield np.asarray(program(changes, jnp.uint32(seed)))


def noise_of(values: Values) -> float:
    """Return the L2 distance that a mean of seeds has from its expectation."""
    return float(np.linalg.norm(values.std(0, ddof=1))) / len(values) ** 0.5


class References:
    """Finite differences by row, kept in a file under what they are of."""

    def __init__(self, path: Path | None, keys: int) -> None:
        self.path, self.keys = path, keys

    def of(self, row: Row) -> Reference:
        """Return the row's reference, with as many keys as its bound wants and at most `keys`."""
        if row.name in CLOSED_FORMS:
            return self._closed(row)
        name = _digest(row)
        found = self._read(name)
        if found is None:
            none = np.zeros((0, row.size, row.size, 3), np.float32)
            found = Reference(none, none, self._interior(row))
        while len(found.near) < self.keys and _wants_more(row, found):
            first = FD_FIRST + len(found.near)
            near = [difference(row, row.step, first + i) for i in range(FD_BATCH)]
            wide = difference(row, 2 * row.step, first)
            found = Reference(np.stack([*found.near, *near]), np.stack([*found.wide, wide]), found.interior)
            self._write(name, found)
        return found

    def _interior(self, row: Row) -> Pictures:
        seeds = derivatives(row, 0, INTERIOR_SPP)
        return np.stack([next(seeds) for _ in range(INTERIOR_SEEDS)])

    def _closed(self, row: Row) -> Reference:
        exact = np.full((2, row.size, row.size, 3), CLOSED_FORMS[row.name])
        return Reference(exact, exact, self._interior(row))

    def _all(self) -> dict[str, np.ndarray]:
        return dict(np.load(self.path)) if self.path and self.path.exists() else {}

    def _read(self, name: str) -> Reference | None:
        held = self._all()
        if f"{name}/near" not in held:
            return None
        return Reference(*(held[f"{name}/{field}"] for field in Reference._fields))

    def _write(self, name: str, found: Reference) -> None:
        if self.path:
            # Read anew: others may have written rows of their own
            held = self._all() | {f"{name}/{field}": value for field, value in found._asdict().items()}
            write_whole(self.path, lambda file: np.savez(file, **held))


def _digest(row: Row) -> str:
    """Return a name of all that finite differences depend on, besides jaxrt."""
    along = np.asarray(direction(row, built(row)), float).round(6).tolist()
    of = [SCENES[row.scene], row.parameter, along, row.step, row.depth, row.less, row.size, row.fd_spp, WIDTH]
    return hashlib.sha256(json.dumps(of).encode()).hexdigest()[:24]


def truncation(near: Values, wide: Values) -> tuple[float, float]:
    """Return what a step is too long by the change of one twice as long, a third of it, and this figure's noise."""
    changes = (wide - near[:: len(near) // len(wide)]) / 3
    return float(np.linalg.norm(changes.mean(0))), noise_of(changes) if len(changes) > 1 else np.inf


def _wants_more(row: Row, found: Reference) -> bool:
    if len(found.near) < FD_BATCH:
        return True
    near, wide = bumps(found.near), bumps(found.wide)
    size = float(np.linalg.norm(near.mean(0)))
    if noise_of(near) > row.bound / 6 * size:
        return True
    # A fourth of the keys say what the step is too long: more of them where that may be their noise
    step, noise = truncation(near, wide)
    return step > row.bound / 5 * size > step - 3 * noise


class Part:
    """Seeds of a part of an estimate, and what CPU time each takes."""

    def __init__(self, draw: Callable[[], np.ndarray], first: int, most: int) -> None:
        self.draw, self.most, self.seconds = draw, most, 0.0
        self.pictures = [draw()]  # it compiles the program
        self.add(first - 1)

    def add(self, seeds: int) -> None:
        """Draw so many more, as far as there may be more."""
        seeds = min(seeds, self.most - len(self.pictures))
        begun = time.process_time()
        self.pictures += [self.draw() for _ in range(seeds)]
        self.seconds += time.process_time() - begun

    @property
    def each(self) -> float:
        """Return the seconds of a seed."""
        return self.seconds / max(len(self.pictures) - 1, 1)


def result(row: Row, reference: Reference, edges: Part, inside: Part) -> Result:
    """Return the figures of a row by what edges bring and what they do not."""
    found = np.stack(edges.pictures), np.stack(inside.pictures)
    near, wide, interior, *parts = (bumps(pictures) for pictures in (*reference, *found))
    truth = near.mean(0)
    if row.less:
        # How large each is along the reference
        near, wide, interior, *parts = (
            (each @ truth / (truth @ truth))[:, None] for each in (near, wide, interior, *parts)
        )
        truth = np.ones(1)
    size = float(np.linalg.norm(truth))
    noises = noise_of(parts[0]) / size, noise_of(parts[1]) / size
    noise = float(np.hypot(*noises))

    def off(value: np.ndarray) -> float:
        return float(np.linalg.norm(value - truth)) / size

    return Result(
        row,
        error=off(parts[0].mean(0) + parts[1].mean(0)),
        noise=noise,
        noises=noises,
        fd_noise=noise_of(near) / size,
        step=truncation(near, wide)[0] / size,
        interior=off(interior.mean(0)),
        seeds=(len(parts[0]), len(parts[1])),
        keys=len(near),
        second=noise * sum(len(part.pictures) * part.each for part in (edges, inside)) ** 0.5,
        pictures=(reference.near.mean(0), reference.interior.mean(0), found[0].mean(0) + found[1].mean(0)),
    )


def measure(row: Row, references: References, most: int) -> Result:
    """Return the figures of a row, by as many seeds as its bound wants: at most so many of edges.

    What edges bring is a seed's derivative less the same seed's without them. The rest is the mean of seeds of its own,
    of which there may be many more: they take a tenth of the time, and often make nearly all of the noise.
    """
    reference = references.of(row)
    whole, without, others = derivatives(row, row.samples), derivatives(row, 0), derivatives(row, 0, first=INSIDE_FIRST)
    edges = Part(lambda: next(whole) - next(without), row.seeds, most)
    inside = Part(lambda: next(others), row.seeds, INSIDE * most)
    while True:
        found = result(row, reference, edges, inside)
        left = [
            (noise**2 / len(part.pictures) / part.each, part)
            for noise, part in zip(found.noises, (edges, inside), strict=True)
            if noise and len(part.pictures) < part.most
        ]
        if found.noise <= row.bound / 3 or not left:
            return found
        # That whose seeds lower the variance most in a second
        _, part = max(left, key=lambda each: each[0])
        part.add(len(part.pictures))
