"""Kinds that jaxrt does not have, defined here alone: scene files, pictures, derivatives and commands know them."""

import json
import re
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import tomlkit
from command import run, working_folder
from edge_scenes import plan

import jaxrt
from jaxrt.boundary import clearance_of, sample_edges, splat
from jaxrt.cameras import View, projection, view_of
from jaxrt.cli.commands import summary
from jaxrt.cli.commands.summary import print_summary
from jaxrt.description import parse_description
from jaxrt.description.kinds import CAMERAS
from jaxrt.fit.unknowns import unknowns_of
from jaxrt.gradcheck.coverage import AFAR, GLOSSY, OWN_TURNS, SCATTERED, coverage
from jaxrt.gradcheck.steps import default_step
from jaxrt.io.scene_file import read_description
from jaxrt.kinds import (
    Albedo,
    Angle,
    Direction,
    Fraction,
    Place,
    Positive,
    Ray,
    Rgb,
    dot,
    normalize,
    pdf_cosine_hemisphere,
    pdf_uniform_sphere,
    reflect,
    sample_cosine_hemisphere,
    sample_uniform_sphere,
)
from jaxrt.scene.selectors import parse_selector, place_in_file
from tests.own_kinds import Chalk

pytestmark = pytest.mark.usefixtures("quick_compilation")


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
    moved = jaxrt.gradcheck(scene, "lights.position", 0, component=0, spp=256, seeds=8, step=0.04, max_depth=1)
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


@jaxrt.light
class Torch:
    """A lamp that shines to one side: its intensity times a power of the cosine to its axis."""

    position: Place
    axis: Direction
    intensity: Rgb
    falloff: Positive = 2.0
    is_delta = True

    def sample(self, point, u):
        away = point - self.position
        squared = dot(away, away)
        direction = away / jnp.sqrt(squared)
        cosine = jnp.maximum(dot(direction, normalize(self.axis)), 0)
        return -direction, jnp.sqrt(squared), self.intensity * cosine**self.falloff / squared

    def power(self):
        return jnp.sum(self.intensity)


@jaxrt.light
class Sun:
    """Parallel light."""

    toward: Direction
    irradiance: Rgb
    is_delta = True

    def sample(self, point, u):
        return normalize(self.toward), jnp.inf, self.irradiance


@jaxrt.light
class Dome:
    """A sky from one colour below to another above."""

    ground: Rgb
    zenith: Rgb

    def sample(self, point, u):
        return sample_uniform_sphere(u)

    def pdf(self, direction):
        return pdf_uniform_sphere()

    def emitted(self, direction):
        return self.ground + (self.zenith - self.ground) * (1 + direction[1]) / 2


@jaxrt.camera
class Drawing:
    """Parallel rays down, `scale` scene units a pixel."""

    position: Place
    scale: Positive = 1.0

    def ray(self, image, u):
        across, down = (image[0] - self.width / 2) * self.scale, (image[1] - self.height / 2) * self.scale
        below = jnp.zeros_like(self.position).at[1].set(-1)
        return Ray(self.position + jnp.stack([across, jnp.zeros_like(across), down]), below)


@jaxrt.camera
class Globe:
    """Looks down; the angle to its axis grows with the distance to the picture's centre: `fov` from edge to edge."""

    position: Place
    fov: Angle = 120.0
    is_central = True

    def ray(self, image, u):
        x, y = image[0] - self.width / 2, image[1] - self.height / 2
        radius = jnp.sqrt(x * x + y * y + 1e-12)
        angle = radius / self.height * jnp.radians(self.fov)
        return Ray(
            self.position, jnp.stack([jnp.sin(angle) * x / radius, -jnp.cos(angle), jnp.sin(angle) * y / radius])
        )

    def project(self, point):
        x, y, z = point - self.position
        side = jnp.sqrt(x * x + z * z + 1e-12)
        radius = jnp.arctan2(side, -y) * self.height / jnp.radians(self.fov)
        return (self.width / 2 + radius * x / side, self.height / 2 + radius * z / side), y < 0


