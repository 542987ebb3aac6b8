"""Functions sealed against JAX's taking them apart."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array, lax

from jaxrt.kernels.sealed import sealed

pytestmark = pytest.mark.quick


def powers(values: dict[str, Array], n: Array) -> tuple[Array, Array]:
    return lax.fori_loop(0, 3, lambda _, x: x * values["x"], values["x"]), n + 1


def test_values_with_and_without_jit_and_in_batches() -> None:
    x, n = jnp.arange(4.0, dtype=jnp.float32), jnp.int32(6)
    for run in (sealed, lambda *operands: jax.jit(lambda *o: sealed(*[powers, *o]))(*operands[1:])):
        fourth, next_number = run(powers, {"x": x}, n)
        np.testing.assert_array_equal(fourth, np.arange(4.0) ** 4)
        assert next_number == 7
    together = jax.vmap(lambda x: sealed(powers, {"x": x}, n)[0])(jnp.stack([x, 2 * x], axis=0))
    np.testing.assert_array_equal(together, [np.arange(4.0) ** 4, 16 * np.arange(4.0) ** 4])


def test_no_derivative_passes_and_the_function_stays_whole() -> None:
    def loss(x: Array) -> Array:
        return jnp.sum(x * sealed(powers, {"x": x}, jnp.int32(0))[0])

    x = jnp.arange(4.0, dtype=jnp.float32)
    np.testing.assert_array_equal(jax.grad(loss)(x), np.arange(4.0) ** 4)
    names = [equation.primitive.name for equation in jax.make_jaxpr(jax.grad(loss))(x).jaxpr.eqns]
    assert names.count("sealed") == 1 and not {"scan", "while"} & set(names)
