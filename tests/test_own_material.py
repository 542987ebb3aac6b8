"""A material that jaxrt does not have, defined here alone, from the scene file to a fit."""

import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from command import run, working_folder

import jaxrt
from jaxrt.cli.commands import summary
from jaxrt.io.scene_file import read_description
from jaxrt.kinds import Albedo, Fraction, dot, pdf_cosine_hemisphere, reflect, sample_cosine_hemisphere


@jaxrt.material
class Plush:
    """Cloth that shines towards its rims: f = albedo/π (1 + fuzz (1 − cosθ_o)(1 − cosθ_i))."""

    albedo: Albedo
    fuzz: Fraction = 0.5

    def shape(self, surface, wo, wi):
        facing = surface.facing(wo)
        return self.albedo * (1 + self.fuzz * (1 - dot(facing, wo)) * (1 - dot(facing, wi)))

    def sample(self, surface, wo, u):
        wi = sample_cosine_hemisphere(surface.facing(wo), u)
        return wi, self.shape(surface, wo, wi)

    def evaluate(self, surface, wo, wi):
        cos = jnp.maximum(dot(surface.facing(wo), wi), 0)
        return self.shape(surface, wo, wi) * (cos / jnp.pi), pdf_cosine_hemisphere(cos)


@jaxrt.material
class Dusty:
    """A mirror under dust."""

    dust: Fraction = 0.25
    is_delta = True

    def sample(self, surface, wo, u):
        return reflect(wo, surface.shading), (1 - self.dust) * jnp.ones_like(wo)


# The camera looks down between a cloth below and a ball above it, whose shadow it sees
SCENE = """
[camera]
position = [0, 4, 0]
target = [0, 0, 0]
up = [0, 0, -1]
fov = 90
width = 16
height = 16

[render]
spp = 16
max_depth = 1

[materials.cloth]
type = "plush"
albedo = [0.7, 0.5, 0.3]
fuzz = 0.4

[materials.spare]
type = "plush"
albedo = [0.1, 0.1, 0.1]

[materials.ball]
type = "dusty"

[[triangles]]
vertices = [[-90, 0, 90], [90, 0, 90], [0, 0, -180]]
material = "cloth"

[[spheres]]
center = [0, 7, 0]
radius = 1
material = "ball"

[[lights]]
position = [0.5, 12, 0.5]
intensity = 200
"""
LAMP, BALL = np.array([0.5, 12, 0.5]), np.array([0, 7.0, 0])


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    return working_folder(tmp_path, monkeypatch, SCENE)


def scene_of(folder: Path) -> jaxrt.Scene:
    return jaxrt.load_scene(folder / "ball.toml")


def closed_form(radius: float = 1.0, inside: int = 16) -> np.ndarray:
    """Return the picture (16, 16, 3) of the cloth under a ball of that radius, by `inside`² points a pixel."""
    at = (np.arange(16 * inside) + 0.5) / (2 * inside) - 4
    x = np.stack([*np.meshgrid(at, at)], -1)
    point = np.stack([x[..., 0], np.zeros_like(x[..., 0]), x[..., 1]], -1)
    toward, eye = LAMP - point, np.array([0, 4, 0]) - point
    squared = np.sum(toward**2, -1)
    cos_i, cos_o = toward[..., 1] / np.sqrt(squared), 4 / np.linalg.norm(eye, axis=-1)
    along = np.sum(toward * (BALL - point), -1) / np.sqrt(squared)
    dark = np.sum((BALL - point) ** 2, -1) - along**2 < radius**2
    light = np.where(dark, 0, 200 * cos_i / squared / np.pi * (1 + 0.4 * (1 - cos_i) * (1 - cos_o)))
    return light.reshape(16, inside, 16, inside).mean((1, 3))[..., None] * [0.7, 0.5, 0.3]