@jaxrt.camera
class Lens:
    """A thin lens that looks along -z and is sharp at a distance."""

    position: Place
    aperture: Positive = 1.0
    focus: Positive = 10.0
    scale: Positive = 0.1  # of a pixel at distance 1

    def ray(self, image, u):
        x, y = (image[0] - self.width / 2) * self.scale, (self.height / 2 - image[1]) * self.scale
        radius, turn = self.aperture * jnp.sqrt(u[0]), 2 * jnp.pi * u[1]
        start = jnp.stack([radius * jnp.cos(turn), radius * jnp.sin(turn), jnp.zeros_like(x)])
        sharp = self.focus * jnp.stack([x, y, -jnp.ones_like(x)])
        return Ray(self.position + start, normalize(sharp - start))


WHITE = {"white": {"type": "diffuse", "albedo": [0.5, 0.6, 0.7]}}
ALBEDO = np.array([0.5, 0.6, 0.7])


def floor(low: float, high: float, height: float = 0.0) -> list[dict[str, Any]]:
    a, b, c, d = ([x, height, z] for x, z in ((low, -9), (high, -9), (high, 9), (low, 9)))
    return [{"vertices": [a, c, b], "material": "white"}, {"vertices": [a, d, c], "material": "white"}]


OUTDOORS = {
    "camera": {"type": "drawing", "position": [0, 5, 0], "width": 8, "height": 8},
    "materials": WHITE,
    "triangles": floor(-9, 0),
    "lights": [
        {"type": "dome", "ground": 0.2, "zenith": [0.4, 0.7, 1.0]},
        {"type": "sun", "toward": [3, 4, 0], "irradiance": 2},
    ],
}


def on_floor(ground, zenith, toward, irradiance):
    """Return the radiance (3,) of a floor under a dome and a sun, in closed form."""
    sky = jnp.pi * (ground + (zenith - ground) * 5 / 6)
    return ALBEDO / jnp.pi * (sky + irradiance * toward[1] / jnp.linalg.norm(toward))


def test_a_sky_and_a_sun_before_a_camera_of_parallel_rays() -> None:
    """Light samples find both on the floor, and rays that miss see the sky; derivatives are those of the closed form.

    One half of the floor is of a kind that scattered rays find the sky from too: both ways together count it once.
    """
    chalk = {"type": Chalk.kind.name, "albedo": ALBEDO.tolist()}
    under = OUTDOORS["triangles"][0], OUTDOORS["triangles"][1] | {"material": "chalk"}
    scene = jaxrt.build({**OUTDOORS, "materials": {**WHITE, "chalk": chalk}, "triangles": under})
    p = jaxrt.parameters(scene)
    names = ["lights.ground", "lights.zenith", "lights.toward", "lights.irradiance"]
    assert {*names, "camera.position", "camera.scale"} <= p.keys()
    assert p["lights.zenith"].shape == (1, 3) and p["camera.scale"].shape == ()

    def left(values: list[jax.Array]) -> tuple[jax.Array, jax.Array]:
        changes = dict(zip(names, values, strict=True))
        picture = jaxrt.render(jaxrt.with_parameters(scene, changes), 0, spp=256, max_depth=1)
        return jnp.mean(picture[:, :4], (0, 1)) @ jnp.arange(1.0, 4.0), picture

    values = [p[name] for name in names]
    (_, picture), slopes = jax.value_and_grad(left, has_aux=True)(values)
    np.testing.assert_allclose(picture[:, 4:], np.broadcast_to(0.2, (8, 4, 3)), rtol=1e-6)
    wanted = on_floor(*(x[0] for x in values))
    for half in (np.triu(np.ones((8, 8), bool), 1), np.tril(np.ones((8, 8), bool), -1)):
        half[:, 4:] = False
        np.testing.assert_allclose(np.asarray(picture)[half].mean(0), wanted, rtol=0.015)
    change = jax.grad(lambda v: on_floor(*(x[0] for x in v)) @ jnp.arange(1.0, 4.0))(values)
    for name, slope, want in zip(names, slopes, change, strict=True):
        np.testing.assert_allclose(slope, want, rtol=0.02, atol=0.02 * float(jnp.max(jnp.abs(want))), err_msg=name)


