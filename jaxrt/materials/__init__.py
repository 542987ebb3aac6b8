"""All materials of a scene behind `scatter`.

Kinds are numbered in three groups: those that reflect as albedo/π, those that reflect or refract in single directions,
and those that light is sent to and scattered by alike, here called glossy. Rows past the last are sphere lights. Of a
kind or a group that the scene lacks, no code is there.
"""

from collections.abc import Callable
from dataclasses import Field, fields, replace
from functools import partial
from itertools import accumulate
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxrt.core.maths import dot, safe_divide
from jaxrt.core.pytree import dtype_of, pytree, with_fields
from jaxrt.core.records import SurfacePoint
from jaxrt.description.kinds import MATERIALS
from jaxrt.kernels.few import where_needed
from jaxrt.kernels.gather import take
from jaxrt.materials.facets import Faceted
from jaxrt.textures import Textures, painted
from jaxrt.textures.recording import WIDTH

__all__ = [
    "Materials",
    "Scattering",
    "albedo_of",
    "evaluate",
    "numbers_toward",
    "scatter",
    "single",
    "tells_numbers_at",
]

# One file each, numbered in this order
MATERIALS.load("diffuse", "mirror", "glass", "conductor", "plastic", "rough_glass", "principled")
_TEXTURES = "textures"
Drawn = tuple[Array, ...]  # direction, weight, and where it has one its density


class Materials:
    """The materials of a scene: a pytree of the kinds that it has, by name; those that it lacks are None.

    So are `textures`, of which it may have some besides.
    """

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]  # of the class that `of` makes

    @staticmethod
    def of(textures: Textures | None = None, **kinds: Any) -> "Materials":
        """Return the record of stacked kinds by name, in the order of their rows."""
        names = sorted((name for name in MATERIALS.kinds if kinds.get(name) is not None), key=_group)
        if textures is None:
            return with_fields(Materials, tuple(names))(*(kinds[name] for name in names))
        return with_fields(Materials, (*names, _TEXTURES))(*(kinds[name] for name in names), textures)

    def __getattr__(self, name: str) -> Any:
        if name in MATERIALS.kinds or name == _TEXTURES:
            return None
        raise AttributeError(f"no material type is called {name!r}")

    @property
    def kinds(self) -> tuple[Any, ...]:
        """The kinds that are there, in the order of their rows."""
        names = (field.name for field in fields(self))
        return tuple(getattr(self, name) for name in names if name != _TEXTURES)

    @property
    def counts(self) -> tuple[int, ...]:
        """Number of materials of each kind."""
        return tuple(jax.tree.leaves(kind)[0].shape[0] for kind in self.kinds)

    @property
    def ends(self) -> tuple[int, int, int]:
        """Rows where the lambertian ones end, where those of single directions do, and where all do."""
        pairs = list(zip(self.kinds, self.counts, strict=True))
        lambertian = sum(n for kind, n in pairs if kind.is_lambertian)
        return lambertian, lambertian + sum(n for kind, n in pairs if kind.is_delta), sum(self.counts)

    @property
    def are_delta(self) -> bool:
        """Whether any reflects or refracts in single directions."""
        return any(kind.is_delta for kind in self.kinds)

    @property
    def are_lit(self) -> bool:
        """Whether any is lit by light samples."""
        return any(not kind.is_delta for kind in self.kinds)

    @property
    def are_glossy(self) -> bool:
        """Whether any is neither lambertian nor of single directions."""
        return any(not (kind.is_delta or kind.is_lambertian) for kind in self.kinds)

    @property
    def tell_numbers(self) -> bool:
        """Whether all glossy ones tell by which numbers they scatter to somewhere."""
        return all(kind.is_delta or kind.is_lambertian or _tells_numbers(kind) for kind in self.kinds)

    @property
    def see_outlines(self) -> bool:
        """Whether any scatters to where outlines are, by numbers that are known."""
        return any(kind.is_lambertian or _tells_numbers(kind) for kind in self.kinds)

    @property
    def are_translucent(self) -> bool:
        """Whether any lets light pass and scatters it."""
        return any(kind.transmits and not kind.is_delta for kind in self.kinds)

    @property
    def absorb(self) -> bool:
        """Whether light fades inside any."""
        return any(map(_absorbs, self.kinds))

    @property
    def bends(self) -> tuple[tuple[str, str], ...]:
        """Kinds of single directions, and the fields of theirs on which the directions may depend."""
        delta = [kind.kind for kind in self.kinds if kind.is_delta]
        return tuple(
            (kind.name, field) for kind in delta for field, measure in kind.parameters.items() if not measure.tints
        )


