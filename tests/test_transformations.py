"""A render under JAX's transformations: what works, and what is refused in one line instead of a page of JAX's own."""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np
import pytest
from jax import Array
from jax.sharding import Mesh, PartitionSpec

import jaxrt

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("quick_compilation")]

TABLE: dict[str, Any] = {
    "camera": {"position": [0, 1, 4], "target": [0, 0.5, 0], "width": 16, "height": 12},
    "materials": {"white": {"type": "diffuse", "albedo": [0.8, 0.8, 0.8]}},
    "spheres": [{"center": [0, 0.5, 0], "radius": 0.5, "material": "white"}],
    "lights": [{"position": [1, 3, 2], "intensity": 10}],
}
LIGHT = np.float32([[1, 3, 2]])
BOTH = np.stack([LIGHT, LIGHT + np.float32(0.5)])


@pytest.fixture(scope="module", params=[1, 2])
def total(request: pytest.FixtureRequest) -> Callable[[Array], Array]:
    """The picture's sum by its light's place; the scene lies on one device or on two."""
    with jax.default_device(None if request.param == 2 else jax.devices()[0]):
        scene = jaxrt.build(TABLE)
    assert len(scene.camera.position.devices()) == request.param

    def sum_of(light: Array) -> Array:
        changed = jaxrt.with_parameters(scene, {"lights.position": light})
        return jaxrt.render(changed, 0, spp=1, max_depth=1).sum()

    return sum_of


@pytest.mark.parametrize("total", [1], indirect=True)
def test_s9_reverse_mode_over_a_derivative_is_refused_in_words(total: Callable[[Array], Array]) -> None:
    refused = {
        "grad of jvp": lambda x: jax.grad(lambda x: jax.jvp(total, (x,), (LIGHT,))[1])(x),
        "jacrev of grad": lambda x: jax.jacrev(jax.grad(total))(x),
    }
    for f in refused.values():
        with pytest.raises(ValueError, match=r"^render: second derivatives .*write jax\.hessian\(f\) or .*derivative"):
            f(LIGHT)
    assert np.asarray(jax.jacfwd(jax.grad(total))(LIGHT)).any()


def test_s9_inside_of_shard_map_each_device_draws_for_itself(total: Callable[[Array], Array]) -> None:
    mesh, spec = Mesh(np.array(jax.devices()), ("d",)), PartitionSpec("d")

    def spread(check: bool) -> Callable[[Array], Array]:
        one = jax.shard_map(lambda x: total(x[0])[None], mesh=mesh, in_specs=spec, out_specs=spec, check_vma=check)
        return jax.jit(one)

    expected = [float(total(x)) for x in BOTH]
    np.testing.assert_allclose(spread(False)(BOTH), expected, rtol=1e-6)
    np.testing.assert_allclose(jax.pmap(total)(BOTH), expected, rtol=1e-6)
    with pytest.raises(ValueError, match=r"^render: .*pass check_vma=False"):
        spread(True)(BOTH)


def test_s9_a_scene_is_drawn_on_the_device_where_it_was_put() -> None:
    scene = jaxrt.build(TABLE)
    first, second = jax.devices()[:2]
    picture = jaxrt.render(scene, 0, spp=1, max_depth=1)
    there = jaxrt.render(jax.device_put(scene, second), 0, spp=1, max_depth=1)
    assert there.devices() == {second} and picture.devices() == {first}
    np.testing.assert_array_equal(there, picture)
    assert jaxrt.render(scene, 0, spp=1, max_depth=1, devices=[second]).devices() == {second}


@pytest.mark.parametrize("name", ["spp", "max_depth", "boundary_samples", "gradient_spp"])
def test_s9_counts_are_numbers(name: str) -> None:
    scene = jaxrt.build(TABLE)

    def draw(n: Any) -> Array:
        return jaxrt.render(scene, 0, **({"spp": 1, "max_depth": 1} | {name: n}))

    with pytest.raises(ValueError, match=rf"^render: {name} is traced, .*: pass a number"):
        jax.jit(draw)(2)
    for wrong in (1.5, "2", -1, None if name == "boundary_samples" else 0):
        with pytest.raises(ValueError, match=rf"^render: {name} is .*, want "):
            draw(wrong)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tile": (0, 8)}, r"^render: width of tile is 0, want at least 1$"),
        ({"tile": (8,)}, r"^render: tile is \(8,\), want width and height$"),
        ({"devices": "cpu"}, r'^render: devices is "cpu", want some of jax\.devices\(\)$'),
        ({"sampler": 3}, r"^render: unknown sampler 3 "),
    ],
    ids=str,
)
def test_s9_options_are_refused_in_one_line(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        jaxrt.render(jaxrt.build(TABLE), 0, **options)