def lamp_over(**camera: Any) -> dict[str, Any]:
    """Return a torch and a ball over a floor, before a fisheye."""
    return {
        "camera": {"type": "globe", "position": [0.3, 6, 0.2], "fov": 100, "width": 16, "height": 16, **camera},
        "materials": WHITE,
        "spheres": [
            {"center": [0, 1.5, 0], "radius": 0.7, "material": "white"},
            {"center": [0, -1e5, 0], "radius": 1e5, "material": "white"},
        ],
        "lights": [{"type": "torch", "position": [2, 5, 1], "axis": [-1, -5, 0], "intensity": [20, 30, 40]}],
    }


@pytest.mark.slow
def test_a_torch_before_a_fisheye() -> None:
    """The floor is lit in closed form, at the places that the camera's angles tell; the edge of a shadow moves.

    The light's intensity towards an edge, and the pixels per steradian, follow from `sample` and `project`.
    """
    scene = jaxrt.build(lamp_over())
    picture = np.asarray(jaxrt.render(scene, 0, spp=32, max_depth=1))
    j, i = np.meshgrid(np.arange(16) + 0.5, np.arange(16) + 0.5)
    # Where the middles of the pixels look, but for the ball and its shadow
    radius, turn = np.hypot(j - 8, i - 8), np.arctan2(i - 8, j - 8)
    reach = 6 * np.tan(radius / 16 * np.radians(100))
    places = np.stack([0.3 + reach * np.cos(turn), 0 * reach, 0.2 + reach * np.sin(turn)], -1)
    away, axis = places - [2, 5, 1], np.array([-1, -5, 0]) / np.sqrt(26)
    distance = np.linalg.norm(away, axis=-1)
    cosine = away @ axis / distance
    want = ALBEDO / np.pi * np.array([20, 30, 40]) * (cosine**2 * 5 / distance**3)[..., None]
    seen = (radius < 6) & (j > 11)
    assert seen.sum() > 10
    np.testing.assert_allclose(picture[seen], want[seen], rtol=0.03)
    report = jaxrt.gradcheck(
        scene, "camera.position", 3, component=0, spp=256, max_depth=1, boundary_samples=8192, seeds=4, step=0.06,
    )  # fmt: skip
    assert report.coverage.included == ("interior", "shadow edges", "outlines seen by the camera")
    for group in report.components[0].groups:
        assert group.interior.exceeds(0.05) and not group.total.exceeds(0.05), str(report)