def _group(name: str) -> int:
    cls: Any = MATERIALS.kinds[name].cls
    return 0 if cls.is_lambertian else 1 if cls.is_delta else 2


@pytree
class Scattering:
    """How light leaves a point along the path: the next direction, and what direct light would be worth."""

    direction: Array  # (3,) unit
    weight: Array  # (3,) f cosθ / pdf of the direction
    albedo: Array | None  # (3,) of the diffuse reflection, 0 at other surfaces; None in scenes without any
    diffuse: Array  # () bool, lambertian
    specular: Array  # () bool, of single directions
    glossy: Array | None = None  # () bool; None in scenes without any
    pdf: Array | None = None  # () density of the direction at a glossy surface, 0 at others; no derivative

    @property
    def lit(self) -> Array:
        """Whether light samples light the surface."""
        return self.diffuse if self.glossy is None else self.diffuse | self.glossy


def scatter(
    materials: Materials, surface: SurfacePoint, wo: Array, u: tuple[Array, Array], live: Array | None = None
) -> Scattering:
    """Return the scattering at a surface; all weights are 0 at a sphere light, which absorbs.

    wo: (3,) unit direction to where the path came from. live: () bool, without which glossy kinds scatter nothing, and
    cost nothing; then without derivative backwards. Derivatives of a glossy kind's own parameters hold direction
    and density fixed, and are those of f; those of the surface move the direction with its normal.
    """
    row, normal, first = surface.material, surface.shading, 0
    direction, weight, albedo, pdf = normal, jnp.zeros_like(normal), None, None
    for kind, end in zip(materials.kinds, accumulate(materials.counts), strict=True):
        here = _within(row, first, end)
        if kind.is_delta or kind.is_lambertian:
            one = _row(materials, kind, surface, first, end)
            if kind.is_lambertian:
                own = jnp.where(here, one.albedo, 0)
                albedo = own if albedo is None else albedo + own
                one = replace(one, albedo=own)
            drawn = _faded(one, surface, wo, *one.sample(surface, wo, u))
        else:
            here = here if live is None else here & live
            drawn = _glossy(partial(_sampled, first, end), live, here, materials, kind, surface, wo, u)
            pdf = jnp.where(here, drawn[2], 0 if pdf is None else pdf)
        direction, weight = drawn if kind.is_lambertian and first == 0 else _select(here, drawn, (direction, weight))
        first = end
    lambertian, delta, last = materials.ends
    glossy = None if pdf is None else (row >= delta) & (row < last)
    return Scattering(direction, weight, albedo, row < lambertian, (row >= lambertian) & (row < delta), glossy, pdf)


def _glossy(f: Callable[..., Drawn], live: Array | None, here: Array, *operands: Any) -> Drawn:
    """Return f(*operands), where it is told which are `live` of those alone that are `here`."""
    return f(*operands) if live is None else where_needed(f, here, *operands)


def _sampled(
    first: int, end: int, materials: Materials, kind: Any, surface: SurfacePoint, wo: Array, u: tuple[Array, Array]
) -> Drawn:
    """Return direction, weight and density of the direction at a surface of a glossy kind."""
    one = _row(materials, kind, surface, first, end)
    return _faded(one, surface, wo, *_sample_glossy(one, surface, wo, u))


