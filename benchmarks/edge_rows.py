"""How far derivatives are from finite differences, by nine smooth functionals, row by row.

All figures are relative L2 distances of the functionals' means over independent seeds. The estimate's own noise and
that of the finite differences are standard errors of these means; seeds are added until both are small beside the
row's bound. `step` is what steps twice as long say of the truncation: a third of how far they are away.
"""

import hashlib
import json
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

import jaxrt
from benchmarks.edge_scenes import SCENES, Row, built, direction
from jaxrt.core.writing import write_whole

SPP = 64  # of the estimate
FD_BATCH, FD_FIRST = 4, 100_000  # keys of the finite differences: so many at a time, and the first
INTERIOR_SPP, INTERIOR_SEEDS = 1024, 4
WIDTH = 1 / 8  # of a functional's Gaussian, in pictures
# 1 − (r/h)² is the light of a white plane under a black ball
CLOSED_FORMS = {"plane under a black ball, height": 2 * 0.5**2 / 1.2**3}

Values = np.ndarray  # (seeds, functionals)


class Reference(NamedTuple):
    """What a derivative is compared with."""

    near: Values  # finite differences
    wide: Values  # of steps twice as long, by the first keys
    interior: Values  # derivatives without edges


class Result(NamedTuple):
    """What is known of one row."""

    row: Row
    error: float
    noise: float
    fd_noise: float
    step: float
    interior: float
    seeds: int
    keys: int

    @property
    def word(self) -> str:
        """Return whether the row holds, or what is too noisy to tell."""
        if max(self.fd_noise, self.step) > self.row.bound / 5:
            return "reference too noisy"
        if self.noise > self.row.bound / 3:
            return "too noisy"
        return "holds" if self.error <= self.row.bound else "FAILS"


def bumps(picture: Any) -> np.ndarray:
    """Return nine means (27,) of a picture, weighted by Gaussians."""
    picture = np.asarray(picture, float)
    h, w = picture.shape[:2]
    y, x = np.mgrid[:h, :w] + 0.5
    middles = (np.arange(3) + 0.5) / 3
    weights = np.stack(
        [np.exp(-((y / h - a) ** 2 + (x / w - b) ** 2) / (2 * WIDTH**2)) for a in middles for b in middles]
    )
    return np.einsum("khw,hwc->kc", weights / (h * w), picture).ravel()


def view(row: Row, scene: jaxrt.Scene, key: Any, spp: int, boundary_samples: int = 0) -> Array:
    """Return the picture that the row is about."""
    picture, *less = (
        jaxrt.render(scene, key, spp=spp, max_depth=depth, boundary_samples=boundary_samples)
        for depth in (row.depth, row.less)
        if depth
    )
    return picture - less[0] if less else picture


@cache
def _drawn(row: Row) -> Callable[..., Array]:
    """Return the program (values of all parameters, key) -> picture that finite differences are of."""
    scene = built(row)
    return jax.jit(lambda values, key: view(row, jaxrt.with_parameters(scene, values), key, row.fd_spp))


def difference(row: Row, step: float, key: int) -> np.ndarray:
    """Return the functionals' central difference, both pictures drawn with the same random numbers."""
    scene = built(row)
    program = _drawn(row._replace(name="", parameter="", motion="", bound=0, step=0, samples=0, seeds=0))
    value, along = jaxrt.parameters(scene, row.parameter), direction(row, scene)
    ends = [
        bumps(program(jaxrt.parameters(jaxrt.with_parameters(scene, {row.parameter: value + h * along})), key))
        for h in (step, -step)
    ]
    return (ends[0] - ends[1]) / (2 * step)


def derivatives(row: Row, samples: int, spp: int = SPP) -> Iterator[np.ndarray]:
    """Yield the functionals' derivative of seed after seed, with so many boundary samples a pixel."""
    scene = built(row)
    value, along = jaxrt.parameters(scene, row.parameter), direction(row, scene)

    @jax.jit
    def slope(key: Array) -> Array:
        def picture(value: Array) -> Array:
            moved = jaxrt.with_parameters(scene, {row.parameter: value})
            return view(row, moved, key, spp, samples * row.size**2)

        return jax.jvp(picture, (value,), (along,))[1]

    for seed in range(2**31):
        yield bumps(slope(jnp.uint32(seed)))


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
        found = self._read(name) or Reference(np.zeros((0, 27)), np.zeros((0, 27)), self._interior(row))
        while len(found.near) < self.keys and _wants_more(row, found):
            first = FD_FIRST + len(found.near)
            near = [difference(row, row.step, first + i) for i in range(FD_BATCH)]
            wide = [difference(row, 2 * row.step, first + i) for i in range(0, FD_BATCH, 4)]
            found = Reference(np.stack([*found.near, *near]), np.stack([*found.wide, *wide]), found.interior)
            self._write(name, found)
        return found

    def _interior(self, row: Row) -> Values:
        seeds = derivatives(row, 0, INTERIOR_SPP)
        return np.stack([next(seeds) for _ in range(INTERIOR_SEEDS)])

    def _closed(self, row: Row) -> Reference:
        slope = bumps(np.full((row.size, row.size, 3), CLOSED_FORMS[row.name]))
        exact = np.stack([slope, slope])
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


def _wants_more(row: Row, found: Reference) -> bool:
    if len(found.near) < FD_BATCH:
        return True
    return noise_of(found.near) > row.bound / 6 * np.linalg.norm(found.near.mean(0))


def result(row: Row, reference: Reference, estimates: Values) -> Result:
    """Return the figures of a row."""
    truth = reference.near.mean(0)
    near, wide, interior = reference
    if row.less:
        # How large each is along the reference
        near, wide, interior, estimates = (
            (each @ truth / (truth @ truth))[:, None] for each in (near, wide, interior, estimates)
        )
        truth = np.ones(1)
    size = float(np.linalg.norm(truth))
    keys = len(near) // len(wide)

    def off(values: Values, other: np.ndarray) -> float:
        return float(np.linalg.norm(values.mean(0) - other)) / size

    return Result(
        row,
        error=off(estimates, truth),
        noise=noise_of(estimates) / size,
        fd_noise=noise_of(near) / size,
        step=off(wide, near[::keys].mean(0)) / 3,
        interior=off(interior, truth),
        seeds=len(estimates),
        keys=len(near),
    )


def measure(row: Row, references: References, most: int) -> Result:
    """Return the figures of a row, averaged over as many seeds as its bound wants and at most so many."""
    reference = references.of(row)
    seeds = derivatives(row, row.samples)
    estimates = np.stack([next(seeds) for _ in range(row.seeds)])
    while len(estimates) < most and result(row, reference, estimates).noise > row.bound / 3:
        estimates = np.stack([*estimates, *(next(seeds) for _ in range(len(estimates)))])
    return result(row, reference, estimates)