def test_a_fit_from_a_scene_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The dome's colour and the fisheye's angle, from a picture of the sky alone."""

    def scene(fov: float, zenith: list[float]) -> str:
        camera = {"type": "globe", "position": [0, 0, 0], "fov": fov, "width": 16, "height": 16}
        sky = {"type": "dome", "ground": 0.1, "zenith": zenith}
        return tomlkit.dumps({"camera": camera, "lights": [sky], "render": {"max_depth": 1}})

    working_folder(tmp_path, monkeypatch, scene(150, [1, 2, 3]))
    jaxrt.save_image("target.exr", jaxrt.render(jaxrt.load_scene("ball.toml"), 1, spp=16))
    Path("guess.toml").write_text(scene(110, [2, 2, 2]))
    names = "lights.zenith[0]", "camera.fov"
    status, out, err = run(capsys, "fit", "guess.toml", "target.exr", "--parameters", *names, "-o", "out", "--spp", 16)
    assert status == 0, out + err
    found = jaxrt.parameters(jaxrt.load_scene("out/fitted.toml"))
    np.testing.assert_allclose(found["lights.zenith"][0], [1, 2, 3], rtol=0.02)
    assert float(found["camera.fov"]) == pytest.approx(150, rel=0.01)


def camera_of(table: dict[str, Any]) -> Any:
    table = CAMERAS.validate(table)
    return CAMERAS.kind_of(table).single(table, jnp.float32)


@pytest.mark.parametrize("image", [(8.01, 8.02), (3.2, 11.4), (15.01, 1.01)])  # within pixels
def test_image_points_are_where_rays_go(image: tuple[float, float]) -> None:
    """A central camera's `project` undoes its `ray`; pixels per steradian follow by its Jacobian."""
    table = {"position": [1, 2, 3], "target": [0, 1, 0], "width": 16, "height": 16}
    for camera in (globe := camera_of(lamp_over()["camera"]), camera_of(table)):
        view = view_of(camera)
        pair = jnp.float32(image[0]), jnp.float32(image[1])
        ray = view.ray(pair, pair)
        seen = projection(view, ray.origin + 3 * ray.direction)
        np.testing.assert_allclose(seen.image, image, atol=2e-4)
        assert seen.inside and seen.pixel == int(image[1]) * 16 + int(image[0])
        if camera is globe:
            angle = np.hypot(image[0] - 8, image[1] - 8) / 16 * np.radians(100)
            want = (16 / np.radians(100)) ** 2 * angle / np.sin(angle)
        else:
            want = View.density(view, ray.origin + 3 * ray.direction)
        assert float(seen.density) == pytest.approx(float(want), rel=1e-3)


def test_a_thin_lens_blurs_what_is_not_in_focus() -> None:
    """A far small light is a disk whose size the lens tells: the second pair of the first block is for the lens."""
    camera = {"type": "lens", "position": [0, 0, 0], "aperture": 0.5, "focus": 10, "scale": 0.005}
    lamp = {"position": [0, 0, -20], "intensity": 1, "radius": 0.15}
    scene = jaxrt.build({"camera": {**camera, "width": 16, "height": 16}, "lights": [lamp]})
    picture = np.asarray(jaxrt.render(scene, 0, spp=256, max_depth=1))[..., 0]
    # A uniform disk of radius R has variance R²/4 along an axis
    disk, lamp_itself = 0.5 * (1 / 10 - 1 / 20) / 0.005, 0.15 / 20 / 0.005
    for axis in np.meshgrid(np.arange(16) - 7.5, np.arange(16) - 7.5):
        variance = np.sum(picture * axis**2) / np.sum(picture)
        assert variance == pytest.approx((disk**2 + lamp_itself**2) / 4, rel=0.05)


LAMPS: list[dict[str, Any]] = [
    {"type": "torch", "position": [0, 8, 0], "axis": [0, -1, 0], "intensity": 1},
    {"position": [1, 8, 0], "intensity": 2, "radius": 0.5},
    {"type": "dome", "ground": 0.1, "zenith": 0.2},
    {"type": "torch", "position": [2, 8, 0], "axis": [0, -1, 0], "intensity": 3},
    {"type": "sphere", "position": [3, 8, 0], "intensity": 4},
    {"type": "sun", "toward": [0, 1, 0], "irradiance": 5},
]


def mixed() -> jaxrt.Scene:
    return jaxrt.build({**lamp_over(), "lights": LAMPS})


def test_rows_of_lights_are_in_the_order_of_the_scene_file() -> None:
    """Those of all kinds that have the field, whatever the kinds' own order; new values find their way back."""
    scene = mixed()
    p = jaxrt.parameters(scene)
    np.testing.assert_array_equal(p["lights.position"][:, 0], [0, 1, 2, 3])
    np.testing.assert_array_equal(p["lights.intensity"][:, 0], [1, 2, 3, 4])
    assert p["lights.radius"].shape == (2,) and p["lights.axis"].shape == (2, 3) and p["lights.toward"].shape == (1, 3)
    new = {name: value + 1 for name, value in p.items() if name.startswith("lights.")}
    changed = jaxrt.parameters(jaxrt.with_parameters(scene, new))
    for name, value in changed.items():
        np.testing.assert_array_equal(value, new.get(name, p[name]), err_msg=name)
    np.testing.assert_array_equal(scene.lights.position[:, 0], [1, 3])
    np.testing.assert_array_equal(scene.lights.radius, [0.5, 0])


