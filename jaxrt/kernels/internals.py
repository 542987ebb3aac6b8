"""Operations of our own, which JAX treats as it treats its own: the one file that needs more than JAX's public face.

JAX's public means do not do here: what `custom_jvp` wraps is divided where a derivative is taken, `linear_call` has no
batches, and the transpose of a gather is a scatter, which has no native form on a CPU.
"""

import warnings
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

TRIED = ("0.10.1", "0.11.0", "0.11.1", "0.11.2", "0.12.0", "0.12.0.1")

Zero = ad.Zero  # a tangent or cotangent known to be 0
instantiate_zeros = ad.instantiate_zeros
is_undefined_primal = ad.is_undefined_primal
ShapedArray = jax.core.ShapedArray


def operation(
    name: str,
    evaluate: Callable[..., Any],
    result: Callable[..., Any],
    batch: Callable[..., tuple[Any, Any]],
    differentiate: Callable[..., tuple[Any, Any]] | None = None,
    transpose: Callable[..., Sequence[Any]] | None = None,
    several: bool = True,
    eager: Callable[..., Any] | None = None,
) -> Primitive:
    """Return an operation with these rules; its `bind(*operands, **params)` applies it.

    evaluate(*operands, **params): what is computed, traced where a program is compiled; a list where there are
    `several` results. result: their shapes from those of the operands. batch(operands, axes, **params): results of many
    and their axes; an axis of None is an operand without batch. differentiate(primals, tangents, **params) and
    transpose(cotangents, *operands, **params): as for `jax.custom_jvp`, and its transpose, with `Zero` for zeros.
    eager: what does the same outside of `jax.jit`.
    """
    p = Primitive(name)
    p.multiple_results = several
    p.def_impl(eager or evaluate)
    p.def_abstract_eval(result)
    # From JAX 0.12 on a program may hold operations that are still to be lowered
    p.to_lojax = evaluate
    mlir.register_lowering(p, mlir.lower_fun(evaluate, multiple_results=several))
    batching.primitive_batchers[p] = batch
    if differentiate is not None:
        ad.primitive_jvps[p] = differentiate
    if transpose is not None:
        ad.primitive_transposes[p] = transpose
    return p


def check(version: str) -> None:
    """Warn in one line of a JAX that nobody has tried; raise ImportError where operations do not work in it."""
    if version in TRIED:
        return
    advice = f"pip install 'jax<={TRIED[-1]}' 'jaxlib<={TRIED[-1]}'"
    try:
        _probe()
    except Exception as error:
        reason = f"{type(error).__name__}: {error}".splitlines()[0]
        raise ImportError(f"jax {version} does not work with this jaxrt ({reason:.200}): {advice}") from error
    warnings.warn(
        f"jax {version} has not been tried with this jaxrt: compare a picture and a gradient, or {advice}",
        RuntimeWarning,
        stacklevel=2,
    )


def _probe() -> None:
    """Raise whatever is wrong with an operation under jit, vmap, jvp and grad."""

    def double(x: Array) -> list[Array]:
        return [2 * x]

    def result(x: Any) -> list[ShapedArray]:
        return [ShapedArray(x.shape, x.dtype)]

    def apply(x: Array) -> Array:
        return p.bind(x)[0]

    def batch(operands: Sequence[Array], axes: Sequence[int | None]) -> tuple[list[Array], list[int | None]]:
        return p.bind(*operands), list(axes)

    def differentiate(primals: Sequence[Array], tangents: Sequence[Any]) -> tuple[list[Array], list[Array]]:
        return p.bind(*primals), p.bind(*map(instantiate_zeros, tangents))

    def transpose(cotangents: Sequence[Any], x: Any) -> list[Array | None]:
        return p.bind(*map(instantiate_zeros, cotangents)) if is_undefined_primal(x) else [None]

    p = operation("probe", double, result, batch, differentiate, transpose)
    x = jnp.ones(3, jnp.float32)
    found = [
        *jax.jit(apply)(x).tolist(),
        *jax.vmap(jax.jit(apply))(x).tolist(),
        *jax.jvp(apply, (x,), (x,))[1].tolist(),
        *jax.jit(jax.grad(lambda x: apply(x).sum()))(x).tolist(),
    ]
    if found != [2.0] * len(found):
        raise ArithmeticError(f"a doubling gives {found}")


check(jax.__version__)
