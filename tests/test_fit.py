"""Recovery from random starts, the parts of a fit, and `jaxrt fit` from end to end.

Targets are drawn with another seed and 16 times the samples of the fit.
"""

import json
import os
import signal
import subprocess
import sys
import warnings
from collections.abc import Iterator
from dataclasses import replace
from itertools import count
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest
from command import working_folder

import jaxrt
from jaxrt import cli
from jaxrt.cli.arguments import parser
from jaxrt.fit import Fit, FitError, Machine, Problem, Progress, Step, descent, sought, standard_errors, unknowns_of
from jaxrt.fit.command import told
from jaxrt.fit.descent import Found, descend
from jaxrt.fit.files import load_target, read_progress
from jaxrt.fit.solve import Drawing, Look
from jaxrt.fit.unknowns import differences
from jaxrt.gradcheck.coverage import CROSSING, SPECULAR
from jaxrt.kinds import Place, Positive, Ray, normalize
from jaxrt.scene.selectors import parse_selector

ROOT = Path(__file__).parent.parent
SIZE, SPP = 32, 16
ONE = jax.devices()[:1]  # as `use_cpu_cores` asks for a vmap of whole solves
DIAGONAL = 16 * 2**0.5  # of the floor
SEEN = [
    0,
    1,
    2,
    3,
    4,
    6,
]  # materials of the room that cover more than 1 % of the picture: not the wall behind the camera


def resized(path: str, size: int = SIZE) -> jaxrt.Scene:
    scene = jaxrt.load_scene(ROOT / path)
    return replace(scene, camera=replace(scene.camera, width=size, height=size))


def random_places(n: int, low: list[float], high: list[float]) -> jax.Array:
    return jnp.asarray(np.random.default_rng(0).uniform(low, high, (n, 1, 3)), jnp.float32)


def solve_from(scene: jaxrt.Scene, target: jax.Array, starts: jax.Array) -> jax.Array:
    """Return where Levenberg-Marquardt takes each light position, as one compiled call."""

    @jaxrt.jacobian_once
    def residual(position, args):
        lit = jaxrt.with_parameters(scene, {"lights.position": position})
        return (jaxrt.render(lit, 0, spp=SPP, boundary_samples=4 * SIZE * SIZE, devices=ONE) - target).ravel()

    def solve(position):
        method = optx.LevenbergMarquardt(rtol=1e-3, atol=1e-4)
        return optx.least_squares(residual, method, position, max_steps=40, throw=False).value

    return jax.jit(jax.vmap(solve))(starts)


@pytest.mark.slow
def test_a_point_light_is_found_from_19_of_20_starts() -> None:
    scene = resized("scenes/ball_on_floor.toml")
    truth = jaxrt.parameters(scene)["lights.position"]
    target = jaxrt.render(scene, 1, spp=16 * SPP)
    starts = random_places(20, [-6, 4, -6], [6, 12, 6])
    errors = jnp.linalg.norm(solve_from(scene, target, starts) - truth[None], axis=(1, 2))
    assert int(jnp.sum(errors <= 0.01 * DIAGONAL)) >= 19, errors


@pytest.mark.quick
@pytest.mark.slow
def test_albedos_of_a_room_are_found_from_8_starts() -> None:
    scene = resized("scenes/seed/soft_shadow_indirect.toml")
    truth = jaxrt.parameters(scene)["materials.albedo"]
    target = jaxrt.render(scene, 1, spp=16 * SPP, max_depth=1)

    @jaxrt.jacobian_once
    def residual(u, args):
        colored = jaxrt.with_parameters(scene, {"materials.albedo": jax.nn.sigmoid(u)})
        return (jaxrt.render(colored, 0, spp=SPP, max_depth=1, devices=ONE) - target).ravel()

    def solve(u):
        method = optx.LevenbergMarquardt(rtol=1e-2, atol=1e-3)
        return jax.nn.sigmoid(optx.least_squares(residual, method, u, max_steps=30, throw=False).value)

    starts = jnp.asarray(np.random.default_rng(1).uniform(0.1, 0.9, (8, *truth.shape)), jnp.float32)
    found = jax.jit(jax.vmap(solve))(jnp.log(starts / (1 - starts)))
    errors = jnp.abs(found - truth[None])[:, jnp.array(SEEN)]
    assert float(errors.max()) <= 0.01, errors.max(axis=(0, 2))