def test_a_far_scene_is_moved_with_its_lights_and_camera() -> None:
    far = np.array([1e6, 0, 0])

    def there(table: dict[str, Any]) -> dict[str, Any]:
        return {
            k: (np.asarray(v) + far).tolist() if k in ("position", "center", "vertices") else v
            for k, v in table.items()
        }

    near = {**lamp_over(), "lights": LAMPS}
    moved = {k: [there(x) for x in v] if isinstance(v, list) else v for k, v in near.items()}
    scene, other = jaxrt.build(near), jaxrt.build({**moved, "camera": there(near["camera"])})
    assert other.origin is not None
    apart = np.asarray(scene.camera.position) - np.asarray(other.camera.position)
    for kind, same in zip(scene.lights.kinds, other.lights.kinds, strict=True):
        if hasattr(kind[0], "position"):
            np.testing.assert_allclose(kind[0].position - same[0].position, np.tile(apart, (2, 1)), atol=1e-3)
    np.testing.assert_array_equal(jaxrt.parameters(other)["lights.axis"], jaxrt.parameters(scene)["lights.axis"])
    np.testing.assert_array_equal(jaxrt.parameters(other)["lights.position"][:, 0], [1e6, 1e6 + 1, 1e6 + 2, 1e6 + 3])


def test_what_derivatives_lack_is_named() -> None:
    scene, outdoors = mixed(), jaxrt.build({**OUTDOORS, "spheres": lamp_over()["spheres"]})
    assert "shadow edges" in coverage(scene, "lights.position", 1, 64, 0).included
    assert AFAR in coverage(scene, "lights.toward", 1, 64, 0).missing
    assert coverage(scene, "lights.zenith", 1, 64, 0) == (False, ("interior",), ())
    assert coverage(scene, "spheres.center", 1, 64, 0).missing == (AFAR,)
    assert coverage(outdoors, "camera.scale", 1, 64) == (False, ("interior",), (SCATTERED,))
    # A sky of one's own is found by light samples, which have no edges of it
    overcast = jaxrt.build({**lamp_over(), "lights": OUTDOORS["lights"][:1]})
    assert coverage(overcast, "spheres.center", 1, 64, 0).missing == (AFAR,)
    assert not coverage(overcast, "lights.zenith", 1, 64, 0).missing


def test_a_glossy_ball_has_the_outline_of_the_diffuse_one_that_it_looks_like() -> None:
    def change(material: dict[str, Any]) -> jax.Array:
        table = {
            "camera": {"position": [0, 0, 6], "width": 12, "height": 8, "fov": 45},
            "materials": {"white": {"albedo": [0.7, 0.5, 0.3], **material}},
            "environment": {"radiance": [1, 1, 1]},
            "spheres": [{"center": [-0.4, 0, 0], "radius": 1, "material": "white"}],
        }
        scene = jaxrt.build(table)
        start = jaxrt.parameters(scene, "spheres.center")
        groups = sample_edges(scene, jnp.uint32(0), plan(256, 1, geometry=True))

        @jax.jit
        def outline(center: jax.Array) -> jax.Array:
            moved = jaxrt.with_parameters(scene, {"spheres.center": center})
            return sum(splat(one, clearance_of(moved, one), (12, 8)) for one in groups)

        return jax.jvp(outline, (start,), (jnp.ones_like(start),))[1]

    found = change({"type": "plush", "fuzz": 0})
    assert float(jnp.abs(found).max()) > 0.05
    np.testing.assert_allclose(found, change({"type": "diffuse"}), atol=1e-5)


