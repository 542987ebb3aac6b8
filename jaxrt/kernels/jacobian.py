"""Residuals that carry their Jacobian, for least-squares solvers."""

from collections.abc import Callable
from typing import Any

import jax
from jax import Array, lax
from jax.flatten_util import ravel_pytree


def jacobian_once(residual: Callable[[Any, Any], Array]) -> Callable[[Any, Any], Array]:
    """Return the residual (p, args) -> (n,) with the same values and first derivatives in p, from one program.

    A least-squares solver asks for a residual's derivative in several places, and again for every damping that it
    tries. A picture's program takes long to compile: here it is compiled once in each solve, and the Jacobian, of one
    forward derivative for each number in p, is drawn once at each p. There are no second derivatives.
    """

    def linear(p: Any, args: Any) -> Array:
        flat, unravel = ravel_pytree(p)
        here = lax.stop_gradient(flat)
        value, jacobian = value_and_jacobian(lambda vector: residual(unravel(vector), args), here)
        return value + lax.dot(jacobian, flat - here, precision=lax.Precision.HIGHEST)

    return linear


def value_and_jacobian(residual: Callable[[Array], Array], vector: Array) -> tuple[Array, Array]:
    """Return residual (n,) and Jacobian (n, k) at `vector` (k,), without further derivatives."""

    def twice(vector: Array) -> tuple[Array, Array]:
        value = residual(vector)
        return value, value

    jacobian, value = jax.jacfwd(twice, has_aux=True)(vector)
    return lax.stop_gradient((value, jacobian))
