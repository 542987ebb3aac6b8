"""A lamp at the camera's own place: shadows hide behind what casts them, and no edge of one is ever seen.

Derivatives and finite differences are means over independent seeds, compared by smooth functionals. Their difference
may be 6 standard errors, which 15 degrees of freedom exceed by chance once in 40,000 times (Student), and 1 % of the
largest functional for steps of finite length.
"""

from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from edge_scenes import AXES, box, bumps, plan, quad, quick_jit

import jaxrt
from jaxrt.boundary import clearance_of, splat
from jaxrt.boundary.outlines import camera_edges
from jaxrt.boundary.shadows import shadow_edges

SIZE, SEEDS, ERRORS = 16, 16, 6
EYE = [0.3, 3.0, 6.0]
PLAN = plan(8192, 1, geometry=True, lights=True)


@cache
def flash(aside=0.0):
    """Return a ball and a box (its vertices come first) over a floor; the lamp is so far from the camera."""
    return jaxrt.build(
        {
            "camera": dict(position=EYE, target=[0, 0.6, 0], fov=34, width=SIZE, height=SIZE),
            "materials": {
                "floor": {"type": "diffuse", "albedo": [0.7, 0.7, 0.7]},
                "ball": {"type": "diffuse", "albedo": [0.2, 0.3, 0.9]},
                "box": {"type": "diffuse", "albedo": [0.9, 0.3, 0.2]},
            },
            "spheres": [{"center": [-0.8, 1.0, 0.2], "radius": 0.7, "material": "ball"}],
            "triangles": box([0.9, 0.9, 0], 0.5, 0.4, "box") + quad([-20, 0, -20], [0, 0, 40], [40, 0, 0], "floor"),
            "lights": [{"position": [EYE[0] + aside, *EYE[1:]], "intensity": 40}],
        }
    )


def of_box(direction):
    return np.repeat([direction, [0, 0, 0]], [36, 6], axis=0)


MOVES = {
    "ball's radius": {"spheres.radius": [1.0]},
    "ball up": {"spheres.center": AXES[1][None]},
    "box up": {"meshes.vertices": of_box([0, 1, 0])},
    "box sideways": {"meshes.vertices": of_box([1, 0, 0])},
    "camera and lamp sideways": {"camera.position": AXES[0], "lights.position": AXES[0][None]},
    "camera and lamp up": {"camera.position": AXES[1], "lights.position": AXES[1][None]},
}
NAMES = ("camera.position", "lights.position", "meshes.vertices", "spheres.center", "spheres.radius")
STEP = 0.01


def start():
    return {name: jaxrt.parameters(flash(), name) for name in NAMES}


@jax.jit
def picture(values, key):
    return jaxrt.render(jaxrt.with_parameters(flash(), values), key, spp=1024, max_depth=1)


@jax.jit
def inside(change, key):
    def draw(values):
        return jaxrt.render(jaxrt.with_parameters(flash(), values), key, spp=256, max_depth=1)

    return jax.jvp(draw, (start(),), (change,))[1]


outlines = quick_jit(partial(camera_edges, plan=PLAN))
shadows = quick_jit(partial(shadow_edges, plan=PLAN))


@cache
def edges(seed):
    """Return samples of all edges that the picture has: nothing crosses."""
    return *outlines(flash(), jnp.uint32(seed)), *shadows(flash(), jnp.uint32(seed))


@quick_jit
def at_edges(change, groups):
    tangent = jax.jvp(partial(jaxrt.with_parameters, flash()), (start(),), (change,))[1]
    moves = [jax.jvp(partial(clearance_of, samples=one), (flash(),), (tangent,))[1] for one in groups]
    return sum(splat(one, move, (SIZE, SIZE)) for one, move in zip(groups, moves, strict=True))


def mean(pictures):
    """Return the mean of the pictures' functionals, and its standard error."""
    values = np.stack([bumps(one) for one in pictures])
    return values.mean(0), values.std(0, ddof=1) / SEEDS**0.5


@pytest.mark.parametrize("move", MOVES)
def test_what_moves_in_a_flash_photograph(move):
    change = {k: jnp.asarray(MOVES[move].get(k, jnp.zeros_like(v)), jnp.float32) for k, v in start().items()}
    ends = [{k: v + h * change[k] for k, v in start().items()} for h in (STEP, -STEP)]
    truth, its_noise = mean([(picture(ends[0], k) - picture(ends[1], k)) / (2 * STEP) for k in range(SEEDS)])
    parts = [(inside(change, k), at_edges(change, edges(k))) for k in range(SEEDS)]
    found, noise = mean([one + other for one, other in parts])
    bound = ERRORS * np.hypot(noise, its_noise) + 0.01 * np.abs(truth).max()
    assert np.all(np.abs(found - truth) < bound), f"off by {np.abs((found - truth) / bound).max()} bounds"
    # The test can tell: without edges it fails
    interior, _ = mean([one for one, _ in parts])
    assert np.linalg.norm(interior - truth) > 2 * np.linalg.norm(bound)


def brightness(aside):
    """Return the weights of all edges of shadows that the camera sees."""
    return sum(float(jnp.sum(samples.weight)) for samples in shadows(flash(aside), jnp.uint32(0)))


def test_no_edge_of_a_shadow_is_seen_from_the_lamp():
    assert 0 <= brightness(0.0) < 1e-3 * brightness(0.5)
