"""Windows, lists of pixels, batches of cameras, and what of these cannot be drawn."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrt
from jaxrt.render import draw_sum, render_sum

WIDTH, HEIGHT, TILE = 48, 16, (16, 8)
SCENE = {
    "camera": dict(position=[0, 0, 4], target=[0, 0, 0], fov=40, width=WIDTH, height=HEIGHT),
    "materials": {"white": {"type": "diffuse", "albedo": [0.8, 0.6, 0.4]}},
    "spheres": [{"center": [0.2, 0, 0], "radius": 1, "material": "white"}],
    "environment": {"radiance": [0.2, 0.3, 0.4]},
    "lights": [{"position": [2, 3, 4], "intensity": [30, 30, 30]}],
}
HOW = dict(spp=8, max_depth=1, tile=TILE)


@pytest.fixture(scope="module")
def scene():
    return jaxrt.build(SCENE)


@pytest.fixture(scope="module")
def whole(scene):
    return np.asarray(jaxrt.render(scene, 3, **HOW))


def test_windows_at_multiples_of_the_tile_are_the_whole_to_the_bit(scene, whole):
    before = draw_sum._cache_size()
    for y in range(0, HEIGHT, TILE[1]):
        for x in range(0, WIDTH, TILE[0]):
            window = jaxrt.render(scene, 3, **HOW, window=(x, y, *TILE))
            np.testing.assert_array_equal(window, whole[y : y + TILE[1], x : x + TILE[0]])
    assert draw_sum._cache_size() == before + 1


@pytest.mark.parametrize("x, y", [(1, 3), (31, 7), (32, 8)])
def test_any_window_is_the_whole_to_rounding(scene, whole, x, y):
    window = jaxrt.render(scene, 3, **HOW, window=(x, y, *TILE))
    np.testing.assert_allclose(window, whole[y : y + TILE[1], x : x + TILE[0]], rtol=1e-6, atol=1e-7)


def test_a_list_of_pixels_is_these_pixels(scene, whole):
    pixels = np.random.default_rng(0).integers(0, [[WIDTH, HEIGHT]], (100, 2))
    found = jaxrt.render(scene, 3, **HOW, pixels=pixels)
    assert found.shape == (100, 3)
    np.testing.assert_allclose(found, whole[pixels[:, 1], pixels[:, 0]], rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(
        render_sum(scene, 3, 0, 8, spp=8, max_depth=1, tile=TILE, pixels=pixels) / 8, found, rtol=1e-6
    )


BATCH = 96  # pixels


@partial(jax.jit, static_argnames="edges")
def loss(center, pixels, edges):
    moved = jaxrt.with_parameters(jaxrt.build(SCENE), {"spheres.center": center})
    how = dict(outputs=("alpha", "depth"), boundary_samples=edges)
    found = jaxrt.render(moved, 3, spp=4, max_depth=1, pixels=pixels, **how)
    return jnp.stack([jnp.sum(found["alpha"]), jnp.sum(found["depth"])])


def test_batches_of_pixels_that_share_a_picture_share_its_slope_with_edges(scene):
    """A loss of random pixels is unbiased if those of any parting add up to the whole's; its slope needs the edges."""
    pixels = np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), -1).reshape(-1, 2)
    shuffled = np.random.default_rng(1).permutation(pixels).reshape(-1, BATCH, 2)
    center = jaxrt.parameters(scene)["spheres.center"]
    slope = jax.jit(jax.jacfwd(loss), static_argnums=2)
    total = np.sum([slope(center, batch, 4096) for batch in shuffled], 0)[0, 0]
    steps = 1e-4 * np.eye(3)
    expected = [(area(center[0] + step) - area(center[0] - step)) / 2e-4 for step in steps]
    np.testing.assert_allclose(total, expected, atol=0.01 * np.linalg.norm(expected))


def area(center, radius=1.0):
    """Return the pixels that a ball covers: an ellipse, whose cone is cut by the picture's plane."""
    away = np.asarray(center, float) - [0, 0, 4]
    squared = away @ away
    sine2, cosine2 = radius**2 / squared, away[2] ** 2 / squared
    focal = HEIGHT / (2 * np.tan(np.radians(20)))
    along = np.sqrt(sine2 * (1 - sine2)) / (cosine2 - sine2)
    return np.pi * focal**2 * along * np.sqrt(sine2 / (cosine2 - sine2))


def test_a_batch_of_cameras_is_one_program(scene):
    places = jnp.asarray([[0.1 * i, 0.2, 4] for i in range(8)], jnp.float32)

    @jax.jit
    def frames(places):
        return jax.vmap(lambda p: jaxrt.render(jaxrt.with_parameters(scene, {"camera.position": p}), 3, **HOW))(places)

    found = frames(places)
    assert found.shape == (8, HEIGHT, WIDTH, 3) and frames._cache_size() == 1
    single = jaxrt.render(jaxrt.with_parameters(scene, {"camera.position": places[5]}), 3, **HOW)
    np.testing.assert_allclose(found[5], single, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize(
    "how, words",
    [
        (dict(window=(40, 0, 16, 8)), "goes past the picture's 48x16"),
        (dict(window=(0, 0, 16)), "want (x0, y0, width, height)"),
        (dict(window=16), "window is 16, want (x0, y0, width, height)"),
        (dict(window=(0, -1, 16, 8)), "y0 of window is -1"),
        (dict(pixels=[[0, 16]]), "outside of 48x16"),
        (dict(pixels=[[0.5, 1.0]]), "want whole numbers (n, 2)"),
        (dict(pixels=[[0, 0]], window=(0, 0, 1, 1)), "pass one of them"),
        (dict(outputs="depth"), 'pass names, as in ("radiance", "depth")'),
        (dict(outputs=["dept"]), 'did you mean "depth"'),
        (dict(outputs=["mask"]), "shape, material, mask[NAME])"),
        (dict(outputs=["mask[bal]"]), "mask[bal]: nothing that can be seen goes by that name"),
        (dict(outputs=[]), "is empty"),
    ],
)
def test_what_cannot_be_drawn_is_told_in_one_line(scene, how, words):
    with pytest.raises(ValueError) as caught:
        jaxrt.render(scene, 3, **how)
    assert words in str(caught.value) and "\n" not in str(caught.value)
