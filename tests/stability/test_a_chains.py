"""Derivatives along chains of mirrors and glass, which grow with every ball: case A12."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

import jaxrt
from jaxrt.core.maths import normalize
from tests.stability import naive


def textbook_chain(center, radius, o, d):
    """Return a coordinate of where a ray is after 16 reflections at spheres."""

    def reflect(ray, _):
        o, d = ray
        t = jax.vmap(naive.textbook_sphere, (None, None, 0, 0))(o, d, center, radius)
        i = jnp.argmin(t)
        p = o + t[i] * d
        n = (p - center[i]) / radius[i]
        return (p, d - 2 * jnp.sum(d * n) * n), None

    return lax.scan(reflect, (o, d), length=16)[0][0][0]


@pytest.mark.usefixtures("quick_compilation")
def test_a12_chains_of_mirrors_and_glass(figures):
    """Balls in a room of mirror, which no path leaves: 16 events, whose curvatures multiply. Backwards, 8 times.

    Naive: 16 reflections at the same balls by the textbook's root, masked after.
    """
    places = [(x, y, z) for x in (-0.4, 0.4) for y in (-0.4, 0.4) for z in (-0.4, 0.4)]
    kinds = ["mirror", "glass"] * 4
    scene = jaxrt.build(
        {
            "camera": {"position": [0, 0, 0.1], "target": [0.3, 0.2, -1], "fov": 90, "width": 16, "height": 16},
            "materials": {
                "mirror": {"type": "mirror", "albedo": [1, 1, 1]},
                "glass": {"type": "glass", "ior": 1.5},
                "wall": {"type": "diffuse", "albedo": [0.5, 0.5, 0.5]},
            },
            "spheres": [
                {"center": [0, 0, 0], "radius": 1, "material": "mirror"},
                {"center": [0.1, -0.1, -0.7], "radius": 0.1, "material": "wall"},
                *({"center": p, "radius": 0.3, "material": k} for p, k in zip(places, kinds, strict=True)),
            ],
            "lights": [{"position": [0, 0.1, -0.5], "intensity": 1, "radius": 0.05}],
        }
    )
    center = jaxrt.parameters(scene)["spheres.center"]

    @jax.jit
    def slopes(center, weights):
        def seen(center):
            moved = jaxrt.with_parameters(scene, {"spheres.center": center})
            return jnp.sum(weights * jaxrt.render(moved, 0, spp=4, max_depth=16, devices=jax.devices()[:1]))

        return jax.grad(seen)(center)

    weights = np.random.default_rng(12).normal(size=(8, 16, 16, 3)).astype(np.float32)
    found = np.stack([slopes(center, w) for w in weights])
    o, d = jnp.zeros(3), normalize(jnp.float32([0.3, 0.2, -1]))
    chained = jax.jit(jax.grad(textbook_chain))(center, scene.spheres.radius, o, d)
    wrong, bad = (np.count_nonzero(~np.isfinite(x)) for x in (found, chained))
    what = "derivatives not finite after 16 mirrors and glass; naive: a root masked after"
    figures("A12", what, naive=bad, ours=wrong, at_most=0)
    largest = np.abs(found).max()
    assert largest > 1e4
    figures("A12", "largest derivative after 16 mirrors and glass", ours=largest, at_most=np.finfo(np.float32).max)