def _evaluated(
    first: int, end: int, materials: Materials, kind: Any, surface: SurfacePoint, wo: Array, wi: Array
) -> Drawn:
    """Return f cosθ of a direction, and its pdf, at a surface of a glossy kind."""
    one = _row(materials, kind, surface, first, end, again=True)
    return _faded(one, surface, wo, wi, *one.evaluate(surface, wo, wi))[1:]


def _faded(one: Any, surface: SurfacePoint, wo: Array, direction: Array, light: Array, *pdf: Array) -> Drawn:
    """Return what is told of a direction, with what the material's inside leaves of the light."""
    left = transmittance(one, surface, wo)
    return direction, light if left is None else light * left, *pdf


def _sample_glossy(one: Any, surface: SurfacePoint, wo: Array, u: tuple[Array, Array]) -> tuple[Array, Array, Array]:
    """Return direction, weight and density of the direction at a surface of one glossy material."""
    # The kind's own weight moves with the surface: it knows which lobe was chosen, and how its chance moves
    if isinstance(one, Faceted):
        direction, weight, pdf = one.draw(surface, wo, u)
        return direction, weight, lax.stop_gradient(pdf)
    direction, weight = lax.stop_gradient(one).sample(surface, wo, u)
    value, pdf = one.evaluate(*lax.stop_gradient((surface, wo, direction)))
    pdf = lax.stop_gradient(pdf)
    # 0, with the derivative of f cosθ / pdf in the material alone
    change = safe_divide(value - lax.stop_gradient(value), pdf * jnp.ones_like(value))
    return direction, weight + change, pdf


def evaluate(
    materials: Materials, surface: SurfacePoint, wo: Array, wi: Array, live: Array | None = None
) -> tuple[Array, Array]:
    """Return (f cosθ (3,), pdf ()) of a direction at a glossy surface; 0 at others. The pdf has no derivative.

    live: as of `scatter`.
    """
    value, pdf, first = jnp.zeros_like(wo), jnp.zeros_like(wo[0]), 0
    for kind, end in zip(materials.kinds, accumulate(materials.counts), strict=True):
        if not (kind.is_delta or kind.is_lambertian):
            here = _within(surface.material, first, end)
            here = here if live is None else here & live
            found = _glossy(partial(_evaluated, first, end), live, here, materials, kind, surface, wo, wi)
            value, pdf = jnp.where(here, found[0], value), jnp.where(here, lax.stop_gradient(found[1]), pdf)
        first = end
    return value, pdf


