"""All lights of a scene, behind `sample_light` and what rays see of them; one file a kind.

Lights are numbered by kind: the spherical ones (a point has radius 0), then those of other kinds.
"""

from collections.abc import Iterator
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxrt.core.pytree import pytree, static
from jaxrt.core.records import LightSample
from jaxrt.kernels.gather import take
from jaxrt.lights.interface import Pair, picked
from jaxrt.lights.pick import pick, shares_of
from jaxrt.lights.sphere import Sphere

__all__ = [
    "LightTable",
    "Lights",
    "Sphere",
    "emitted_radiance",
    "light_table",
    "pick",
    "places_of",
    "sample_light",
    "sample_light_attached",
    "shines_from_afar",
    "sky_radiance",
]


@pytree
class Lights:
    """All lights of a scene. `radius` is None when every spherical light is a point, all three when there is none."""

    position: Array | None  # (n, 3) scene units
    intensity: Array | None  # (n, 3) W·sr⁻¹
    radius: Array | None  # (n,) scene units, >= 0
    others: tuple[Any, ...] = ()  # of each other kind that is there, a row a light
    rows: tuple[int, ...] = static(default=())  # how many these are

    @property
    def kinds(self) -> tuple[tuple[Any, int], ...]:
        """Each kind that is there, and its number of lights."""
        others = tuple(zip(self.others, self.rows, strict=True))
        if self.position is None or self.intensity is None:
            return others
        return (Sphere(self.position, self.intensity, self.radius), self.position.shape[0]), *others

    @property
    def count(self) -> int:
        """Number of lights."""
        return sum(n for _, n in self.kinds)


@pytree
class LightTable:
    """Lights as the path reads them."""

    lights: Lights
    pick: Array | None  # (n,) cumulative probability of each light, by power; None when there is one light


def light_table(lights: Lights) -> LightTable:
    """Return the lights with the probabilities to pick them: by power, equal where all are dark. No derivative."""
    return LightTable(lights, None if lights.count == 1 else shares_of(powers_of(lights)))


def powers_of(lights: Lights) -> Array:
    """Return the power (n,) of each light; of one that does not tell, the mean of the others."""
    known = [_powers(kind, n) for kind, n in lights.kinds]
    told = [power for power in known if power is not None]
    if len(told) == len(known) == 1:
        return told[0]
    mean = jnp.mean(jnp.concatenate(told)) if told else jnp.ones(())
    powers = zip(known, lights.kinds, strict=True)
    return jnp.concatenate([jnp.full(n, mean) if power is None else power for power, (_, n) in powers])


def _powers(kind: Any, n: int) -> Array | None:
    if isinstance(kind, Sphere):
        return kind.power()
    return lax.map(lambda i: _row(kind, i).power(), jnp.arange(n)) if hasattr(kind, "power") else None


def sample_light(table: LightTable, point: Array, u: Pair) -> LightSample:
    """Return a light sample for a point: one light, one direction. The irradiance is divided by its probability."""
    return _sample(table, point, u, False)


def sample_light_attached(table: LightTable, point: Array, u: Pair) -> LightSample:
    """Return a light sample for a point whose derivatives hold its place on the light fixed."""
    return _sample(table, point, u, True)


def _sample(table: LightTable, point: Array, u: Pair, attached: bool) -> LightSample:
    light, share, u0 = pick(table.pick, u[0])
    found: Any = None
    for kind, first, n in _numbered(table.lights):
        one = _row(kind, light if len(table.lights.kinds) == 1 else jnp.clip(light - first, 0, n - 1))
        sample = picked(one, point, (u0, u[1]), share, attached)
        found = sample if found is None else jax.tree.map(partial(jnp.where, light >= first), sample, found)
    return LightSample(*found, light)


def _numbered(lights: Lights) -> Iterator[tuple[Any, int, int]]:
    """Yield each kind, the number of its first light, and how many it has."""
    first = 0
    for kind, n in lights.kinds:
        yield kind, first, n
        first += n


def _row(kind: Any, row: Array) -> Any:
    return jax.tree.map(lambda field: take(field, row), kind)


def emitted_radiance(lights: Lights, light: Array, eye: Array) -> Array:
    """Return the radiance (3,) W·sr⁻¹·m⁻² that a point `eye` sees of sphere light number `light`: 0 from inside."""
    assert lights.position is not None and lights.intensity is not None
    return _row(Sphere(lights.position, lights.intensity, lights.radius), light).radiance(eye)


def shines_from_afar(lights: Lights | None) -> bool:
    """Return whether a ray that meets nothing can see a light."""
    return lights is not None and any(not kind.is_delta for kind in lights.others)


def sky_radiance(lights: Lights, direction: Array) -> Array:
    """Return the radiance (3,) W·sr⁻¹·m⁻² of all lights that a ray sees which meets nothing."""
    total = jnp.zeros_like(direction)
    for kind, n in zip(lights.others, lights.rows, strict=True):
        if not kind.is_delta:
            total += jnp.sum(lax.map(partial(_emitted, kind, direction), jnp.arange(n)), 0)
    return total


def _emitted(kind: Any, direction: Array, row: Array) -> Array:
    return _row(kind, row).emitted(direction)
