"""Strictness for all tests, and the scenes that many of them share."""

import jax
import pytest

import jaxrt

pytest_plugins = ["tests.stability.report"]
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")
jaxrt.use_cpu_cores(2)
# Two devices for the tests that name them; on one, two test processes share two cores without waiting for each other
jax.config.update("jax_default_device", jax.devices()[0])


@pytest.fixture(scope="session")
def room() -> jaxrt.Scene:
    """The README's room."""
    return jaxrt.load_scene("scenes/room.toml")


@pytest.fixture
def quick_compilation():
    """Compile three times as fast what then runs eight times as long: for tests of large programs that run briefly."""
    jax.config.update("jax_disable_most_optimizations", True)
    yield
    jax.config.update("jax_disable_most_optimizations", False)
