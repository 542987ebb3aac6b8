"""Materials that are lit and scatter alike: their code's answers agree, and their pictures are those of closed forms.

Three programs: a picture of a scene with both kinds of `tests.own_kinds`, one with diffuse in the place of one, and a
derivative.
"""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrt
from jaxrt.boundary.shadows import _toward_camera
from jaxrt.cameras import view_of
from jaxrt.core.records import SurfacePoint
from jaxrt.description.kinds import MATERIALS
from jaxrt.kinds import Albedo, material
from jaxrt.materials import Materials, scatter
from jaxrt.materials.conductor import Conductor
from jaxrt.materials.diffuse import Diffuse
from jaxrt.materials.glass import Glass
from jaxrt.materials.plastic import Plastic
from jaxrt.programs.key import code_of_kinds
from jaxrt.render import prepare
from tests.own_kinds import Chalk, Phong

pytestmark = pytest.mark.usefixtures("quick_compilation")
N = 200_000
LAMP = {"position": [2, 4, 2], "intensity": 20, "radius": 0.7}
SURFACE = SurfacePoint(jnp.zeros(3), jnp.asarray([0.0, 0.0, 1.0]), jnp.zeros(()), jnp.int32(0))
KINDS = {
    "chalk": Chalk(jnp.asarray([0.8, 0.5, 0.2])),
    "phong": Phong(jnp.asarray([0.8, 0.5, 0.2]), jnp.asarray(5.0)),
    "conductor": Conductor(jnp.asarray([0.8, 0.5, 0.2]), jnp.asarray(0.5), jnp.ones(())),
    "plastic": Plastic(jnp.asarray([0.8, 0.5, 0.2]), jnp.asarray(0.5), jnp.asarray(1.5)),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("wo", [[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.28, 0.6, -0.7493998]])
def test_sample_and_evaluate_agree(kind: str, wo: list[float]) -> None:
    """weight · pdf = f cosθ for each direction drawn; densities are 1 over all directions within 4σ."""
    one, toward = KINDS[kind], jnp.asarray(wo)
    u = jax.random.uniform(jax.random.key(1), (N, 2))
    wi, weight = jax.vmap(lambda u: one.sample(SURFACE, toward, (u[0], u[1])))(u)
    value, pdf = jax.vmap(lambda wi: one.evaluate(SURFACE, toward, wi))(wi)
    np.testing.assert_allclose(weight * pdf[:, None], value, rtol=2e-3, atol=1e-5)
    even = np.random.default_rng(2).normal(size=(N, 3))
    even = jnp.asarray(even / np.linalg.norm(even, axis=1, keepdims=True), jnp.float32)
    density = 4 * np.pi * np.asarray(jax.vmap(lambda wi: one.evaluate(SURFACE, toward, wi))(even)[1], float)
    assert abs(density.mean() - 1) < 4 * density.std() / np.sqrt(N)


def test_kinds_are_numbered_by_how_they_reflect() -> None:
    rows = {name: jax.tree.map(lambda leaf: leaf[None], KINDS[name]) for name in ("phong", "chalk")}
    materials = Materials.of(**rows, glass=Glass(jnp.ones(2)), diffuse=Diffuse(jnp.ones((3, 3))))
    assert [type(kind) for kind in materials.kinds] == [Diffuse, Glass, Chalk, Phong]
    assert materials.ends == (3, 5, 7) and materials.are_glossy and materials.are_lit and materials.are_delta
    assert materials.mirror is None and not hasattr(materials, "miror")


def test_light_of_moving_shadows_is_reflected_as_by_diffuse() -> None:
    """What a shadow's edge sends to the camera: albedo/π of what arrives."""
    rows = Materials.of(chalk=Chalk(jnp.asarray([[0.8, 0.5, 0.2]])))
    frame = view_of(jaxrt.build({"camera": {"position": [1, 2, 3]}, "lights": [LAMP]}).camera)
    tables = SimpleNamespace(materials=rows, camera=frame)
    wo, arriving, share = jnp.asarray([0.6, 0.0, 0.8]), jnp.asarray([1.0, 2.0, 3.0]), jnp.asarray(0.7)
    scattering = scatter(rows, SURFACE, wo, (share, share))
    sent = _toward_camera(tables, SURFACE, wo, scattering, arriving, share)
    np.testing.assert_allclose(sent, arriving * jnp.asarray([0.8, 0.5, 0.2]) * (0.7 / np.pi), rtol=1e-6)


def scene_with(floor: str) -> jaxrt.Scene:
    """A glossy ball on a floor under a sphere light and a sky."""
    return jaxrt.build(
        {
            "camera": {"position": [0, 2, 5], "target": [0, 0.8, 0], "width": 12, "height": 10, "fov": 50},
            "render": {"max_depth": 2},
            "materials": {
                "ball": {"type": "phong", "albedo": [0.8, 0.5, 0.3], "exponent": 8},
                "floor": {"type": floor, "albedo": [0.7, 0.6, 0.5]},
            },
            "spheres": [{"center": [0, 1, 0], "radius": 1, "material": "ball"}],
            "triangles": [{"vertices": [[-9, 0, 9], [9, 0, 9], [0, 0, -9]], "material": "floor"}],
            "lights": [LAMP],
            "environment": {"radiance": [0.1, 0.2, 0.3]},
        }
    )


@pytest.fixture(scope="module")
def scene() -> jaxrt.Scene:
    return scene_with("chalk")


def picture(scene: jaxrt.Scene, key: int = 0, spp: int = 256) -> np.ndarray:
    return np.asarray(jaxrt.render(scene, key, spp=spp, devices=jax.devices()[:1]), float)


def test_chalk_is_diffuse(scene: jaxrt.Scene) -> None:
    """The two ways to find a light, weighed, bring what light samples alone do: 4σ of the mean, and of each pixel."""
    seeds = range(4)
    chalk, diffuse = (np.stack([picture(s, seed) for seed in seeds]) for s in (scene, scene_with("diffuse")))
    difference = chalk.mean((1, 2)) - diffuse.mean((1, 2))
    assert np.all(np.abs(difference.mean(0)) < 4 * difference.std(0, ddof=1) / 2 + 1e-5)
    np.testing.assert_allclose(chalk.mean(0), diffuse.mean(0), atol=0.02)


def test_white_furnace(scene: jaxrt.Scene) -> None:
    """A ball seen along its normal reflects its albedo of a sky, within 4σ of the seeds."""
    dark = {"lights.intensity": jnp.zeros((1, 3)), "environment.radiance": jnp.ones(3)}
    away = {"camera.position": [0, 1, 9.0], "camera.target": [0, 1, 0.0], "camera.fov": 0.05}
    floor = {"meshes.vertices": [[-9, -99, 9], [9, -99, 9], [0, -99, -9.0]]}
    furnace = jaxrt.with_parameters(scene, dark | away | floor)
    means = np.stack([picture(furnace, seed).mean((0, 1)) for seed in range(4)])
    error = means.std(0, ddof=1) / 2
    assert error.max() < 2e-3
    assert np.all(np.abs(means.mean(0) - [0.8, 0.5, 0.3]) < 4 * error + 1e-4)


DIRECTIONS = {
    "materials.albedo": 0.05,
    "materials.exponent": 0.5,
    "environment.radiance": 0.05,
    "lights.intensity": 1.0,
}


def test_derivatives_are_those_of_the_picture(scene: jaxrt.Scene) -> None:
    """In colours and exponent at once; central differences with the same numbers, 1 % of the whole picture's change."""
    values = jaxrt.parameters(scene)
    steps = {name: jnp.full_like(values[name], step) for name, step in DIRECTIONS.items()}

    def drawn(t: jax.Array) -> jax.Array:
        moved = {name: values[name] + t * step for name, step in steps.items()}
        return jaxrt.render(jaxrt.with_parameters(scene, moved), 0, spp=256, devices=jax.devices()[:1])

    slope = np.asarray(jax.jvp(drawn, [jnp.zeros(())], [jnp.ones(())])[1], float).mean((0, 1))
    near = [np.asarray(drawn(jnp.asarray(t)), float).mean((0, 1)) for t in (-0.5, 0.5)]
    np.testing.assert_allclose(slope, near[1] - near[0], rtol=0.01)


def test_kept_programs_are_found_by_what_own_code_computes() -> None:
    """The same class again is the same program; with another constant it is another; ours need no look."""

    def code(factor: float) -> str:
        @material
        class Glow:
            albedo: Albedo

            def sample(self, surface, wo, u):
                return surface.facing(wo), factor * self.albedo

            def evaluate(self, surface, wo, wi):
                return 0 * self.albedo, jnp.zeros(())

        ball = {"center": [0, 0, 0], "radius": 1, "material": "a"}
        table = {"type": "glow", "albedo": [0.5, 0.5, 0.5]}
        made = {"camera": {"position": [0, 0, 3]}, "materials": {"a": table}, "spheres": [ball], "lights": [LAMP]}
        scene, _, plan = prepare(jaxrt.build(made), 0, 0, 1, 1, max_depth=1, devices=jax.devices()[:1])
        return code_of_kinds(scene, plan)

    assert code(0.5) == code(0.5) != code(0.25)
    MATERIALS.kinds.pop("glow")
    ours = jaxrt.build({"camera": {"position": [0, 0, 3]}, "lights": [LAMP]})
    assert code_of_kinds(ours, prepare(ours, 0, 0, 1, 1)[2]) == ""
