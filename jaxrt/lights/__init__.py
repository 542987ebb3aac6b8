"""All lights of a scene, behind `sample_light` and what rays see of them; one file a kind.

Lights are numbered by kind: the spherical ones (a point has radius 0), then those of other kinds.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, TypeGuard

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.typing import DTypeLike

from jaxrt.core.maths import dot, safe_divide, unit_roundoff
from jaxrt.core.pytree import dtype_of, pytree, static
from jaxrt.core.records import LightSample
from jaxrt.description.kinds import LIGHTS
from jaxrt.kernels.gather import take
from jaxrt.lights.interface import Pair, picked
from jaxrt.lights.near import MANY, Groups, groups_of, neighbours, pick_near, share_near
from jaxrt.lights.pick import pick, share_by_power, shares_of

__all__ = [
    "LightTable",
    "Lights",
    "casters_of",
    "emitted_radiance",
    "intensity_toward",
    "light_table",
    "lights_of",
    "pick",
    "row_of",
    "sample_light",
    "sample_light_attached",
    "share_at",
    "share_of",
    "shines_from_afar",
    "sky_radiance",
]

LIGHTS.load("sphere")
_SPHERE = LIGHTS.kinds["sphere"]


@pytree
class Lights:
    """All lights of a scene. `radius` is None when every spherical light is a point, all three when there is none."""

    position: Any  # (n, 3) scene units
    intensity: Any  # (n, 3) W·sr⁻¹
    radius: Array | None  # (n,) scene units, >= 0
    others: tuple[Any, ...] = ()  # of each other kind that is there, a row a light
    rows: tuple[int, ...] = static(default=())  # how many these are
    order: Any = None  # (n,) int32 the spherical ones by their groups, where they are many

    @property
    def kinds(self) -> tuple[tuple[Any, int], ...]:
        """Each kind that is there, and its number of lights."""
        others = tuple(zip(self.others, self.rows, strict=True))
        if self.position is None:
            return others
        return (self.spheres, self.position.shape[0]), *others

    @property
    def spheres(self) -> Any:
        """The spherical lights."""
        return _SPHERE.cls(self.position, self.intensity, self.radius)

    def numbered(self) -> Iterator[tuple[Any, int, int]]:
        """Yield each kind that is there, the number of its first light, and how many it has."""
        first = 0
        for kind, n in self.kinds:
            yield kind, first, n
            first += n

    def skies(self) -> Iterator[tuple[Any, int, int]]:
        """Yield the kinds that a ray sees which meets nothing, as `numbered` does."""
        yield from ((kind, *rows) for kind, *rows in self.numbered() if not (_is_sphere(kind) or kind.is_delta))

    def replaced(self, old: Any, new: Any) -> "Lights":
        """Return the lights with the rows of one kind exchanged."""
        if _is_sphere(new):
            return replace(self, position=new.position, intensity=new.intensity, radius=new.radius)
        return replace(self, others=tuple(new if kind is old else kind for kind in self.others))

    @property
    def have_size(self) -> bool:
        """Whether some have a place and a size, so that rays hit them and they block light."""
        return self.radius is not None

    @property
    def count(self) -> int:
        """Number of lights."""
        return sum(n for _, n in self.kinds)


def lights_of(tables: Sequence[Any], dtype: DTypeLike, origin: np.ndarray) -> Lights | None:
    """Return the lights that tables of the scene file describe; places are counted from the origin."""
    found: dict[str, list[Any]] = {name: [] for name in LIGHTS.kinds}
    for table in tables:
        found[table.type].append(table)
    kinds = {name: LIGHTS.kinds[name].stack(those, dtype, origin) for name, those in found.items() if those}
    own = kinds.pop(_SPHERE.name, None)
    points = own is None or not any(table.radius for table in found[_SPHERE.name])
    ours = (None, None, None) if own is None else (own.position, own.intensity, None if points else own.radius)
    # Those that cast shadows of known edges come first
    names = sorted(kinds, key=lambda name: not hasattr(kinds[name], "position"))
    others, rows = tuple(kinds[name] for name in names), tuple(len(found[name]) for name in names)
    many = own is not None and len(own.position) > MANY
    order = jnp.asarray(neighbours(np.asarray(own.position))) if many else None
    return Lights(ours[0], ours[1], ours[2], others, rows, order) if tables else None


def _is_sphere(kind: Any) -> bool:
    return isinstance(kind, _SPHERE.cls)


@pytree
class LightTable:
    """Lights as the path reads them."""

    lights: Lights
    pick: Array | None  # (n,) cumulative probability of each light, by power; None when there is one light
    groups: Groups | None = None  # of the spherical lights, where they are many


def light_table(lights: Lights) -> LightTable:
    """Return the lights with the probabilities to pick them: by power, equal where all are dark. No derivative.

    Among many spherical lights, it is distance that chooses too.
    """
    by_power = None if lights.count == 1 else shares_of(powers_of(lights))
    if lights.order is None:
        return LightTable(lights, by_power)
    share = share_by_power(lights.spheres.power())
    return LightTable(lights, by_power, groups_of(lights.position, share, lights.order))


def powers_of(lights: Lights) -> Array:
    """Return the power (n,) of each light; of one that does not tell, the mean of the others."""
    known = [_powers(kind, n) for kind, n in lights.kinds]
    told = [power for power in known if power is not None]
    if len(told) == len(known) == 1:
        return told[0]
    mean = jnp.mean(jnp.concatenate(told)) if told else jnp.ones((), dtype_of(lights))
    powers = zip(known, lights.kinds, strict=True)
    return jnp.concatenate([jnp.full(n, mean) if power is None else power for power, (_, n) in powers])


def _powers(kind: Any, n: int) -> Array | None:
    if _is_sphere(kind):
        return jnp.sum(kind.intensity, -1)  # of all rows at once
    return lax.map(lambda i: row_of(kind, i).power(), jnp.arange(n)) if hasattr(kind, "power") else None


def sample_light(table: LightTable, point: Array, u: Pair) -> LightSample:
    """Return a light sample for a point: one light, one direction. The irradiance is divided by its probability."""
    return _sample(table, point, u, False)


def sample_light_attached(table: LightTable, point: Array, u: Pair) -> LightSample:
    """Return a light sample for a point whose derivatives hold its place on the light fixed."""
    return _sample(table, point, u, True)


def _sample(table: LightTable, point: Array, u: Pair, attached: bool) -> LightSample:
    light, share, u0 = _chosen(table, point, u[0])
    found: Any = None
    for kind, first, n in table.lights.numbered():
        one = row_of(kind, light if len(table.lights.kinds) == 1 else jnp.clip(light - first, 0, n - 1))
        sample = picked(one, point, (u0, u[1]), share, attached)
        found = sample if found is None else jax.tree.map(partial(jnp.where, light >= first), sample, found)
    direction, distance, irradiance = found
    return LightSample(direction, distance, irradiance, light)


def _chosen(table: LightTable, point: Array, u: Array) -> tuple[Array, Array, Array]:
    """Return (light, its probability, the number u made uniform again) for a point."""
    if table.groups is None:
        return pick(table.pick, u)
    if not table.lights.others:
        return pick_near(table.groups, point, u)
    # Spherical lights, which are numbered first, have their share by power together
    bound = _share_of_spheres(table)
    light, share, rest = pick_near(table.groups, point, jnp.clip(u / bound, 0, 1 - 2 * unit_roundoff(u)))
    others = pick(table.pick, u)
    near = (light, share * bound, rest)
    return jax.tree.map(partial(jnp.where, u < bound), near, others)


def _share_of_spheres(table: LightTable) -> Array:
    assert table.pick is not None
    return table.pick[table.lights.position.shape[0] - 1]


def row_of(kind: Any, row: Array) -> Any:
    """Return one light of a kind."""
    return jax.tree.map(lambda field: take(field, row), kind)


def emitted_radiance(lights: Lights, light: Array, eye: Array) -> Array:
    """Return the radiance (3,) W·sr⁻¹·m⁻² that a point `eye` sees of sphere light number `light`: 0 from inside."""
    return row_of(lights.spheres, light).radiance(eye)


def casters_of(lights: Lights) -> tuple[Array, Array | None, Array]:
    """Return places (m, 3), radii (m,), if any is not 0, and powers (m,) of the first lights: those that have a place.

    What the shadows of other lights do has no known edges.
    """
    placed = [(kind, n) for kind, n in lights.kinds if hasattr(kind, "position")]
    if not placed:
        return jnp.zeros((0, 3)), None, jnp.zeros(0)
    others = sum(n for kind, n in placed if not _is_sphere(kind))
    places = _joined([kind.position for kind, _ in placed])
    radii = None if lights.radius is None else _joined([lights.radius, *([jnp.zeros(others)] if others else [])])
    return places, radii, powers_of(lights)[: places.shape[0]]


def _joined(parts: Sequence[Array]) -> Array:
    return parts[0] if len(parts) == 1 else jnp.concatenate([part.astype(parts[0].dtype) for part in parts])


def intensity_toward(lights: Lights, light: Array, point: Array) -> Array:
    """Return the intensity (3,) W·sr⁻¹ of a light that has a place and is no sphere, in the direction of a point."""
    intensity, half = jnp.zeros_like(point), jnp.full((), 0.5, point.dtype)
    for kind, first, n in lights.numbered():
        if hasattr(kind, "position") and not _is_sphere(kind):
            one = row_of(kind, jnp.clip(light - first, 0, n - 1))
            away = point - one.position
            irradiance = one.sample(point, (half, half))[2]
            intensity = jnp.where(light >= first, irradiance * dot(away, away), intensity)
    return intensity


def shines_from_afar(table: LightTable | None) -> TypeGuard[LightTable]:
    """Return whether a ray that meets nothing can see a light."""
    return table is not None and any(table.lights.skies())


def sky_radiance(table: LightTable, direction: Array, pdf: Array | None = None) -> Array:
    """Return the radiance (3,) W·sr⁻¹·m⁻² of all lights that a ray sees which meets nothing.

    pdf: () density of the ray's direction, where light samples look for the same light: both ways are weighed by their
    densities (Veach 1997, §9.2.2).
    """

    def emitted(kind: Any, first: int, row: Array) -> Array:
        one = row_of(kind, row)
        other = 0 if pdf is None else lax.stop_gradient(one.pdf(direction)) * share_of(table, first + row)
        return one.emitted(direction) * (1 if pdf is None else safe_divide(pdf, pdf + other))

    total = jnp.zeros_like(direction)
    for kind, first, n in table.lights.skies():
        total += jnp.sum(lax.map(partial(emitted, kind, first), jnp.arange(n)), 0)
    return total


def share_at(table: LightTable, light: Array, point: Array) -> Array:
    """Return the probability () with which light samples for a point look at a light."""
    if table.groups is None:
        return share_of(table, light)
    n = table.lights.position.shape[0]
    near = share_near(table.groups, point, jnp.minimum(light, n - 1))
    if not table.lights.others:
        return near
    return jnp.where(light < n, near * _share_of_spheres(table), share_of(table, light))


def share_of(table: LightTable, light: Array) -> Array:
    """Return the probability () with which light samples look at a light: of one at infinity, for every point."""
    if table.pick is None:
        return jnp.ones((), dtype_of(table))
    return take(table.pick, light) - jnp.where(light > 0, take(table.pick, jnp.maximum(light - 1, 0)), 0)
