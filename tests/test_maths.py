"""Vectors, guards and compensated sums."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrt.core import maths

U = 2.0**-24


def vectors(n=1000, seed=0):
    return np.random.default_rng(seed).normal(size=(2, n, 3)).astype(np.float32)


def test_unit_roundoff_follows_the_dtype():
    assert maths.unit_roundoff(jnp.ones(())) == U and maths.unit_roundoff(np.float64(1)) == 2.0**-53


def test_dot_and_cross_match_numpy():
    a, b = vectors()
    size = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
    dots = jax.jit(jax.vmap(maths.dot))(a, b)
    assert np.all(np.abs(dots - np.sum(a.astype(float) * b, 1)) <= 4 * U * size)
    crosses = jax.jit(jax.vmap(maths.cross))(a, b)
    assert np.all(np.abs(crosses - np.cross(a.astype(float), b)).max(1) <= 4 * U * size)


@pytest.mark.parametrize("x, root, slope", [(4.0, 2.0, 0.25), (0.0, 0.0, 0.0), (-1.0, 0.0, 0.0)])
def test_safe_sqrt(x, root, slope):
    assert jax.value_and_grad(maths.safe_sqrt)(x) == (root, slope)


@pytest.mark.parametrize("a, b, value, slopes", [(3.0, 2.0, 1.5, (0.5, -0.75)), (3.0, 0.0, 0.0, (0.0, 0.0))])
def test_safe_divide(a, b, value, slopes):
    assert maths.safe_divide(jnp.float32(a), jnp.float32(b)) == value
    assert jax.grad(maths.safe_divide, (0, 1))(a, b) == slopes


@pytest.mark.parametrize("scale", [1e-30, 1, 1e30])
def test_normalize_at_every_size(scale):
    v = vectors()[0] * np.float32(scale)
    truth = v.astype(float) / np.linalg.norm(v.astype(float), axis=1, keepdims=True)
    assert np.abs(jax.jit(jax.vmap(maths.normalize))(v) - truth).max() <= 4 * U


def test_normalize_of_zero_is_zero_and_its_derivative_is_finite():
    zero = jnp.zeros(3)
    assert np.all(maths.normalize(zero) == 0) and np.isfinite(jax.jit(jax.jacfwd(maths.normalize))(zero)).all()


def test_normalize_has_the_tangential_derivative():
    v = jnp.asarray([1.0, 2.0, -2.0])
    n = np.asarray(v) / 3
    for jacobian in (jax.jit(jax.jacfwd(maths.normalize))(v), jax.jit(jax.jacrev(maths.normalize))(v)):
        assert np.allclose(jacobian, (np.eye(3) - np.outer(n, n)) / 3, atol=4 * U)


def test_sign_or_one():
    assert [float(maths.sign_or_one(jnp.float32(x))) for x in (-2.0, -0.0, 0.0, 3.0)] == [-1, 1, 1, 1]


def test_grad_only_has_no_value_but_the_derivative():
    assert jax.value_and_grad(lambda x: maths.grad_only(3 * x) + 1)(2.0) == (1.0, 3.0)


def test_kahan_add_counts_past_two_to_the_24():
    start = jnp.float32(2**24)
    count, zero = 1000, jnp.float32(0)

    def add(_, sums):
        return maths.kahan_add(*sums, jnp.float32(1))

    naive = jax.jit(lambda x: jax.lax.fori_loop(0, count, lambda _, x: x + 1, x))(start)
    total, _ = jax.jit(lambda x: jax.lax.fori_loop(0, count, add, (x, zero)))(start)
    assert naive == 2**24 and total == 2**24 + count


def test_face_forward():
    n = jnp.asarray([0.0, 1.0, 0.0])
    assert np.array_equal(maths.face_forward(n, n), n)
    assert np.array_equal(maths.face_forward(n, -n), -n)
