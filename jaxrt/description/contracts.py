"""Whether the methods of a kind of one's own answer as they should: traced without numbers, where the class is made."""

from itertools import product
from typing import Any

import jax
import jax.numpy as jnp

from jaxrt.core.messages import one_line
from jaxrt.core.records import Ray, SurfacePoint

NUMBER: Any = jax.ShapeDtypeStruct((), jnp.float32)
VECTOR: Any = jax.ShapeDtypeStruct((3,), jnp.float32)
ROW: Any = jax.ShapeDtypeStruct((), jnp.int32)
AHEAD: Any = jax.ShapeDtypeStruct((), bool)
PAIR = (NUMBER, NUMBER)
SURFACE = SurfacePoint(VECTOR, VECTOR, NUMBER, ROW)

# By sort and method: arguments, what it must return, and this in words
CONTRACTS: dict[str, dict[str, tuple[tuple[Any, ...], Any, str]]] = {
    "material": {
        "sample": ((SURFACE, VECTOR, PAIR), (VECTOR, VECTOR), "(wi (3,), weight (3,))"),
        "evaluate": ((SURFACE, VECTOR, VECTOR), (VECTOR, NUMBER), "(f cosθ (3,), pdf ())"),
        "numbers_toward": ((SURFACE, VECTOR, VECTOR, NUMBER), PAIR, "(u0 (), u1 ())"),
    },
    "delta light": {
        "sample": ((VECTOR, PAIR), (VECTOR, NUMBER, VECTOR), "(direction (3,), distance (), irradiance (3,))")
    },
    "light": {
        "sample": ((VECTOR, PAIR), VECTOR, "direction (3,)"),
        "pdf": ((VECTOR,), NUMBER, "density ()"),
        "emitted": ((VECTOR,), VECTOR, "radiance (3,)"),
    },
    "camera": {
        "ray": ((PAIR, PAIR), Ray(VECTOR, VECTOR), "Ray(origin (3,), direction (3,))"),
        "project": ((VECTOR,), (PAIR, AHEAD), "((column (), row ()), in view: bool ())"),
    },
}


def check_methods(word: str, kind: Any, methods: tuple[str, ...]) -> None:
    """Raise TypeError, naming class and method, where one cannot be traced or returns something else than it should."""
    contract = CONTRACTS["delta light" if word == "light" and kind.cls.is_delta else word]
    settings = {name: kind.table.model_fields[name].get_default() for name in kind.settings}
    arrays = {field: jax.ShapeDtypeStruct(measure.shape, jnp.float32) for field, measure in kind.measures.items()}
    least = {field: array for field, array in arrays.items() if field not in kind.optional}
    for one, method in product((kind.cls(**arrays, **settings), kind.cls(**least, **settings)), methods):
        arguments, wanted, words = contract[method]
        try:
            found = jax.eval_shape(lambda one, *rest, method=method: getattr(one, method)(*rest), one, *arguments)
        except Exception as error:
            raise TypeError(
                f"{word} {kind.cls.__qualname__}: {method} fails: {one_line(f'{type(error).__name__}: {error}')}"
            ) from error
        if not _fits(found, wanted):
            raise TypeError(f"{word} {kind.cls.__qualname__}: {method} returns {_told(found)}, want {words}")


def _fits(found: Any, wanted: Any) -> bool:
    if not isinstance(wanted, jax.ShapeDtypeStruct):
        structure: Any = jax.tree.structure(found)
        return structure == jax.tree.structure(wanted) and all(
            map(_fits, jax.tree.leaves(found), jax.tree.leaves(wanted))
        )
    sort = jnp.bool_ if wanted.dtype == bool else jnp.floating
    return hasattr(found, "shape") and found.shape == wanted.shape and bool(jnp.issubdtype(found.dtype, sort))


def _told(found: Any) -> str:
    """Return the shapes of what came, and the dtype of what is no float."""
    if isinstance(found, tuple | list):
        return f"({', '.join(map(_told, found))})"
    if not hasattr(found, "shape"):
        return "None" if found is None else type(found).__name__
    return str(found.shape) if jnp.issubdtype(found.dtype, jnp.floating) else f"{found.dtype} {found.shape}"
