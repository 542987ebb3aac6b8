"""Strictness for all tests, and the scenes that many of them share."""

import gc

import jax
import pytest

import jaxrt

pytest_plugins = ["tests.stability.report"]
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")
jaxrt.use_cpu_cores(2)
# Tracing makes many objects that stay. At 50 000, as `keep_programs` has it, processes of all tests grow to 6 GB
gc.freeze()
gc.set_threshold(5_000)
# Two devices for the tests that name them; on one, two test processes share two cores without waiting for each other
jax.config.update("jax_default_device", jax.devices()[0])


@pytest.fixture(scope="session")
def room() -> jaxrt.Scene:
    """The README's room."""
    return jaxrt.load_scene("scenes/room.toml")


UNOPTIMISED = "jax_disable_most_optimizations"
_left: set[str] = set()  # what programs may be left of that other tests do not want


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put each file's tests of unoptimised programs last: what is compiled is then forgotten once, not in between."""
    files = {path: k for k, path in enumerate(dict.fromkeys(item.path for item in items))}
    items.sort(key=lambda item: (files[item.path], "quick_compilation" in getattr(item, "fixturenames", ())))


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Forget unoptimised programs where the next test wants others: they differ in the last bit."""
    if _left and "quick_compilation" not in getattr(item, "fixturenames", ()):
        jax.clear_caches()
        _left.clear()


@pytest.fixture
def quick_compilation():
    """Compile three times as fast what then runs eight times as long: for tests of large programs that run briefly."""
    _left.add(UNOPTIMISED)
    jax.config.update(UNOPTIMISED, True)
    yield
    jax.config.update(UNOPTIMISED, False)
