"""The one record mechanism: frozen dataclasses that JAX sees as pytrees."""

import dataclasses
from functools import cache
from typing import Any, TypeVar, cast, dataclass_transform

import jax
import jax.numpy as jnp

T = TypeVar("T")


def dtype_of(tree: Any) -> Any:
    """Return the dtype of the tree's numbers, which is the same for all: float32 where there are none."""
    dtypes = map(jnp.result_type, jax.tree.leaves(tree))
    return next((dtype for dtype in dtypes if jnp.issubdtype(dtype, jnp.floating)), jnp.dtype(jnp.float32))


def where(use: Any, new: Any, old: Any) -> Any:
    """Return the tree `new` where `use`, () bool, holds, else `old`, of the same structure."""
    return jax.tree.map(lambda a, b: jnp.where(use, a, b), new, old)


def static(**options: Any) -> Any:
    """Return a dataclass field that belongs to the pytree's structure: hashable, part of the jit key, no leaf."""
    return dataclasses.field(metadata={"static": True}, **options)


@dataclass_transform(frozen_default=True, field_specifiers=(static, dataclasses.field))
def pytree(cls: type[T]) -> type[T]:
    """Return `cls` as a frozen dataclass whose fields are pytree children, except those made by `static`.

    No validation happens here: JAX rebuilds records from tracers and placeholders. Descriptions validate.
    """
    record = dataclasses.dataclass(frozen=True)(cls)
    fields = dataclasses.fields(cast(Any, record))
    meta = tuple(f.name for f in fields if f.metadata.get("static"))
    data = tuple(f.name for f in fields if not f.metadata.get("static"))
    keys = tuple(map(jax.tree_util.GetAttrKey, data))

    # `jax.tree_util.register_dataclass` would do, but that JAX then takes the structures of all classes for equal, and
    # finds one's programs for another: here the class is part of the structure
    def children(x: Any) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        return tuple(getattr(x, name) for name in data), (record, *(getattr(x, name) for name in meta))

    def with_keys(x: Any) -> tuple[tuple[tuple[Any, Any], ...], tuple[Any, ...]]:
        own, structure = children(x)
        return tuple(zip(keys, own, strict=True)), structure

    def rebuilt(structure: tuple[Any, ...], own: Any) -> Any:
        return record(**dict(zip(meta, structure[1:], strict=True)), **dict(zip(data, own, strict=True)))

    jax.tree_util.register_pytree_with_keys(record, with_keys, rebuilt, children)
    return record


@cache
def with_fields(base: type[T], names: tuple[str, ...]) -> type[T]:
    """Return a pytree class derived from `base`, with these fields: one class for the same arguments."""
    made = type(base.__name__, (base,), {"__annotations__": dict.fromkeys(names, Any), "__module__": base.__module__})
    return pytree(made)
