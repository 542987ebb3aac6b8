"""Paths that begin where others have ended: every sample's light is drawn once, and is that of a packet by itself."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrt
from jaxrt.core.records import Ray
from jaxrt.kernels.bits import leading, masks
from jaxrt.transport import regeneration
from jaxrt.transport.path import Walk
from jaxrt.transport.regeneration import MOST, Paths

SPP = MOST + 5  # more than are kept at once, and no whole number of blocks
DEPTH = 5


def in_the_open() -> jaxrt.Scene:
    """Return a scene of which paths end early, late, in mirrors, in tinted glass, off gold, at a mesh, in a light."""
    kinds = {
        "floor": {"type": "diffuse", "albedo": [0.8, 0.7, 0.6]},
        "gold": {"type": "conductor", "metal": "gold", "roughness": 0.3},
        "mirror": {"type": "mirror", "albedo": [0.9, 0.9, 0.9]},
        "glass": {"type": "glass", "ior": 1.5, "absorption": [0.1, 0.5, 0.9]},
    }
    balls = {"gold": [-1.2, 0.5, 0], "mirror": [0, 0.5, -0.6], "glass": [1.2, 0.5, 0]}
    corners = np.array([[x, y, z] for x in (-0.4, 0.4) for y in (0.0, 0.3) for z in (0.8, 1.4)])
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    spheres = [{"center": center, "radius": 0.5, "material": name} for name, center in balls.items()]
    return jaxrt.build(
        {
            "camera": {"position": [0, 1.5, 5], "target": [0, 0.5, 0], "fov": 40, "width": 20, "height": 12},
            "materials": kinds,
            "spheres": [{"center": [0, -1000, 0], "radius": 1000, "material": "floor"}, *spheres],
            "meshes": [
                {
                    "vertices": corners.tolist(),
                    "faces": np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).tolist(),
                    "material": "floor",
                }
            ],
            "lights": [
                {"position": [1, 3, 2], "radius": 0.4, "intensity": [9, 9, 9]},
                {"position": [-2, 3, 1], "radius": 0.1, "intensity": [4, 5, 6]},
            ],
            "environment": {"radiance": [0.2, 0.3, 0.4]},
        }
    )


@pytest.mark.usefixtures("quick_compilation")
def test_a_picture_is_that_of_packets_without() -> None:
    scene = in_the_open()
    with_and_without = [
        np.asarray(jaxrt.render(scene, 3, spp=SPP, max_depth=DEPTH, tile=tile)) for tile in ((5, 3), (40, 28))
    ]
    a, b = with_and_without
    # As in test_render: but for pixels where a rounding makes a path hit another thing, more of them by more samples
    different = np.any(np.abs(a - b) > 1e-5 * (np.abs(a) + 1e-3), axis=-1)
    assert np.count_nonzero(different) <= 0.02 * different.size
    assert a.std() > 0.05


@pytest.mark.quick
def test_bits_that_lead() -> None:
    for n in range(129):
        np.testing.assert_array_equal(leading(jnp.int32(n), 4), masks(jnp.arange(128) < n))


@pytest.mark.quick
@pytest.mark.parametrize("n", [15, 128])
@pytest.mark.parametrize("share", [0.0, 0.02, 0.4, 0.98, 1.0])
def test_those_alive_close_up_and_the_others_are_drawn(n: int, share: float) -> None:
    random = np.random.default_rng(int(100 * share) + n)
    alive, there = random.uniform(size=n) < share, np.arange(n) < n - 3
    name = random.permutation(n).astype(np.int32)
    vectors = jnp.asarray(np.stack([name] * 3, -1), jnp.float32)
    walk = Walk(Ray(vectors, vectors + 1), vectors + 2, vectors + 3, jnp.asarray(name % 2 == 0))
    numbers = [jnp.asarray(n) for n in (name + 9, name, name % 3 + 64, name + 7)]
    paths = Paths(walk, *numbers)
    closed, count = jax.jit(regeneration._closed_up)(paths, masks(jnp.asarray(alive & there)))
    assert count == (alive & there).sum()
    left = np.asarray(closed.lane[:count])
    assert sorted(left) == sorted(name[alive & there])
    for leaf, change in zip(jax.tree.leaves(closed.walk)[:4], range(4), strict=True):
        np.testing.assert_array_equal(leaf[:count], np.stack([left + change] * 3, -1))
    np.testing.assert_array_equal(closed.walk.specular[:count], left % 2 == 0)
    np.testing.assert_array_equal(closed.hit[:count], left + 9)
    np.testing.assert_array_equal(closed.event[:count], left + 7)
    drawn = jax.jit(regeneration._drawn)(
        jnp.full((3 * n, 3), -1.0), paths, jnp.int32(64), masks(jnp.asarray(there & ~alive))
    )
    expected = np.full((3 * n, 3), -1.0)
    ended = name[there & ~alive]
    expected[ended % 3 * n + ended] = ended[:, None] + 3
    np.testing.assert_array_equal(drawn, expected)
