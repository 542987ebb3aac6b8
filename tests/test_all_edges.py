"""Derivatives where surfaces cross, against finite differences: two boxes and two balls in one scene.

Both are means over independent seeds, compared by nine smooth functionals. They may be 6 of their difference's standard
errors apart, which for 15 degrees of freedom happens by chance once in 40,000 comparisons (Student), of the 27 here
once in 1,500 runs; and besides 1 % of the largest functional, for steps of finite length. Each move is such that the
derivative inside of edges is far outside of that. What a diffuse surface sees is in `test_bounced_edges.py`, what a
mirror shows in `test_same_edges.py`, light by mirrors and glass in `test_caustics.py`.
"""

from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from edge_scenes import plan, quick_jit

import jaxrt
from benchmarks.edge_rows import bumps
from benchmarks.edge_scenes import ball, box, quad, scene
from benchmarks.ladder import build
from jaxrt.boundary import edge_tangent
from jaxrt.scene import drawn

SIZE, SEEDS, SPP, SAMPLES = 16, 16, 256, 8192
ERRORS = 6  # standard errors
TRUNCATION = 0.01
X = np.eye(3)[0]


def crossing():
    """Return two boxes and two balls that cut each other."""
    return scene(
        {"position": [0, 3, 6], "target": [0, 0.3, 0], "fov": 32},
        meshes=[
            box("box", "red", [0.5, 0.5, 0], 0.6, [0, 20, 0]),
            box("other box", "blue", [1.2, 0.5, 0.3], 0.45, [0, 50, 0]),
        ],
        spheres=[ball("ball", "red", [-1.4, 0.5, 0], 0.6), ball("other ball", "blue", [-0.7, 0.4, 0.2], 0.5)],
        triangles=quad([-20, 0, -20], [0, 0, 40], [40, 0, 0], "dark"),
        lights=[{"position": [1, 5, 6], "intensity": 60}],
    )


MOVES = {"spheres.center[other ball]": X, "meshes.vertices[box]": X, "camera.position": X}
DEPTH, STEP, FD_SPP = 1, 0.02, 512


class Programs:
    """Compiled once: the picture, its derivative inside of edges, and what moving edges add."""

    def __init__(self):
        here = build(crossing(), width=SIZE, height=SIZE)
        self.start = {name: jaxrt.parameters(here, name) for name in MOVES}

        def picture(values, key, spp):
            return jaxrt.render(jaxrt.with_parameters(here, values), key, spp=spp, max_depth=DEPTH)

        def slope(change, key):
            return jax.jvp(partial(picture, key=key, spp=SPP), (self.start,), (change,))[1]

        def at_edges(key):
            def one(change):
                tangent = jax.jvp(partial(jaxrt.with_parameters, here), (self.start,), (change,))[1]
                return edge_tangent(drawn(here), drawn(tangent), key, plan(SAMPLES, DEPTH, geometry=True))

            changes = [self.change(name) for name in MOVES]
            pictures = jax.vmap(one)(jax.tree.map(lambda *each: jnp.stack(each), *changes))
            return dict(zip(MOVES, pictures, strict=True))

        self.picture, self.interior = jax.jit(partial(picture, spp=FD_SPP)), jax.jit(slope)
        # Every move's change of the picture, by the same samples
        self.edges = cache(quick_jit(at_edges))

    def change(self, name):
        """Return the direction in the space of all that moves."""
        zeros = {other: jnp.zeros_like(value) for other, value in self.start.items()}
        return zeros | {name: jnp.broadcast_to(jnp.asarray(MOVES[name], jnp.float32), self.start[name].shape)}

    def difference(self, change, key):
        """Return the central difference, both pictures drawn with the same random numbers."""
        ends = [self.picture({k: v + h * change[k] for k, v in self.start.items()}, key) for h in (STEP, -STEP)]
        return (np.asarray(ends[0], float) - np.asarray(ends[1], float)) / (2 * STEP)


@cache
def programs():
    return Programs()


def functionals(picture):
    """Return nine means of a picture's brightness."""
    return bumps(picture).reshape(9, 3).mean(1)


def mean(values):
    """Return the mean of rows, and its standard error."""
    values = np.stack(values)
    return values.mean(0), values.std(0, ddof=1) / len(values) ** 0.5


@pytest.mark.parametrize("move", MOVES)
def test_derivatives_are_those_of_finite_differences(move):
    here = programs()
    change = here.change(move)
    keys = [np.uint32(seed) for seed in range(SEEDS)]
    truth, its_noise = mean([functionals(here.difference(change, key + 1000)) for key in keys])
    inside = [functionals(here.interior(change, key)) for key in keys]
    found, noise = mean([one + functionals(here.edges(key)[move]) for one, key in zip(inside, keys, strict=True)])
    interior = np.mean(inside, 0)
    bound = ERRORS * np.hypot(noise, its_noise) + TRUNCATION * np.abs(truth).max()
    # The test can tell: without edges it fails, and by far
    missing, allowed = np.linalg.norm(interior - truth), np.linalg.norm(bound)
    assert missing > 2 * allowed, f"too noisy to tell: {missing:.3g} is missing, {allowed:.3g} allowed"
    assert np.all(np.abs(found - truth) < bound), f"off by {(found - truth) / bound} bounds"