def machine_of(scene: jaxrt.Scene, names: list[str], target: jax.Array) -> Machine:
    unknowns = unknowns_of(scene, {name: parse_selector(name, scene) for name in names})
    return Machine(Problem(scene, unknowns, target, jnp.ones_like(target)))


@pytest.mark.slow
def test_albedos_are_found_by_indirect_light_without_the_bias_of_one_set_of_samples() -> None:
    """Noise decides: the greatest error is 0.015, 0.010 and 0.004 at 64, 128 and 256 samples a pixel."""
    scene = resized("scenes/seed/soft_shadow_indirect.toml")
    truth = jaxrt.parameters(scene)["materials.albedo"]
    target = jaxrt.render(scene, 1, spp=16 * 256, max_depth=2)
    names = [f"materials.albedo[{i}]" for i in SEEN]
    unknowns = unknowns_of(scene, {name: parse_selector(name, scene) for name in names})
    grey = jaxrt.with_parameters(scene, {"materials.albedo": truth.at[jnp.array(SEEN)].set(0.5)})
    answer = descend(Machine(Problem(grey, unknowns, target, jnp.ones_like(target), max_depth=2)), spp=256)
    found = np.stack(list(unknowns.values(answer.vector).values()))
    assert np.abs(found - truth[np.array(SEEN)]).max() <= 0.01, found


@pytest.fixture(scope="module")
def sphere_light() -> tuple[jaxrt.Scene, Machine, Found]:
    """A sphere light sought by its place and radius: the true scene, and the answer."""
    scene = resized("scenes/ball_under_sphere_light.toml")
    target = jaxrt.render(scene, 1, spp=16 * 1024)
    start = jaxrt.with_parameters(scene, {"lights.position": jnp.array([[2.0, 7.0, 0.0]])})
    machine = machine_of(start, ["lights.position[0]", "lights.radius[0]"], target)
    return scene, machine, descend(machine, spp=1024)


@pytest.mark.slow
def test_a_sphere_light_is_found(sphere_light: tuple[jaxrt.Scene, Machine, Found]) -> None:
    scene, machine, answer = sphere_light
    truth = jaxrt.parameters(scene)
    found = machine.problem.unknowns.values(answer.vector)
    assert np.linalg.norm(found["lights.position[0]"] - truth["lights.position"][0]) <= 0.02 * DIAGONAL
    assert abs(found["lights.radius[0]"] - truth["lights.radius"][0]) <= 0.05


@pytest.mark.slow
def test_a_sphere_light_that_is_found_is_solved(sphere_light: tuple[jaxrt.Scene, Machine, Found]) -> None:
    assert sphere_light[2].verdict.word == "solved"


@pytest.mark.slow
def test_colour_and_light_are_found_together_with_the_scale_fixed() -> None:
    scene = resized("scenes/ball_on_floor.toml")
    truth = jaxrt.parameters(scene)
    target = jaxrt.render(scene, 1, spp=16 * 64)
    albedo = truth["materials.albedo"].at[1].set(0.5)
    changes = {"lights.position": jnp.array([[1.0, 7.0, 5.0]]), "lights.intensity": jnp.full((1, 3), 150.0)}
    start = jaxrt.with_parameters(scene, {**changes, "materials.albedo": albedo})
    machine = machine_of(start, ["materials.albedo[1]", "lights.position[0]", "lights.intensity[0]"], target)
    found = machine.problem.unknowns.values(descend(machine, spp=64).vector)
    assert np.linalg.norm(found["lights.position[0]"] - truth["lights.position"][0]) <= 0.02 * DIAGONAL
    np.testing.assert_allclose(found["materials.albedo[1]"], truth["materials.albedo"][1], atol=0.02)
    np.testing.assert_allclose(found["lights.intensity[0]"], truth["lights.intensity"][0], rtol=0.02)


