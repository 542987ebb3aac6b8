"""A derivative is that of the picture as sampled, whatever else is asked beside it."""

from functools import cache, partial

import jax
import jax.numpy as jnp
import pytest
from jax.test_util import check_grads

import jaxrt

SCENE = {
    "camera": {"position": [0, 3, 6], "target": [0, 0.5, 0], "width": 8, "height": 8, "fov": 40},
    "materials": {"white": {"type": "diffuse", "albedo": [0.8, 0.4, 0.2]}},
    "spheres": [{"center": [0, -100, 0], "radius": 100, "material": "white"}],
    "lights": [{"position": [2, 4, 2], "intensity": 25, "radius": 1}],
}
pytestmark = pytest.mark.usefixtures("quick_compilation")
OWN = ("materials.albedo", "lights.intensity")  # the picture's own light samples serve these


@cache
def scene():
    return jaxrt.build(SCENE)


def loss(changes, beside=False):
    """Return a loss; beside: the derivative in the light's position is asked too, along no change."""
    moved = dict(changes)
    if beside:
        moved["lights.position"] = jaxrt.parameters(scene())["lights.position"] + 0 * changes["lights.intensity"]
    picture = jaxrt.render(jaxrt.with_parameters(scene(), moved), 3, spp=4, max_depth=2, devices=jax.devices()[:1])
    return jnp.mean(picture**2)


@pytest.mark.parametrize(("beside", "modes"), [(False, ["rev"]), (True, ["fwd", "rev"])])
def test_s10_derivatives_are_those_of_the_sampled_picture_whatever_is_asked_beside(beside, modes):
    """Against finite differences with common random numbers, alone and with what other light samples serve."""
    start = {name: jaxrt.parameters(scene())[name] for name in OWN}
    f = jax.jit(partial(loss, beside=beside))
    check_grads(f, (start,), 1, modes=modes, eps=2e-3, rtol=2e-3)
    # Each by itself too, on which a random direction might lay little weight
    slope = jax.grad(f)(start)
    for name, value in start.items():
        ends = [f(start | {name: (1 + step) * value}) for step in (0.01, -0.01)]
        assert float(jnp.vdot(slope[name], value)) == pytest.approx(float(ends[0] - ends[1]) / 0.02, rel=2e-3)
