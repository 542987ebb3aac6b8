"""Changes of a scene whose effect on the picture is known, though the picture is not.

Powers of two scale every float32 operation exactly, and so do permutations: such pictures agree bit by bit,
or to a few ulp where the compiler may fuse other products. Elsewhere two pictures with different seeds are
compared: 16 seeds each, t-test on 4 × 4 blocks and channels with Šidák's bound, 1e-4 false alarms per
comparison of random seeds.
"""

import jax
import numpy as np
import pytest
from scipy import stats

import jaxrt

SEEDS = 16
CORNERS = [(-3.0, -1.0, -3.0), (3.0, -1.0, -3.0), (3.0, -1.0, 3.0), (-3.0, -1.0, 3.0)]


def quad(corners, pieces=1):
    """Return the triangles of a quad cut into pieces × pieces smaller ones; the cuts are dyadic, so exact."""
    a, b, _, d = np.array(corners)
    across, down = (b - a) / pieces, (d - a) / pieces
    triangles = []
    for i in range(pieces):
        for j in range(pieces):
            p = a + i * across + j * down
            triangles += [(p, p + across, p + across + down), (p, p + across + down, p + down)]
    return triangles


BASE = {
    "camera": {"position": (0.5, 2.0, 6.0), "target": (0.0, -0.25, 0.0), "up": (0, 1, 0), "fov": 40.0},
    "materials": {
        "floor": {"type": "diffuse", "albedo": (0.8, 0.5, 0.25)},
        "ball": {"type": "diffuse", "albedo": (0.25, 0.5, 0.75)},
        "mirror": {"type": "mirror", "albedo": (0.9, 0.8, 0.7)},
    },
    "spheres": [((-1.0, 0.0, 0.0), 1.0, "ball"), ((1.25, 0.0, 0.5), 1.0, "mirror")],
    "triangles": [(corners, "floor") for corners in quad(CORNERS)],
    "lights": [((2.0, 4.0, 2.0), (60.0, 40.0, 20.0), 1.5), ((-3.0, 3.0, 1.0), (10.0, 20.0, 30.0), 0.0)],
}


def same(x):
    return x


def scene(base=BASE, move=same, turn=same, scale=1.0, power=1.0):
    """Return the scene with points moved, the up vector turned, and lengths and powers scaled."""

    def point(p):
        return np.asarray(move(np.array(p, float)))

    camera = base["camera"] | {"width": 8, "height": 8}
    camera |= {"position": point(camera["position"]), "target": point(camera["target"])}
    camera |= {"up": np.asarray(turn(np.array(camera["up"], float)))}
    spheres = [{"center": point(c), "radius": r * scale, "material": m} for c, r, m in base["spheres"]]
    triangles = [{"vertices": [point(v) for v in t], "material": m} for t, m in base["triangles"]]
    lights = [
        {"position": point(p), "intensity": np.multiply(i, power), "radius": r * scale} for p, i, r in base["lights"]
    ]
    return jaxrt.build(
        {
            "camera": camera,
            "materials": base["materials"],
            "spheres": spheres,
            "triangles": triangles,
            "lights": lights,
        }
    )


def shot(scene, key=0, spp=16):
    image = jaxrt.render(scene, key, spp=spp, max_depth=3, devices=jax.devices()[:1])
    return np.asarray(image, np.float64)


def blocks(scene, first, flip=False):
    """Return the means of 4 × 4 pixels: (seed, 2, 2, channel)."""
    pictures = np.stack([shot(scene, key, 256) for key in range(first, first + SEEDS)])
    pictures = pictures[:, :, ::-1] if flip else pictures
    return pictures.reshape(SEEDS, 2, 4, 2, 4, 3).mean((2, 4))


@pytest.fixture(scope="module")
def base_blocks():
    return blocks(scene(), 0)


def worst(x, y):
    """Return the largest |t| between two sets of block means, over the bound for as many comparisons."""
    t = (x.mean(0) - y.mean(0)) / np.sqrt((x.var(0, ddof=1) + y.var(0, ddof=1)) / SEEDS)
    return abs(t).max() / stats.t.isf((1 - (1 - 1e-4) ** (1 / t.size)) / 2, 2 * SEEDS - 2)


def test_the_comparison_bites(base_blocks):
    """A ball moved by .05, or lights 5 % stronger, are seen; another seed is not."""
    assert worst(base_blocks, blocks(scene(), 1000)) < 1
    assert worst(base_blocks, blocks(scene(power=1.05), 1000)) > 1
    moved = BASE | {"spheres": [((-1.0, 0.05, 0.0), 1.0, "ball"), BASE["spheres"][1]]}
    assert worst(base_blocks, blocks(scene(moved), 1000)) > 1