def test_unknowns_go_to_a_vector_and_back() -> None:
    scene = jaxrt.load_scene(ROOT / "scenes/room.toml")
    names = ["materials.albedo[0]", "lights.radius[0]", "spheres.center[6]", "camera.fov", "materials.ior[0]"]
    unknowns = unknowns_of(scene, {name: parse_selector(name, scene) for name in names})
    vector = unknowns.vector(scene)
    assert vector.shape == (9,) and unknowns.labels()[:4] == [f"{names[0]}.{c}" for c in "rgb"] + [names[1]]
    before, after = jaxrt.parameters(scene), jaxrt.parameters(unknowns.apply(scene, jnp.asarray(vector)))
    for name in before:
        np.testing.assert_allclose(before[name], after[name], rtol=2e-5, atol=1e-5)
    step = 1e-2 * np.ones_like(vector)
    change = [
        a - b for a, b in zip(*(unknowns.values(v).values() for v in (vector + step, vector - step)), strict=True)
    ]
    np.testing.assert_allclose(np.concatenate([c.ravel() for c in change]), 0.02 * unknowns.slopes(vector), rtol=1e-2)


def test_standard_errors_are_those_of_uneven_noise_that_channels_share() -> None:
    rng = np.random.default_rng(0)
    jacobian, sigma = np.repeat(rng.normal(size=(4000, 1, 3)), 3, axis=1), np.exp(0.5 * rng.normal(size=(4000, 1)))
    exact = np.sqrt(np.sum((np.linalg.pinv(jacobian[:, 0]) * sigma[:, 0]) ** 2, axis=1))
    noise = np.repeat(sigma * rng.normal(size=(4000, 1)), 3, axis=1)
    np.testing.assert_allclose(standard_errors([noise], [jacobian]), exact, rtol=0.15)


def test_a_png_target_is_linearised_and_its_white_left_out(tmp_path: Path) -> None:
    image = np.full((4, 5, 3), 0.25, np.float32)
    image[0, 0], image[1, 1] = 3, 0
    jaxrt.save_image(tmp_path / "a.png", image)
    jaxrt.save_image(tmp_path / "a.exr", image)
    png, exr = load_target(tmp_path / "a.png"), load_target(tmp_path / "a.exr")
    np.testing.assert_allclose(png.image[2:], 0.25, atol=2e-3)
    assert png.weight[0, 0].tolist() == [0, 0, 0] and png.weight.sum() == 57 and exr.weight.sum() == 60
    assert "linearised by gamma 2.2; 5.0% clipped at white, left out" in png.notes[0] and not exr.notes


SCENE = """\
[camera]  # a comment that stays
position = [0, 0, 5]
width = 12
height = 12

[render]
spp = 32
max_depth = 1

[materials.ball]
type = "diffuse"
albedo = [0.5, 0.5, 0.5]  # a guess

[[spheres]]
center = [0, 0, 0]
radius = 2
material = "ball"

[[lights]]
position = [3, 4, 5]
intensity = 40
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with a scene, ball.toml, and a picture of it with another albedo, target.exr."""
    working_folder(tmp_path, monkeypatch, SCENE)
    (tmp_path / "truth.toml").write_text(SCENE.replace("[0.5, 0.5, 0.5]", "[0.7, 0.3, 0.1]"))
    jaxrt.save_image("target.exr", jaxrt.render(jaxrt.load_scene("truth.toml"), 1, spp=512))
    return tmp_path


def command(*more: str) -> list[str]:
    return ["fit", "ball.toml", "target.exr", "--parameters", "materials.albedo[ball]", "-o", "out", *more]


def progress_of(folder: Path) -> dict[str, object]:
    return json.loads((folder / "out/fit.json").read_text())["progress"]