def test_parameters_have_the_rows_of_the_file(folder: Path) -> None:
    scene = scene_of(folder)
    values = jaxrt.parameters(scene)
    np.testing.assert_allclose(values["materials.fuzz"], [0.4, 0.5])
    np.testing.assert_allclose(values["materials.albedo"], [[0.7, 0.5, 0.3], [0.1] * 3], rtol=1e-6)
    np.testing.assert_allclose(values["materials.dust"], [0.25])
    changed = jaxrt.with_parameters(scene, {"materials.fuzz": jnp.asarray([0.1, 0.2])})
    assert float(changed.materials.plush.fuzz[0]) == np.float32(0.1)
    np.testing.assert_allclose(jaxrt.parameters(changed)["materials.fuzz"], [0.1, 0.2])
    assert jax.tree.structure(changed) == jax.tree.structure(scene)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("fuzz = 0.4", "fuzz = 1.4", r"materials\.cloth\.fuzz: 1\.4 is outside \[0, 1\]: choose a share within"),
        ("fuzz = 0.4", "fuz = 0.4", r'materials\.cloth: unknown key "fuz" \(did you mean "fuzz"\?\)'),
        ('"plush"\nalbedo = [0.7, 0.5, 0.3]', '"plush"', r'cloth: "albedo" is missing: add albedo = \[0'),
        ('"dusty"', '"rusty"', r'unknown material type "rusty" \(did you mean "dusty"\?\)'),
    ],
)
def test_scene_files_are_refused_as_for_our_own(folder: Path, old: str, new: str, message: str) -> None:
    (folder / "bad.toml").write_text(SCENE.replace(old, new))
    with pytest.raises(jaxrt.SceneError, match=message):
        jaxrt.load_scene(folder / "bad.toml")


def test_picture_is_that_of_the_closed_form(folder: Path) -> None:
    """By 1 % in each pixel that the shadow does not touch, and by 0.2 % in the mean."""
    image, exact, bare = np.asarray(jaxrt.render(scene_of(folder), 0, spp=256), float), closed_form(), closed_form(0)
    lit = exact[..., 0] == bare[..., 0]
    assert 0.5 < lit.mean() < 1
    np.testing.assert_allclose(image[lit], exact[lit], rtol=0.01)
    np.testing.assert_allclose(image.mean(), exact.mean(), rtol=2e-3)


def test_gradcheck_and_its_edges(folder: Path) -> None:
    """Of the material's own field, and of a light whose shadow moves over it."""
    scene = scene_of(folder)
    own = jaxrt.gradcheck(scene, "materials.fuzz", 0, row=0, seeds=2)
    assert own.verdict == "agrees" and own.coverage.included == ("interior",) and not own.coverage.missing
    # The shadow lies within the picture: where its outline touches the border, differences err by the step's root
    moved = jaxrt.gradcheck(scene, "lights.position", 0, component=0, spp=256, seeds=8, step=0.04)
    assert moved.verdict == "agrees" and "shadow edges" in moved.coverage.included, str(moved)
    assert min(group.interior.share for group in moved.components[0].groups) > 0.5


def test_info_lists_it(folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    status, out, _ = run(capsys, "info", "ball.toml")
    assert status == 0
    for piece in ("plush", "albedo (0.7, 0.5, 0.3), fuzz 0.4", "dust 0.25", "materials.fuzz", "(2,)"):
        assert piece in out, piece
    present, absent = summary.features(read_description("ball.toml"))
    assert {"plush", "dusty"} <= set(present) and "diffuse" in absent


def test_fit_finds_it_within_its_bounds(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    jaxrt.save_image("target.exr", jaxrt.render(scene_of(folder), 1, spp=64))
    (folder / "guess.toml").write_text(SCENE.replace("fuzz = 0.4", "fuzz = 0.9"))
    options = ("--parameters", "materials.fuzz[cloth]", "-o", "out", "--spp", 16)
    status, out, err = run(capsys, "fit", "guess.toml", "target.exr", *options)
    assert status == 0, out + err
    found = json.loads((folder / "out/fit.json").read_text())["parameters"]["materials.fuzz[cloth]"]
    assert abs(found["value"] - 0.4) < 4 * found["standard_error"] < 0.2
    np.testing.assert_allclose(
        jaxrt.parameters(jaxrt.load_scene("out/fitted.toml"))["materials.fuzz"][0], found["value"]
    )
