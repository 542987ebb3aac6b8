"""Pictures: what they depend on, what they do not, and what they cost in memory."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array
from numpy.typing import NDArray

import jaxrt
from jaxrt.render import render_sum

pytestmark = pytest.mark.usefixtures("quick_compilation")
SIZE = {"width": 40, "height": 24}  # not a multiple of the packets


@pytest.fixture(scope="module")
def small_room(room: jaxrt.Scene) -> jaxrt.Scene:
    return dataclasses.replace(room, camera=dataclasses.replace(room.camera, **SIZE))


def draw(scene: jaxrt.Scene, **options: Any) -> NDArray[np.float32]:
    return np.asarray(jaxrt.render(scene, 3, **({"spp": 4, "max_depth": 3} | options)))


@pytest.fixture
def picture(quick_compilation: None, small_room: jaxrt.Scene) -> NDArray[np.float32]:
    return draw(small_room)


def same_but_for_flips(a: NDArray[np.float32], b: NDArray[np.float32]) -> None:
    """Equal random numbers: equal to 1e-5, but for 1e-4 of the pixels, where a rounding makes another thing hit."""
    different = np.any(np.abs(a - b) > 1e-5 * (np.abs(a) + 1e-3), axis=-1)
    assert np.count_nonzero(different) <= max(1, 1e-4 * different.size)


def test_a_picture(picture: NDArray[np.float32]) -> None:
    assert picture.shape == (24, 40, 3) and picture.dtype == np.float32
    assert np.isfinite(picture).all() and picture.min() >= 0 and picture.mean() > 0.01


def test_pure(small_room: jaxrt.Scene, picture: NDArray[np.float32]) -> None:
    np.testing.assert_array_equal(draw(small_room), picture)
    assert not np.array_equal(np.asarray(jaxrt.render(small_room, 4, spp=4, max_depth=3)), picture)


@pytest.mark.parametrize("tile", [(8, 4), (16, 8), (5, 3)])
def test_packets_do_not_matter(small_room: jaxrt.Scene, picture: NDArray[np.float32], tile: Any) -> None:
    same_but_for_flips(draw(small_room, tile=tile), picture)


def test_wide_packets_do_not_matter(small_room: jaxrt.Scene, picture: NDArray[np.float32]) -> None:
    """The accelerators' setting: one packet of more lanes than a native kernel takes."""
    same_but_for_flips(draw(small_room, tile=(40, 28)), picture)


def test_devices_do_not_matter(small_room: jaxrt.Scene, picture: NDArray[np.float32]) -> None:
    assert len(jax.devices()) == 2
    same_but_for_flips(draw(small_room, devices=jax.devices()), picture)


def test_unrolling_does_not_matter(small_room: jaxrt.Scene, picture: NDArray[np.float32]) -> None:
    same_but_for_flips(draw(small_room, unroll=True), picture)


@pytest.mark.parametrize("sampler", ["sobol", "stratified", "independent"])
def test_chunks_do_not_matter(small_room: jaxrt.Scene, sampler: str) -> None:
    whole = draw(small_room, sampler=sampler, spp=7)
    total = np.zeros(whole.shape)
    for first, count in ((0, 1), (1, 4), (5, 0), (5, 2)):
        total += np.asarray(render_sum(small_room, 3, first, count, spp=7, max_depth=3, sampler=sampler))
    np.testing.assert_allclose(total / 7, whole, rtol=1e-6, atol=1e-7)


def test_memory_does_not_grow_with_samples(small_room: jaxrt.Scene) -> None:
    def bytes_for(spp: int) -> int:
        def f(scene: jaxrt.Scene) -> Array:
            return jaxrt.render(scene, 0, spp=spp, max_depth=2)

        return jax.jit(f).lower(small_room).compile().memory_analysis().temp_size_in_bytes

    assert bytes_for(1024) == bytes_for(16)


def test_jit_and_vmap(small_room: jaxrt.Scene) -> None:
    scene = dataclasses.replace(small_room, camera=dataclasses.replace(small_room.camera, width=16, height=8))

    def lit_from(x: Array) -> Array:
        moved = jaxrt.with_parameters(scene, {"lights.position": x})
        return jaxrt.render(moved, 3, spp=2, max_depth=1, devices=jax.devices()[:1])

    places = jnp.array([[[-10.0, 25, 20]], [[10.0, 25, 20]], [[0.0, 20, 0]]])
    many = jax.jit(jax.vmap(lit_from))(places)
    for place, picture in zip(places, many, strict=True):
        same_but_for_flips(np.asarray(lit_from(place)), np.asarray(picture))


def test_defaults_are_the_scenes_own(small_room: jaxrt.Scene, picture: NDArray[np.float32]) -> None:
    defaults = dataclasses.replace(small_room.defaults) if dataclasses.is_dataclass(small_room.defaults) else None
    changed = defaults or small_room.defaults.model_copy(update={"spp": 4, "max_depth": 3})
    scene = dataclasses.replace(small_room, defaults=changed)
    np.testing.assert_array_equal(np.asarray(jaxrt.render(scene, 3)), picture)


def test_s5_the_size_may_be_asked_for(room: jaxrt.Scene, picture: NDArray[np.float32]) -> None:
    np.testing.assert_array_equal(draw(room, **SIZE), picture)
    for size, message in (
        ({"width": 0}, "^render: width is 0, want at least 1$"),
        ({"height": 2.5}, "^render: height is 2.5, want a whole number$"),
        (
            {"width": 10**7, "height": 10**7},
            r"^render: camera: image 10000000x10000000 needs .+: lower width or height$",
        ),
    ):
        with pytest.raises(ValueError, match=message):
            jaxrt.render(room, 0, spp=1, **size)


def test_float64_scene(small_room: jaxrt.Scene) -> None:
    with jax.enable_x64(True):
        scene = jaxrt.build(
            {
                "camera": {"position": [0, 0, 55], "width": 8, "height": 8},
                "materials": {"white": {"type": "diffuse", "albedo": [0.8, 0.8, 0.8]}},
                "spheres": [{"center": [0, 0, 0], "radius": 10, "material": "white"}],
                "lights": [{"position": [-10, 20, 40], "intensity": 3000}],
            },
            dtype=jnp.float64,
        )
        image = jaxrt.render(scene, 0, spp=2, max_depth=2)
        assert image.dtype == jnp.float64 and bool(jnp.isfinite(image).all())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"spp": 0}, "spp is 0, want at least 1"),
        ({"max_depth": 0}, "max_depth is 0, want at least 1"),
        ({"samples": (0, 0)}, "samples is 0, want at least 1"),
        ({"samples": 4}, "samples is 4: pass the first and how many there are in all"),
        ({"spp": 4, "samples": (6, 8)}, r"samples is \(6, 8\) and spp 4: there are not so many from 6 on"),
        ({"sampler": "sobel"}, "unknown sampler.*sobol"),
    ],
)
def test_errors_name_the_culprit(small_room: jaxrt.Scene, options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        jaxrt.render(small_room, 0, **options)