@pytest.mark.quick
@pytest.mark.usefixtures("quick_compilation")
def test_fit_from_end_to_end(folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """The command, what `jaxrt.fit` has given it, and a run that is interrupted and goes on."""
    from jaxrt.fit import command as module

    answers: list[Fit] = []
    monkeypatch.setattr(module, "fit", lambda *a, **options: answers.append(jaxrt.fit(*a, **options)) or answers[-1])
    assert cli.main(command()) == 0
    out, err = capsys.readouterr()
    assert "materials.albedo[ball] = 0." in out and "solved: " in out and "jaxrt: step 1: loss " in err
    assert err.count(" s left") == err.count(": step ") - 1  # the first one compiles
    report = json.loads((folder / "out/fit.json").read_text())
    albedo = report["parameters"]["materials.albedo[ball]"]
    np.testing.assert_allclose(albedo["value"], [0.7, 0.3, 0.1], atol=5e-3)
    assert max(albedo["standard_error"]) < 5e-3 and report["verdict"]["word"] == "solved"
    text = (folder / "out/fitted.toml").read_text()
    assert "# a comment that stays" in text and "# a guess" in text
    fitted = jaxrt.parameters(jaxrt.load_scene("out/fitted.toml"))["materials.albedo"][0]
    np.testing.assert_allclose(fitted, albedo["value"], rtol=1e-5)
    assert (folder / "out/loss.png").exists() and (folder / "out/before_after.png").exists()
    (answer,) = answers
    assert str(answer) in out and answer.verdict.word == "solved" and answer.interrupted == 0
    assert answer.values["materials.albedo[ball]"].tolist() == albedo["value"]
    assert answer.errors["materials.albedo[ball]"].tolist() == albedo["standard_error"]
    assert answer.history == tuple(report["progress"]["losses"]) and not answer.lacks
    np.testing.assert_array_equal(jaxrt.parameters(answer.scene)["materials.albedo"][0], np.float32(albedo["value"]))
    seen = jaxrt.load_image("target.exr")
    assert np.abs(answer.after - seen).mean() < 0.1 * np.abs(answer.before - seen).mean()
    # Interrupted in the middle of a stage, and gone on from there: the same to the bit
    whole, told = progress_of(folder), module._say

    def interrupt(*lines: str) -> None:
        told(*lines)
        if lines and lines[0].startswith("step 2:"):
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(module, "_say", interrupt)
        assert cli.main(command()) == 130
    assert "go on with --resume" in capsys.readouterr().err
    half = progress_of(folder)
    assert half["losses"] == whole["losses"][:2] and half["step_size"] is not None
    assert jaxrt.load_scene("out/fitted.toml").materials.diffuse is not None
    assert cli.main(command("--resume")) == 0
    assert progress_of(folder) == whole


class Plateau:
    """A solver whose steps are accepted up to a number of them in each stage, and then promise and gain nothing."""

    def __init__(self, accepted: int, promise: float) -> None:
        self.accepted, self.promise = accepted, promise

    def rounds_at(self, vector: np.ndarray, seed: int, how: Drawing) -> int:
        return 1

    def steps(self, vector: np.ndarray, seed: int, how: Drawing, step_size: float | None) -> Iterator[Look]:
        for i in count():
            good = i < self.accepted
            yield Look(vector, 0.5 ** min(i, self.accepted), good, 0.5 if good else self.promise, 1.0)


@pytest.mark.parametrize(("promise", "steps"), [(0.5, 3 * 3 + 2 + 2 + 4), (0.0, 3 * 3 + 3)])
def test_s7_a_stage_ends_when_steps_gain_no_more(promise: float, steps: int) -> None:
    """What still promises gets another chance or a few; 8 a stage were 27 of 35 steps."""
    begin = Progress(0, 0, np.zeros(1), np.inf, ())
    *_, (look, last) = descent._steps(Plateau(3, promise), begin, 64, 0, 1000)
    assert last.step == steps == len(last.losses) and last.stage == 3 and not look.accepted


def test_s7_rejected_steps_are_marked() -> None:
    progress = Progress(7, 0, np.zeros(1), 0.5, (0.5,))
    step = Step(7, 1, 4, 0.5, True, {"camera.fov": np.array(40.0)}, 3.4, progress)
    assert told(step) == "step 7: loss 5.000e-01 at 4 spp, camera.fov 40, about 3 s left"
    assert told(step._replace(accepted=False, seconds_left=None)) == "step 7: rejected"


@pytest.mark.parametrize("place", range(3))
def test_s7_parameters_may_stand_anywhere(place: int) -> None:
    words = ["a.toml", "b.exr", "-o", "out"]
    at = (0, 2, 4)[place]
    words[at:at] = ["--parameters", "camera.fov", "materials.albedo[x.png]"]
    found = parser().parse_args(["fit", *words])
    assert (found.scene, found.targets) == (Path("a.toml"), [Path("b.exr")])
    assert found.parameters == ["camera.fov", "materials.albedo[x.png]"] and found.output == Path("out")


def test_s6_a_missing_extra_is_told_before_anything_is_loaded(tmp_path: Path) -> None:
    program = (
        "import sys; sys.modules['optimistix'] = sys.modules['tomlkit'] = None; from jaxrt import cli; "
        "status = cli.main(['fit', 'a.toml', 'b.exr', '--parameters', 'camera.fov']); "
        "assert not {'jax', 'numpy'} & set(sys.modules); sys.exit(status)"
    )
    child = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True)
    assert child.returncode == 2
    assert child.stderr == "jaxrt: error: fit: optimistix, tomlkit are not installed: pip install 'jaxrt[fit]'\n"


