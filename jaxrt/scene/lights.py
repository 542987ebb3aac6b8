"""The rows in which `parameters` lists the fields of lights: in the scene file's order, of all kinds that have them."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxrt.description.kinds import LIGHTS
from jaxrt.lights import Lights
from jaxrt.scene.record import Scene


def order_of_lights(tables: Sequence[Any], lights: Lights | None) -> dict[str, Array]:
    """Return by parameter the row (m,) int32 among all kinds' of each in the scene file's order, where kinds share."""
    order = {}
    for name, field in _fields():
        owners = [kind.kind.name for kind, _, _ in _owners(lights, field)]
        if len(owners) > 1:
            listed = [i for owner in owners for i, table in enumerate(tables) if table.type == owner]
            order[name] = jnp.asarray([listed.index(i) for i in sorted(listed)], jnp.int32)
    return order


def light_parameters(scene: Scene) -> Iterator[tuple[str, Array]]:
    """Yield name and value of each parameter of lights."""
    for name, field in _fields():
        parts = [getattr(kind, field) for kind, _, _ in _owners(scene.lights, field)]
        if len(parts) == 1:
            yield name, parts[0]
        elif parts:
            yield name, jnp.concatenate(parts)[(scene.order or {})[name]]


def with_light_parameters(scene: Scene, new: Mapping[str, Array]) -> Lights | None:
    """Return the lights with new values of some fields."""
    lights = scene.lights
    for field, value in new.items():
        assert lights is not None
        owners = list(_owners(lights, field))
        if len(owners) > 1:
            value = value[jnp.argsort((scene.order or {})[f"lights.{field}"])]
        ends = np.cumsum([n for _, _, n in owners])
        for (kind, _, n), end in zip(owners, ends, strict=True):
            lights = lights.replaced(kind, replace(kind, **{field: value[end - n : end]}))
    return lights


def light_numbers(scene: Scene, name: str) -> np.ndarray:
    """Return which light each row of a parameter belongs to, as lights are numbered."""
    owned = [first + np.arange(n) for _, first, n in _owners(scene.lights, name.split(".")[1])]
    numbers = np.concatenate(owned)
    return numbers if len(owned) == 1 else numbers[np.asarray((scene.order or {})[name])]


def _fields() -> list[tuple[str, str]]:
    return [(name, name.split(".")[1]) for name in LIGHTS.parameters]


def _owners(lights: Lights | None, field: str) -> Iterator[tuple[Any, int, int]]:
    """Yield the kinds that have a parameter, the number of their first light, and how many they have."""
    for kind, first, n in () if lights is None else lights.numbered():
        if field in kind.kind.parameters and getattr(kind, field) is not None:
            yield kind, first, n
