"""Operations of our own: under every transformation, and in a JAX that nobody has tried."""

import re
import tomllib
import warnings
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

from jaxrt.kernels import internals

ROOT = Path(__file__).parents[1]

pytestmark = pytest.mark.quick


def test_this_jax_has_been_tried() -> None:
    assert jax.__version__ in internals.TRIED


def test_the_probe_finds_nothing_wrong() -> None:
    internals._probe()


def test_an_untried_jax_that_works_is_one_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.warns(
        RuntimeWarning, match=r"^jax 99\.0 has not been tried with this jaxrt: .*pip install 'jax<="
    ) as w:
        internals.check("99.0")
    assert len(w) == 1 and "\n" not in str(w[0].message)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for version in internals.TRIED:
            internals.check(version)


@pytest.mark.parametrize("wrong", [AttributeError("module has no attribute 'Zero'\nand so on"), TypeError("bind()")])
def test_an_untried_jax_that_does_not_work_is_an_error(monkeypatch: pytest.MonkeyPatch, wrong: Exception) -> None:
    def fail() -> None:
        raise wrong

    monkeypatch.setattr(internals, "_probe", fail)
    with pytest.raises(ImportError, match=r"^jax 99\.0 does not work with this jaxrt \(.*\): pip install 'jax<=") as e:
        internals.check("99.0")
    assert "\n" not in str(e.value)


def test_a_probe_with_wrong_numbers_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    original = jax.vmap
    monkeypatch.setattr(jax, "vmap", lambda f: lambda x: original(f)(x) + 1)
    with pytest.raises(ImportError, match="a doubling gives"):
        internals.check("99.0")


def test_pip_takes_no_jax_that_has_not_been_tried() -> None:
    needs = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    for package in ("jax", "jaxlib"):
        (bound,) = (line for line in needs if re.match(rf"{package}\b", line))
        assert bound == f"{package}>={internals.TRIED[0]},!=0.10.2,<0.12.1"
    assert internals.TRIED[-1].startswith("0.12.0")


def test_only_one_file_touches_more_than_the_public_face() -> None:
    for module in (ROOT / "jaxrt").rglob("*.py"):
        if module.name != "internals.py":
            text = module.read_text()
            assert not re.search(
                r"jax\.interpreters|jax\._src|jax\.core\.(?!Tracer\b)|jaxlib\.(?!__version__)", text
            ), module


def test_an_operation_outside_of_jit_uses_what_it_is_told() -> None:
    calls = []

    def eager(x: Array) -> list[Array]:
        calls.append("eager")
        return [x + 1]

    p = internals.operation(
        "successor", lambda x: [x + 1], lambda x: [x], lambda x, axes: (p.bind(*x), axes), eager=eager
    )
    x = jnp.arange(3.0, dtype=jnp.float32)
    np.testing.assert_array_equal(p.bind(x)[0], [1, 2, 3])
    np.testing.assert_array_equal(jax.jit(p.bind)(x)[0], [1, 2, 3])
    assert calls == ["eager"]