@pytest.mark.parametrize("exponent", [-12, -1, 1, 9])
def test_scaled_by_powers_of_two(exponent):
    """Lengths × 2^k and powers × 4^k: every float32 operation is exact, so the picture is the same to the
    bit.
    """
    s = 2.0**exponent
    scaled = scene(move=lambda p: p * s, scale=s, power=s * s)
    np.testing.assert_array_equal(shot(scaled), shot(scene()))
    np.testing.assert_array_equal(shot(scene(power=s)), shot(scene()) * s)


def test_permuted_objects():
    """The nearest of the same numbers is the same: equal to the bit."""
    permuted = BASE | {
        "spheres": BASE["spheres"][::-1],
        "triangles": BASE["triangles"][::-1],
        "materials": dict(reversed(BASE["materials"].items())),
    }
    assert list(permuted["materials"]) != list(BASE["materials"])
    np.testing.assert_array_equal(shot(scene(permuted)), shot(scene()))


def test_permuted_colours():
    """No channel knows of the others: equal to the bit."""
    turn = [2, 0, 1]
    materials = {name: m | {"albedo": tuple(m["albedo"][c] for c in turn)} for name, m in BASE["materials"].items()}
    lights = [(p, tuple(i[c] for c in turn), r) for p, i, r in BASE["lights"]]
    permuted = scene(BASE | {"materials": materials, "lights": lights})
    np.testing.assert_array_equal(shot(permuted), shot(scene())[..., turn])


def test_translated(base_blocks):
    offset = np.array([5.3, -3.1, 7.7])
    assert worst(base_blocks, blocks(scene(move=lambda p: p + offset), 1000)) < 1


@pytest.mark.parametrize("axis", [(0, 1, 0), (1, 2, -2), (1, 0, 0)])
def test_rotated(base_blocks, axis):
    """By 2.5 radians, Rodrigues' formula."""
    k = np.array(axis) / np.linalg.norm(axis)

    def turn(v):
        return v * np.cos(2.5) + np.cross(k, v) * np.sin(2.5) + k * (k @ v) * (1 - np.cos(2.5))

    assert worst(base_blocks, blocks(scene(move=turn, turn=turn), 1000)) < 1


def test_mirrored(base_blocks):
    """The picture of the scene mirrored in x is mirrored, left to right; the triangles are wound the other
    way.
    """
    mirrored = blocks(scene(move=lambda p: p * [-1, 1, 1]), 1000, flip=True)
    assert worst(base_blocks, mirrored) < 1
    assert worst(base_blocks, mirrored[:, :, ::-1]) > 1


def test_quad_split_into_more_triangles(base_blocks):
    """Into the two of the other diagonal, and into eight: also sample by sample, but where a rounding turns a
    path.

    Points differ by a few ulp; a path of 4096 that meets an edge may turn, so all pixels but one in 50 agree
    to 1e-4.
    """
    for corners, pieces in ((CORNERS[1:] + CORNERS[:1], 1), (CORNERS, 2)):
        split = scene(BASE | {"triangles": [(t, "floor") for t in quad(corners, pieces)]})
        assert np.mean(abs(shot(split) - shot(scene())) > 1e-4 * shot(scene())) <= 0.02
        assert worst(base_blocks, blocks(split, 1000)) < 1


def test_point_light_split_into_two(base_blocks):
    """One point light as two in its place, of equal and of unequal power: the pick weighs them."""
    sphere, (position, intensity, radius) = BASE["lights"]
    for share in (0.5, 0.1):
        parts = [(position, np.multiply(intensity, part), radius) for part in (share, 1 - share)]
        assert worst(base_blocks, blocks(scene(BASE | {"lights": [sphere, *parts]}), 1000)) < 1


def test_lights_add_up(base_blocks):
    """The picture is the sum of those by one light each, the other being dark; and their order does not
    matter.
    """
    first, second = BASE["lights"]
    dark = [(p, (0.0, 0.0, 0.0), r) for p, _, r in (first, second)]
    alone = [blocks(scene(BASE | {"lights": lights}), 1000) for lights in ([first, dark[1]], [dark[0], second])]
    assert worst(base_blocks, alone[0] + alone[1]) < 1
    assert worst(base_blocks, alone[0]) > 1
    assert worst(base_blocks, blocks(scene(BASE | {"lights": [second, first]}), 2000)) < 1
