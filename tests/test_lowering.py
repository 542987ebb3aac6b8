"""Programs for accelerators: traced and lowered for GPUs and TPUs, which need not be there."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import pytest

import jaxrt
from benchmarks.ladder import LADDER, build
from jaxrt.boundary import guiding
from jaxrt.render import wide_tile

PLATFORMS = ("cuda", "tpu")


def lowered(name: str, transformed: Callable[..., Any] = lambda loss: loss, edges: int = 0) -> str:
    """Return the program of a loss of a rung's picture, transformed, as accelerators get it."""
    scene = build(LADDER[name])

    def loss(p: dict[str, jax.Array], scene: jaxrt.Scene) -> jax.Array:
        moved = jaxrt.with_parameters(scene, p)
        options = dict(spp=1, max_depth=2, tile=wide_tile(512, 512), devices=jax.devices()[:1], boundary_samples=edges)
        return jnp.sum(jaxrt.render(moved, 0, **options) ** 2)

    traced = jax.jit(transformed(loss)).trace(jaxrt.parameters(scene), scene)
    text = traced.lower(lowering_platforms=PLATFORMS).as_text()
    assert "stablehlo.while" in text
    # What runs on one platform alone would be a call of its own
    assert "custom_call" not in text
    return text


@pytest.mark.parametrize("name", list(LADDER))
def test_pictures_are_lowered_for_gpu_and_tpu(name: str) -> None:
    lowered(name)


def test_gradients_of_everything_are_lowered_for_gpu_and_tpu() -> None:
    assert len(lowered("everything", jax.grad)) > len(lowered("everything"))


@pytest.mark.slow
def test_gradients_with_edges_are_lowered_for_gpu_and_tpu(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guiding, "want_wide", lambda devices: True)
    assert len(lowered("base", jax.grad, edges=64)) > len(lowered("base", jax.grad))
