"""A derivative is that of the picture as sampled, whatever else is asked beside it."""

from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

import jaxrt

SCENE = {
    "camera": {"position": [0, 3, 6], "target": [0, 0.5, 0], "width": 8, "height": 8, "fov": 40},
    "materials": {"white": {"type": "diffuse", "albedo": [0.8, 0.4, 0.2]}},
    "spheres": [{"center": [0, -1000, 0], "radius": 1000, "material": "white"}],
    "lights": [{"position": [2, 4, 2], "intensity": 25, "radius": 1}],
}
OWN = ("materials.albedo", "lights.intensity")  # the picture's own light samples serve these


@cache
def scene():
    return jaxrt.build(SCENE)


@partial(jax.jit, static_argnames="beside")
def loss(changes, beside=False):
    """Return a loss; beside: the derivative in the light's position is asked too, along no change."""
    moved = dict(changes)
    if beside:
        moved["lights.position"] = jaxrt.parameters(scene())["lights.position"] + 0 * changes["lights.intensity"]
    picture = jaxrt.render(jaxrt.with_parameters(scene(), moved), 3, spp=4, max_depth=2, devices=jax.devices()[:1])
    return jnp.mean(picture**2)


@pytest.mark.parametrize("beside", [False, True])
def test_s10_derivatives_are_those_of_the_sampled_picture_whatever_is_asked_beside(beside):
    """Against finite differences with common random numbers, forwards and backwards."""
    start = {name: jaxrt.parameters(scene())[name] for name in OWN}
    check_grads(partial(loss, beside=beside), (start,), 1, modes=("fwd", "rev"), eps=2e-3, rtol=2e-3)


def test_s10_mixed_second_derivatives_are_one():
    albedo, position = (jaxrt.parameters(scene())[name] for name in ("materials.albedo", "lights.position"))

    def of_two(x):
        return loss({"materials.albedo": albedo * x[0], "lights.position": position + x[1]})

    second = np.asarray(jax.jacfwd(jax.grad(of_two))(jnp.array([1.0, 0.0])))
    np.testing.assert_allclose(second[0, 1], second[1, 0], rtol=1e-4)
    assert abs(second[0, 1]) > 0.1