def numbers_toward(
    materials: Materials, surface: SurfacePoint, wo: Array, wi: Array, coin: Array, others: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Return the numbers u for which `scatter` goes on to `wi` from a glossy surface; `others` at other surfaces.

    coin: () in [0, 1), which picks one of the lobes that have the direction, by their shares. `others` too at kinds of
    users' own that have no method `numbers_toward`.
    """
    (u0, u1), first = others, 0
    for kind, end in zip(materials.kinds, accumulate(materials.counts), strict=True):
        if _tells_numbers(kind):
            own = _row(materials, kind, surface, first, end).numbers_toward(surface, wo, wi, coin)
            here = _within(surface.material, first, end)
            u0, u1 = jnp.where(here, own[0], u0), jnp.where(here, own[1], u1)
        first = end
    return u0, u1


def tells_numbers_at(materials: Materials, surface: SurfacePoint) -> Array:
    """Return whether a surface is of a glossy kind that tells by which numbers it scatters to somewhere, () bool."""
    told, first = jnp.zeros((), bool), 0
    for kind, end in zip(materials.kinds, accumulate(materials.counts), strict=True):
        if _tells_numbers(kind):
            told |= _within(surface.material, first, end)
        first = end
    return told


def _tells_numbers(kind: Any) -> bool:
    return hasattr(kind, "numbers_toward") and not (kind.is_delta or kind.is_lambertian)


def transmittance(one: Any, surface: SurfacePoint, wo: Array) -> Array | None:
    """Return the share (3,) of light that is left on the way through a material's inside to its surface; 1 outside.

    None of a material that absorbs none. After Beer and Lambert: exp(−absorption · length).
    """
    if not _absorbs(one) or surface.travelled is None:
        return None
    inside = dot(surface.shading, wo) < 0
    return jnp.exp(-one.absorption * jnp.where(inside, surface.travelled, 0))


def absorption_of(materials: Materials, surface: SurfacePoint) -> tuple[Array, Array]:
    """Return what light loses (3,) per unit of length inside of a surface, and whether it passes through that."""
    absorption, clear, first = jnp.zeros_like(surface.position), jnp.zeros((), bool), 0
    for kind, end in zip(materials.kinds, accumulate(materials.counts), strict=True):
        if kind.transmits:
            here = _within(surface.material, first, end)
            clear = here | clear
            if _absorbs(kind):
                own = take(kind.absorption, _number(surface, first, end))
                absorption = jnp.where(here, own, absorption)
        first = end
    return absorption, clear


def albedo_of(materials: Materials, surface: SurfacePoint) -> Array:
    """Return the `albedo` (3,) of a surface: 1 of a kind that has no such field, and 0 of sphere lights."""
    albedo, first = jnp.zeros(3, dtype_of(materials)), 0
    for kind, end in zip(materials.kinds, accumulate(materials.counts), strict=True):
        one = _row(materials, kind, surface, first, end)
        own = one.albedo if "albedo" in kind.kind.parameters else 1
        albedo = jnp.where(_within(surface.material, first, end), own, albedo)
        first = end
    return albedo


def _row(materials: Materials, kind: Any, surface: SurfacePoint, first: int, end: int, again: bool = False) -> Any:
    """Return the kind's one material that a surface has, or any of its own where the surface's is of another kind."""
    i = _number(surface, first, end)
    one = jax.tree.map(lambda leaf: take(leaf, i), kind)
    if materials.textures is None:
        return one
    return painted(materials.textures, kind.kind.name, one, i, surface.chart, again)


def _number(surface: SurfacePoint, first: int, end: int) -> Array:
    """Return the row of a surface's material among those of a kind, or any where it is of another kind."""
    row = surface.material
    return jnp.clip(row - first if first else row, 0, end - first - 1)


def _absorbs(kind: Any) -> bool:
    """Return whether light fades inside."""
    return getattr(kind, "absorption", None) is not None


def marks_of(materials: Materials, lookups: int) -> tuple[int, int, int]:
    """Return the shape of the marks that textures want for so many surfaces one after the other."""
    return lookups, (2 if materials.are_glossy else 1) * len(materials.textures.slots), WIDTH


def with_marks(materials: Materials, marks: Array) -> Materials:
    """Return the materials whose textures record what is read of them, each lookup by one of the marks (slots, 15)."""
    return replace(materials, textures=replace(materials.textures, marks=marks))


def single(materials: Materials, surface: SurfacePoint) -> tuple[Materials, Array]:
    """Return one material of each kind, that of a surface among them as it is there, and its row there."""
    row = surface.material
    kinds, now, first = {}, jnp.zeros_like(row), 0
    for kind, end in zip(materials.kinds, accumulate(materials.counts), strict=True):
        kinds[kind.kind.name] = jax.tree.map(lambda leaf: leaf[None], _row(materials, kind, surface, first, end))
        now, first = now + jnp.where(row >= end, 1, 0).astype(row.dtype), end
    return Materials.of(**kinds), now


def _within(row: Array, first: int, end: int) -> Array:
    return (row >= first) & (row < end) if first else row < end


def _select(use: Array, first: Any, second: Any) -> tuple[Array, Array]:
    return jnp.where(use, first[0], second[0]), jnp.where(use, first[1], second[1])
