"""Filters: places are drawn as weights say, edges blur as their sums say, and derivatives follow, borders included."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrt
from jaxrt.filters import NAMES, filter_of
from jaxrt.transport.film import Plan

pytestmark = pytest.mark.usefixtures("quick_compilation")

WIDE = [name for name in NAMES if name != "box"]
# A lit wall beside nothing: its end is seen at column EDGE of a picture whose pixels are one unit wide
EDGE, SIZE = 4.3, 8


def half_plane(**render: object) -> dict[str, object]:
    side = EDGE - SIZE / 2
    corners = [[-90, -90, 0], [side, -90, 0], [side, 90, 0], [-90, 90, 0]]
    return {
        "camera": {"type": "orthographic", "position": [0, 0, 5], "tall": 4, "width": SIZE, "height": 4},
        "materials": {"white": {"type": "diffuse", "albedo": [1, 1, 1]}},
        "meshes": [{"name": "wall", "vertices": corners, "faces": [[0, 1, 2], [0, 2, 3]], "material": "white"}],
        "environment": {"radiance": [0, 0, 0]},
        "lights": [{"position": [0, 0, 500], "intensity": 500.0**2 * np.pi}],
        "render": {"spp": 64, "max_depth": 1, **render},
    }


@pytest.mark.parametrize("name", WIDE)
def test_places_are_drawn_as_weights_say(name: str) -> None:
    """The density of places is the weight, whose whole is 1: by its sums up to each place."""
    filter = filter_of(name, 2.5)
    assert filter is not None and filter.margin == 1
    u = (np.arange(4096) + 0.5) / 4096
    places = np.asarray(jax.vmap(filter.place)(jnp.asarray(u, jnp.float32)), float)
    x = np.linspace(-1.25, 1.25, 20001)
    weights = np.asarray(filter.weight(jnp.asarray(x, jnp.float32)), float)
    below = np.concatenate([[0], np.cumsum((weights[1:] + weights[:-1]) / 2) * (x[1] - x[0])])
    assert abs(below[-1] - 1) < 1e-5
    np.testing.assert_allclose(np.interp(places, x, below), u, atol=2e-5)
    assert np.all(np.diff(places) > 0)
    np.testing.assert_array_equal(filter.weight(jnp.asarray([-1.26, 1.26])), 0)
    ends = filter.place(jnp.asarray([0, 1 - 2.0**-24], jnp.float32))
    assert np.all(np.abs(ends) <= 1.25) and np.all(np.isfinite(ends))


@pytest.mark.parametrize("name", WIDE)
def test_the_end_of_a_half_plane_is_the_filters_sum(name: str) -> None:
    """Pixel j shows the share of its filter to the left of the edge; a sample in 64 is what a stratum may be off by."""
    scene = jaxrt.build(half_plane(filter=name, filter_width=3.0))
    picture = np.asarray(jaxrt.render(scene, 0, outputs=("alpha",))["alpha"])
    filter = filter_of(name, 3.0)
    assert filter is not None
    x = np.linspace(-1.5, 1.5, 6001)
    below = np.cumsum(np.asarray(filter.weight(jnp.asarray(x, jnp.float32)), float)) * (x[1] - x[0])
    wanted = np.interp(EDGE - (np.arange(SIZE) + 0.5), x, below, left=0, right=1)
    assert np.count_nonzero((wanted > 0.01) & (wanted < 0.99)) == 2
    np.testing.assert_allclose(picture, np.broadcast_to(wanted, picture.shape), atol=2 / 64)
    np.testing.assert_allclose(picture.mean(0), wanted, atol=1 / 64)


@pytest.mark.parametrize("name", [WIDE[0], *(pytest.param(name, marks=pytest.mark.slow) for name in WIDE[1:])])
def test_edges_count_in_all_pixels_around(name: str) -> None:
    """What moves is the filter's weight there: also of an edge that is seen in the margin alone."""
    scene = jaxrt.build(half_plane(filter=name, filter_width=3.0))
    filter = filter_of(name, 3.0)
    assert filter is not None
    start = jaxrt.parameters(scene, "meshes.vertices[wall]")

    @jax.jit
    def slope(shift: jax.Array) -> jax.Array:
        def alpha(shift: jax.Array) -> jax.Array:
            moved = jaxrt.with_parameters(scene, {"meshes.vertices[wall]": start.at[:, 0].add(shift)})
            return jaxrt.render(moved, 0, spp=1, outputs=("alpha",), boundary_samples=8192)["alpha"]

        return jax.jvp(alpha, (shift,), (jnp.ones(()),))[1]

    # Beyond the border by .2 pixels the last column still sees it
    for shift in (0.0, SIZE + 0.2 - EDGE):
        found = np.asarray(slope(jnp.float32(shift)), float).mean(0)
        wanted = np.asarray(filter.weight(jnp.asarray(EDGE + shift - (np.arange(SIZE) + 0.5), jnp.float32)), float)
        assert wanted.max() > 0.1
        assert np.linalg.norm(found - wanted) <= 0.03 * np.linalg.norm(wanted)


def test_a_box_is_no_code_and_others_are_named() -> None:
    """Who asks for no filter has the program there was before; scene and call say which, and refuse what is none."""
    described = half_plane()
    plain, named = jaxrt.build(described), jaxrt.build(half_plane(filter="gaussian", filter_width=2))
    plan = jaxrt.render.__globals__["prepare"]
    assert plan(plain, 0, 0, 1, 1)[2].filter is None and Plan._field_defaults["filter"] is None
    assert plan(named, 0, 0, 1, 1)[2].filter == filter_of("gaussian", 2)
    assert plan(named, 0, 0, 1, 1, filter="box")[2].filter is None
    assert plan(named, 0, 0, 1, 1, filter="blackman-harris")[2].filter == filter_of("blackman-harris", None)
    assert plan(named, 0, 0, 1, 1, filter_width=4)[2].filter == filter_of("gaussian", 4)
    for more, message in [
        ({"filter": "gausian"}, r'unknown filter "gausian" \(did you mean "gaussian"\?\)'),
        ({"filter": "gaussian", "filter_width": 0}, r"filter_width: 0(\.0)? is no number of pixels above 0"),
        ({"filter_width": 2}, "filter_width: a box is one pixel wide"),
    ]:
        with pytest.raises(jaxrt.SceneError, match=message):
            jaxrt.build(half_plane(**more))
        with pytest.raises(ValueError, match=message):
            jaxrt.render(plain, 0, **more)


def test_windows_and_lists_are_parts_of_the_whole() -> None:
    """With a filter as without: a window at multiples of the tile is the whole's part to the bit."""
    scene = jaxrt.build(half_plane(filter="blackman-harris"))
    whole = jaxrt.render(scene, 0, spp=4, outputs=("alpha",), tile=(4, 2))["alpha"]
    part = jaxrt.render(scene, 0, spp=4, outputs=("alpha",), tile=(4, 2), window=(4, 2, 4, 2))["alpha"]
    np.testing.assert_array_equal(part, whole[2:, 4:])
    pixels = jaxrt.render(scene, 0, spp=4, outputs=("alpha",), pixels=[[3, 1], [4, 2]])["alpha"]
    np.testing.assert_allclose(pixels, [whole[1, 3], whole[2, 4]], atol=1e-6)