def test_s6_a_missing_extra_is_told_in_python(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "optimistix", None)
    for kind in (ImportError, jaxrt.SceneError):
        with pytest.raises(kind, match=r"fit: optimistix is not installed: pip install 'jaxrt\[fit\]'"):
            jaxrt.fit(None, None, [])


TARGET = np.ones((6, 8, 3))
WRONG = [
    ({"target": np.ones((6, 8))}, r"target: shape \(6, 8\), want \(height, width, 3\)"),
    ({"target": np.ones((8, 8, 3))}, "target: 8x8, but the scene's camera has 8x6, another shape"),
    ({"target": 0 * TARGET}, "target: black"),
    ({"target": np.nan * TARGET}, "target: has pixels that are not finite"),
    ({"weight": np.ones((5, 8, 3))}, r"weight: shape \(5, 8, 3\)"),
    ({"weight": -1}, "weight: has numbers that are negative"),
    ({"parameters": []}, "parameters is empty"),
    ({"parameters": [1]}, "write names"),
    ({"parameters": ["camera.fo"]}, "camera.fo: the scene has no such parameter"),
    ({"parameters": ["camera.fov", " camera.fov"]}, "named twice"),
    ({"parameters": "meshes.vertices"}, "fit: 306 numbers are sought"),
    ({"spp": 0}, "fit: spp is 0, want at least 1"),
    ({"max_steps": 1.5}, "fit: max_steps is 1.5, want a whole number"),
]


@pytest.mark.parametrize(("change", "message"), WRONG, ids=[str(list(change)) + m[:12] for change, m in WRONG])
def test_what_cannot_be_fitted_is_refused_in_one_line(change: dict[str, object], message: str) -> None:
    corners = np.random.default_rng(0).normal(size=(34, 3, 3))
    triangles = [{"vertices": each.tolist(), "material": "a"} for each in corners]
    camera = {"position": [0, 0, 9], "width": 8, "height": 6}
    material = {"a": {"type": "diffuse", "albedo": [0.5, 0.5, 0.5]}}
    scene = jaxrt.build(
        {"camera": camera, "materials": material, "triangles": triangles, "environment": {"radiance": [1, 1, 1]}}
    )
    arguments = {"target": TARGET, "parameters": ["camera.fov"]} | change
    with pytest.raises(ValueError, match=message) as refusal, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        jaxrt.fit(scene, **arguments)
    assert "\n" not in str(refusal.value)


