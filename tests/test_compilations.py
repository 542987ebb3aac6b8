"""What compiles anew, and what does not: compilations are counted, not timed."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh
from jax.extend import core

import jaxrt

pytestmark = pytest.mark.quick

_count = 0


def _listen(event: str, seconds: float, **_: Any) -> None:
    global _count
    _count += event == "/jax/core/compile/backend_compile_duration"


jax.monitoring.register_event_duration_secs_listener(_listen)


@contextmanager
def compilations(expected: int) -> Iterator[None]:
    """Assert how many programs, however small, are compiled inside."""
    before = _count
    yield
    assert _count - before == expected


WHITE = {"type": "diffuse", "albedo": [0.8, 0.8, 0.8]}


def table(**changes: Any) -> dict[str, Any]:
    """Return a scene that its parts can be changed of."""
    scene = {
        "camera": {"position": [0, 1, 4], "target": [0, 0.5, 0], "width": 16, "height": 12},
        "materials": {"white": WHITE},
        "spheres": [{"center": [0, 0.5, 0], "radius": 0.5, "material": "white"}],
        "lights": [{"position": [1, 3, 2], "intensity": 10}],
    }
    return scene | changes


def draw(scene: dict[str, Any], **options: Any) -> np.ndarray:
    return np.asarray(jaxrt.render(jaxrt.build(scene), **({"key": 0, "spp": 2, "max_depth": 1} | options)))


@pytest.fixture(scope="module")
def drawn() -> np.ndarray:
    """The picture of the plain scene, whose program is compiled by now."""
    return draw(table())


def camera(**changes: Any) -> dict[str, Any]:
    return table()["camera"] | changes


SAME = {
    "another seed": (table(), {"key": 5}),
    "more samples": (table(), {"spp": 3}),
    "another albedo": (table(materials={"white": WHITE | {"albedo": [0.1, 0.2, 0.3]}}), {}),
    "another fov": (table(camera=camera(fov=30)), {}),
    "a renamed material": (
        table(materials={"snow": WHITE}, spheres=[{"center": [0, 0.5, 0], "radius": 0.5, "material": "snow"}]),
        {},
    ),
    "an unused material of another kind": (table(materials={"m": {"type": "glass", "ior": 1.5}, "white": WHITE}), {}),
    "an unused material of the same kind": (table(materials={"other": WHITE, "white": WHITE}), {}),
}


@pytest.mark.parametrize("name", SAME)
def test_values_compile_nothing(drawn: np.ndarray, name: str) -> None:
    scene, options = SAME[name]
    built = jaxrt.build(scene)
    with compilations(0):
        picture = np.asarray(jaxrt.render(built, **({"key": 0, "spp": 2, "max_depth": 1} | options)))
    assert picture.any() and (np.array_equal(picture, drawn) == ("material" in name))


def test_twelve_frames_of_a_moving_camera_compile_once(drawn: np.ndarray) -> None:
    frames = [jaxrt.build(table(camera=camera(position=[np.sin(a), 1, 4 * np.cos(a)]))) for a in np.linspace(0, 6, 12)]
    with compilations(0):
        pictures = [np.asarray(jaxrt.render(frame, 0, spp=2, max_depth=1)) for frame in frames]
    assert all(not np.array_equal(a, b) for a, b in zip(pictures, pictures[1:], strict=False))


def far(x: float) -> dict[str, Any]:
    """Return the scene a million units away, with its camera at x."""
    return table(
        camera=camera(position=[1e6 + x, 1, 4], target=[1e6, 0.5, 0]),
        spheres=[{"center": [1e6, 0.5, 0], "radius": 0.5, "material": "white"}],
        lights=[{"position": [1e6 + 1, 3, 2], "intensity": 10}],
    )


def test_a_far_scene_whose_camera_moves_compiles_nothing(drawn: np.ndarray) -> None:
    scenes = [jaxrt.build(far(x)) for x in (0, 0.5, 6)]
    with compilations(0):
        first, *others = (np.asarray(jaxrt.render(scene, 0, spp=2, max_depth=1)) for scene in scenes)
    np.testing.assert_allclose(first, drawn, rtol=2e-3, atol=1e-3)
    assert not any(np.array_equal(first, other) for other in others)


MESHES = {
    "sphere": trimesh.creation.icosphere(2),
    "torus": trimesh.creation.torus(1, 0.3, 24, 12),
    "rod": trimesh.creation.cylinder(0.05, 3, 40),
    "bent": trimesh.creation.annulus(0.5, 1, 0.4, 64),
}


@pytest.mark.parametrize("name", MESHES)
def test_a_mesh_turned_in_the_file_keeps_its_structure(name: str) -> None:
    mesh = {"vertices": MESHES[name].vertices, "faces": MESHES[name].faces, "material": "white"}
    shapes = {
        tuple((leaf.shape, leaf.dtype) for leaf in leaves) + (structure,)
        for turn in np.random.default_rng(0).uniform(0, 360, (16, 3)).tolist() + [[0, 0, 0], [90, 0, 0]]
        for leaves, structure in [jax.tree.flatten(jaxrt.build(table(meshes=[mesh | {"rotate": turn}])))]
    }
    assert len(shapes) == 1


@pytest.mark.parametrize("devices", [1, 2])
def test_a_training_loop_compiles_once(devices: int) -> None:
    with jax.default_device(None if devices == 2 else jax.devices()[0]):
        scene = jaxrt.build(table())

        @jax.jit
        def step(albedo: jax.Array) -> jax.Array:
            def loss(albedo: jax.Array) -> jax.Array:
                picture = jaxrt.render(
                    jaxrt.with_parameters(scene, {"materials.albedo": albedo}), 0, spp=1, max_depth=1
                )
                return jnp.mean(picture**2)

            return albedo - 0.1 * jax.grad(loss)(albedo)

        albedo = jaxrt.parameters(scene)["materials.albedo"]
        with compilations(1):
            for _ in range(4):
                albedo = step(albedo)
    assert len(albedo.devices()) == devices and step._cache_size() == 1 and (albedo < 0.8).all()


def readers(jaxpr: core.Jaxpr, constants: set[Any]) -> Iterator[str]:
    """Yield the operations that read the constants (variables of a program) themselves, not what a barrier returns."""
    for equation in jaxpr.eqns:
        read = [isinstance(x, core.Var) and x in constants for x in equation.invars]
        if not any(read) or equation.primitive.name == "optimization_barrier":
            continue
        inner = [getattr(x, "jaxpr", x) for x in core.jaxprs_in_params(equation.params)]
        if len(inner) == 1 and len(inner[0].invars) == len(read):
            yield from readers(inner[0], {x for x, is_read in zip(inner[0].invars, read, strict=True) if is_read})
        else:
            yield equation.primitive.name


def test_s4_a_scene_that_is_closed_over_is_no_constant() -> None:
    """XLA would compute with it while it compiles: with the tree of a mesh that takes longer than compiling."""
    mesh = {"vertices": MESHES["torus"].vertices, "faces": MESHES["torus"].faces, "material": "white"}
    scene = jaxrt.build(table(meshes=[mesh]))

    def loss(light: jax.Array) -> jax.Array:
        moved = replace(scene, lights=replace(scene.lights, position=light))
        return jaxrt.render(moved, 0, spp=1, max_depth=1, boundary_samples=64).sum()

    def naive(light: jax.Array) -> jax.Array:
        return light.sum() + jnp.sort(scene.triangles.vertices[:, 0]).sum()

    for f, expected in ((jax.value_and_grad(loss), set()), (naive, {"slice"})):
        program = jax.make_jaxpr(f)(scene.lights.position)
        large = {x for x, value in zip(program.jaxpr.constvars, program.consts, strict=True) if value.size > 100}
        assert large and {*readers(program.jaxpr, large)} == expected


def test_gradients_outside_of_jit_compile_once() -> None:
    scene = jaxrt.build(table())

    def loss(values: dict[str, jax.Array]) -> jax.Array:
        return jaxrt.render(jaxrt.with_parameters(scene, values), 0, spp=1, max_depth=1).sum()

    values = {"lights.position": jaxrt.parameters(scene)["lights.position"]}
    moved = {"lights.position": 1.1 * values["lights.position"]}
    jax.grad(loss)(values)
    with compilations(0):
        slope = jax.grad(loss)(moved)
    assert np.asarray(slope["lights.position"]).any()


def test_a_new_size_is_a_new_program(drawn: np.ndarray) -> None:
    scene = jaxrt.build(table(camera=camera(width=17)))
    jaxrt.render(scene, 0, spp=2, max_depth=1)
    with compilations(0):
        jaxrt.render(scene, 1, spp=2, max_depth=1)


def test_materials_that_nothing_is_made_of_keep_their_rows() -> None:
    materials = {"a": WHITE, "m": {"type": "mirror", "albedo": [0.5, 0.6, 0.7]}, "white": WHITE} | {
        "g": {"type": "glass", "ior": 1.3}
    }
    scene = jaxrt.build(table(materials=materials))
    values = {name: value for name, value in jaxrt.parameters(scene).items() if name.startswith("materials")}
    np.testing.assert_allclose(values["materials.albedo"], [[0.8] * 3, [0.5, 0.6, 0.7], [0.8] * 3])
    np.testing.assert_allclose(values["materials.ior"], [1.3])
    assert scene.materials.mirror is None and scene.materials.glass is None

    def mean(values: dict[str, jax.Array]) -> jax.Array:
        return jaxrt.render(jaxrt.with_parameters(scene, values), 0, spp=2, max_depth=1).mean()

    slopes = jax.grad(mean)(values)
    assert np.asarray(slopes["materials.albedo"][2]).all()
    assert not np.asarray(slopes["materials.albedo"][:2]).any() and not np.asarray(slopes["materials.ior"]).any()
    changed = jaxrt.with_parameters(scene, jax.tree.map(lambda x: x / 2, values))
    again = jaxrt.parameters(changed)
    for name, value in values.items():
        np.testing.assert_allclose(again[name], value / 2)