def test_what_glossy_surfaces_see_is_named() -> None:
    """They see outlines by scattered rays: of what reflects light, of a sky, and of lights in the way."""
    table = {**lamp_over(), "materials": {"white": {"type": "plush", "albedo": [0.7, 0.5, 0.3]}}}
    plush = jaxrt.build(table)
    assert not coverage(plush, "spheres.center", 1, 64, 0).missing
    assert coverage(plush, "spheres.center", 2, 64, 0).missing == (GLOSSY, OWN_TURNS)
    assert "outlines seen by scattered rays" not in coverage(plush, "spheres.center", 2, 64, 0).included
    gold = jaxrt.build({**table, "materials": {"white": {"type": "conductor", "albedo": [0.9, 0.7, 0.3]}}})
    assert "outlines seen by scattered rays" in coverage(gold, "spheres.center", 2, 64, 0).included
    assert not coverage(gold, "spheres.center", 2, 64, 0).missing
    # A point hides nothing
    assert not coverage(plush, "lights.position", 2, 64, 0).missing
    bulb = {"position": [2, 5, 1], "intensity": 9, "radius": 0.5}
    assert coverage(jaxrt.build({**table, "lights": [bulb]}), "lights.position", 2, 64, 0).missing == (GLOSSY,)
    under_a_sky = jaxrt.build({**table, "environment": {"radiance": [1, 1, 1]}})
    assert coverage(under_a_sky, "camera.position", 1, 64).missing == (GLOSSY,)


def test_they_are_listed_bounded_and_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`info`, the unknowns of a fit with their ranges, default steps, and the place of a row in the scene file."""
    description = parse_description({**lamp_over(), "lights": LAMPS})
    scene = jaxrt.build(description)
    print_summary("scene", description, scene, ())
    told = capsys.readouterr().out
    for word in ("torch lights", "globe camera", "globe: position (0.3, 6, 0.2), fov 100", "lights.zenith"):
        assert word in told
    names = ["lights.zenith", "lights.position[2]", "lights.axis[1]", "camera.fov"]
    selectors = {name: parse_selector(name, scene) for name in names}
    unknowns = unknowns_of(scene, selectors)
    assert [row.kind for row in unknowns.rows] == ["positive", "place", "free", "angle"]
    back = jaxrt.parameters(unknowns.apply(scene, jnp.asarray(unknowns.vector(scene))))
    for name, value in jaxrt.parameters(scene).items():
        np.testing.assert_allclose(back[name], value, rtol=1e-4, atol=1e-4)
    assert [place_in_file(description, selectors[name]) for name in names[:3]] == [2, 3, 3]
    for name, selector in selectors.items():
        assert default_step(scene, selector, 1.0) > 0, name


@pytest.mark.parametrize(
    ("light", "message"),
    [
        ({"type": "torsh"}, 'lights[0].type: unknown light type "torsh" (did you mean "torch"?)'),
        (LAMPS[0] | {"axis": [0, 0, 0]}, "lights[0].axis: (0.0, 0.0, 0.0) is zero: use a direction"),
        ({"type": "sun", "toward": [0, 1, 0]}, 'lights[0]: "irradiance" is missing: add irradiance = '),
        ({"type": "dome", "ground": -1, "zenith": 1}, "lights[0].ground: -1 is negative: light cannot be"),
        ({"type": "sun", "toward": [0, 1, 0], "irradiance": 1, "size": 2}, 'lights[0]: unknown key "size"'),
    ],
)  # fmt: skip
def test_tables_are_checked_as_ours_are(light: dict[str, Any], message: str) -> None:
    with pytest.raises(jaxrt.SceneError, match=re.escape(message)):
        jaxrt.build({**lamp_over(), "lights": [light]})


def test_a_camera_type_that_is_not_known() -> None:
    with pytest.raises(
        jaxrt.SceneError, match=re.escape('camera.type: unknown camera type "globes" (did you mean "globe"?)')
    ):
        jaxrt.build({"camera": {"type": "globes", "position": [0, 0, 0]}})


def test_a_central_camera_needs_a_position() -> None:
    with pytest.raises(TypeError, match="is central and has no position"):

        @jaxrt.camera
        class Nowhere:
            is_central = True

            def ray(self, image, u): ...

            def project(self, point): ...