def test_a_killed_run_leaves_its_last_good_state(folder: Path) -> None:
    flags = {"XLA_FLAGS": f"{os.environ.get('XLA_FLAGS', '')} --xla_backend_optimization_level=0"}
    environment = os.environ | flags | {"PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(folder / "cache")}
    child = subprocess.Popen(
        [sys.executable, "-m", "jaxrt", *command("--max-steps", "100000")],
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
    )
    assert child.stderr is not None
    for line in child.stderr:
        if line.startswith("jaxrt: step 3:"):
            break
    child.send_signal(signal.SIGKILL)
    child.stderr.close()
    child.wait()
    scene = jaxrt.load_scene("ball.toml")
    unknowns = unknowns_of(scene, {"materials.albedo[ball]": parse_selector("materials.albedo[0]", scene)})
    progress = read_progress(Path("out/fit.json"), unknowns)
    assert len(progress.losses) >= 2 and progress.losses[-1] < progress.losses[0]
    fitted = jaxrt.parameters(jaxrt.load_scene("out/fitted.toml"))["materials.albedo"][0]
    assert float(jnp.abs(fitted - 0.5).max()) > 0.01


def test_fit_warns_of_what_derivatives_lack(folder: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    """Once, before it starts, in one line; none for a colour. The solver itself is left out."""

    def start(problem: Problem, *options, report, **more) -> None:
        progress = Progress(1, 0, problem.unknowns.vector(problem.scene), 0.5, (0.5,))
        report(Step(1, 1, 1, 0.5, True, problem.unknowns.values(progress.vector), None, progress))
        raise FitError("fit: begun")

    package = sys.modules["jaxrt.fit"]
    monkeypatch.setattr(package, "Machine", lambda problem: problem)
    monkeypatch.setattr(package, "descend", start)
    sky = "[environment]\nradiance = [1, 1, 1]\n"
    other = '[[spheres]]\ncenter = [3, 0, 0]\nradius = 2\nmaterial = "silver"\n[materials.silver]\ntype = "mirror"\n'
    Path("ball.toml").write_text(SCENE.replace("max_depth = 1", "max_depth = 2") + other + sky)
    more = ("spheres.center[1]", "camera.fov", "lights.position[0]")
    assert cli.main([*command()[:5], *more, "-o", "out"]) == 2
    (warning,) = [line for line in capsys.readouterr().err.splitlines() if "warning" in line]
    assert f"lack, for spheres.center[1], camera.fov: {CROSSING}, {SPECULAR}. " in warning
    assert "gradcheck of spheres.center[1]" in warning and "albedo" not in warning
    told = json.loads((folder / "out/fit.json").read_text())["parameters"]
    assert told["camera.fov"]["derivative_lacks"] == [CROSSING, SPECULAR]
    assert told["materials.albedo[ball]"]["derivative_lacks"] == told["lights.position[0]"]["derivative_lacks"] == []
    assert cli.main(command()) == 2
    assert "warning" not in capsys.readouterr().err


@jaxrt.camera
class Periscope:
    """A camera of which a plain number moves outlines."""

    position: Place
    zoom: Positive = 1.0
    is_central = True

    def ray(self, image, u):
        return Ray(self.position, normalize(jnp.stack([*(x * self.zoom for x in image), jnp.ones_like(image[0])])))

    def project(self, point):
        away = point - self.position
        return (away[0] / self.zoom, away[1] / self.zoom), away[2] > 0


@pytest.mark.parametrize(
    ("name", "edges"),
    [
        ("camera.zoom", 64),
        ("camera.position", 64),
        ("spheres.radius", 64),
        ("lights.position", 64),
        ("lights.intensity", 0),
        ("materials.ior", 64),
    ],
)
def test_edges_are_sampled_for_all_that_moves_them(name: str, edges: int) -> None:
    scene = jaxrt.build(
        {
            "camera": {"type": "periscope", "position": [0, 0, -9], "width": 4, "height": 4},
            "materials": {"clear": {"type": "glass", "ior": 1.5}},
            "spheres": [{"center": [0, 0, 0], "radius": 1, "material": "clear"}],
            "lights": [{"position": [0, 9, -9], "intensity": 1, "radius": 0.5}],
        }
    )
    unknowns, picture = unknowns_of(scene, {name: parse_selector(name, scene)}), jnp.ones((4, 4, 3))
    assert Problem(scene, unknowns, picture, picture).edges == edges


REFUSED = [
    (("--parameters", "materials.albedo[bal]"), "no material of that name"),
    (("--parameters", "meshes.vertices[0]"), "no such parameter"),
    (("--resume",), "out/fit.json: no such file: nothing to resume"),
]


@pytest.mark.parametrize(("more", "message"), REFUSED)
def test_bad_arguments_are_refused(folder: Path, capsys, more: tuple[str, ...], message: str) -> None:
    assert cli.main(command(*more)) == 2
    assert message in capsys.readouterr().err


def test_reports_of_other_fits_are_not_resumed(folder: Path) -> None:
    scene = jaxrt.load_scene("ball.toml")
    unknowns = unknowns_of(scene, {"camera.fov": parse_selector("camera.fov", scene)})
    (folder / "fit.json").write_text('{"parameters": {"x": {}}, "progress": {"vector": [1], "losses": [], "stage": 0}}')
    with pytest.raises(FitError, match="of another fit, of x"):
        read_progress(folder / "fit.json", unknowns)
    (folder / "fit.json").write_text("[]")
    with pytest.raises(FitError, match="no report of a fit"):
        read_progress(folder / "fit.json", unknowns)


@pytest.mark.usefixtures("quick_compilation")
def test_smooth_textures_go_on_where_no_picture_shows_them():
    """Texels that are seen stay as they are; the others lie between their neighbours, and errors tell them apart."""
    truth = np.asarray([[[0.3], [0.6], [0.5], [0.7]], [[0.5], [0.4], [0.6], [0.2]]]) * np.ones(3)
    wall = {"vertices": [[-1, -1, 0], [3, -1, 0], [3, 1, 0], [-1, 1, 0]], "faces": [[0, 1, 2], [0, 2, 3]]}

    def scene(texels):
        return jaxrt.build({
            "camera": {"position": [0, 0, 4], "target": [0, 0, 0], "fov": 30, "width": 8, "height": 8},
            "textures": {"wood": {"texels": texels, "wrap": "clamp"}},
            "materials": {"paint": {"type": "diffuse", "albedo": "wood"}},
            "meshes": [wall | {"uv": [[0, 0], [1, 0], [1, 1], [0, 1]], "material": "paint"}],
            "lights": [{"position": [0, 0, 4], "intensity": [30, 30, 30]}],
            "render": {"spp": 4, "max_depth": 1},
        })  # fmt: skip

    grey = scene(np.full_like(truth, 0.5))
    answer = jaxrt.fit(grey, jaxrt.render(scene(truth), 9, spp=64), ["textures.wood"], smoothness=1e-3, max_steps=12)
    found, errors = (np.asarray(x["textures.wood"]) for x in (answer.values, answer.errors))
    np.testing.assert_allclose(found[:, :2], truth[:, :2], atol=0.02)
    # The last column is between the seen one beside it and the mean of what is seen, as far as noise lets it
    assert (errors[:, 3] > 5 * errors[:, 0]).all() and np.isfinite(errors).all()
    assert np.abs(found[:, 3] - found[:, 2]).max() < 0.1 < np.abs(found[0, 3] - truth[0, 3]).min()


@pytest.mark.parametrize("bad", [0, -1, np.nan, "much", True])
def test_smoothness_is_a_number_above_0(bad):
    scene = jaxrt.load_scene(ROOT / "scenes/ball_on_floor.toml")
    with pytest.raises(FitError, match="smoothness"):
        differences(scene, sought(scene, ["lights.intensity[0]"]), bad)
    with pytest.raises(FitError, match="texels"):
        differences(scene, sought(scene, ["lights.intensity[0]"]), 0.01)
