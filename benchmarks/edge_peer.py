"""Mitsuba's own test configurations of moving edges: its derivatives and ours beside the same finite differences.

    python -m benchmarks.edges --peer-configurations [--peer-python PATH]

The configurations are those "with discontinuities" of `src/integrators/tests/test_ad_integrators.py` that scenes of
jaxrt can express, drawn anew from their words, 32×32, both renderers from one scene file. Not expressible is the
rectangle that emits: no mesh of jaxrt does. Emitting spheres are sphere lights here, meshes there; others are meshes,
flat here, smooth there. The glossy floor has facets of GGX, not of Beckmann, and the texture is a random one.

Both errors are of the mean of 4 seeds, 1,024 samples a pixel in all, as Mitsuba's tests mostly take. `pixels` is its
measure, the mean of |d − fd| / max(|fd|, 0.2) over pixels and channels, beside its threshold; `bumps` is ours, the
relative L2 distance of nine smooth bumps. `noise` is what each would be if the expectation were right.
Configurations with one * are switched off in Mitsuba's list, those with two it does not try with these integrators.
"""

import argparse
import json
import math
import subprocess
import tempfile
import warnings
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from rich.console import Console

import jaxrt
from benchmarks.edge_rows import bumps, noise_of
from benchmarks.processes import HERE, find_peer, flags
from tests.meshes import icosphere

SIZE, SPP, SEEDS = 32, 256, 4  # samples a pixel, of each kind of edge too, as Mitsuba takes them
FD_SPP, FD_KEYS, FD_FIRST, STEP = 512, 16, 100_000, 0.002
LEAST = 0.2  # of the finite differences, in Mitsuba's measure
SIGMA = 4  # standard errors that are still noise
SAME, RIGHT = 0.002, 0.05  # of pictures that agree and of derivatives that are right, by their bumps and besides noise
INTEGRATORS = ("direct_projective", "prb_projective")

Description = dict[str, Any]
Pictures = np.ndarray  # (seeds, H, W, 3)

MATERIALS: dict[str, Description] = {
    "grey": {"type": "diffuse", "albedo": [0.5] * 3},
    "orange": {"type": "diffuse", "albedo": [1, 0.5, 0]},
    "painted": {"type": "diffuse", "albedo": "paint.exr"},
    # Its α is .025, and all light is reflected
    "glossy": {
        "type": "conductor",
        "eta": [1e-3] * 3,
        "k": [1] * 3,
        "roughness": 0.025**0.5,
        "compensation": False,
    },
}
TEXELS = np.random.default_rng(0).uniform(size=(16, 16, 3))
QUAD = np.asarray([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float), np.asarray([[0, 1, 2], [0, 2, 3]])
SHAPES = {"quad.obj": QUAD, "ball.obj": icosphere(2)}


class Configuration(NamedTuple):
    """A scene, what moves in it, and how far Mitsuba's test lets derivatives be off."""

    name: str
    threshold: float
    moved: dict[str, Description]  # name of Mitsuba's half -> parameters of ours, and along what they move
    meshes: tuple[Description, ...] = ()
    lights: tuple[Description, ...] = ()
    sky: float = 0
    motion: str = "translate"  # along x, or scale about the origin
    depth: int = 1

    @property
    def tables(self) -> list[tuple[str, Description]]:
        """Return the tables of the scene file, with their heads."""
        camera = {"position": [0, 0, 4], "target": [0, 0, 0], "fov": 39.3077, "width": SIZE, "height": SIZE}
        tables = [("[camera]", camera), ("[render]", {"max_depth": self.depth})]
        for name in dict.fromkeys(mesh["material"] for mesh in self.meshes):
            tables.append((f"[materials.{name}]", MATERIALS[name]))
        for i, mesh in enumerate(self.meshes):
            tables.append(("[[meshes]]", {"name": f"mesh_{i}", **mesh}))
        tables += [("[[lights]]", light) for light in self.lights]
        return tables + ([("[environment]", {"radiance": [self.sky] * 3})] if self.sky else [])


def bright(position: list[float], radius: float, radiance: float) -> Description:
    """Return a sphere light of this radiance."""
    return {"position": position, "radius": radius, "intensity": [radiance * math.pi * radius**2] * 3}


X = [1.0, 0, 0]
LIGHT = {"light_0": {"lights.position": X}}
GROWING = {"light_0": {"lights.radius": 1, "lights.intensity": 2 * math.pi}}  # of radius 1 and radiance 1, which stays
FIRST, SECOND = ({name: {f"meshes.vertices[{name}]": X}} for name in ("mesh_0", "mesh_1"))
CAMERA = {"sensor": {"camera.position": X, "camera.target": X}}
BALL, WALL = {"file": "ball.obj", "material": "grey"}, {"file": "quad.obj", "material": "grey"}
OCCLUDER = BALL | {"scale": 0.25, "translate": [2, 0, 2]}
UPRIGHT = WALL | {"rotate": [0, 90, 0], "translate": [-1, 0, 0.5]}
LAMP = {"position": [-4, 0, 6], "intensity": [5, 0, 0]}
PAINTED = WALL | {"scale": 2, "material": "painted"}
GLOSSY = WALL | {"scale": 4, "rotate": [-45, 0, 0], "translate": [0, 1.5, 0], "material": "glossy"}
ORANGE = BALL | {"translate": [0.5, 2, 1.5], "material": "orange"}

CONFIGURATIONS = (
    Configuration("diffuse sphere under a sky, x *", 0.04, FIRST, (BALL,), sky=1.0),
    Configuration("diffuse rectangle under a sky, x *", 0.02, FIRST, (WALL,), sky=1.0),
    Configuration("sphere emitter on black, x", 0.08, LIGHT, (), (bright([1.25, 0, 0], 1, 1),)),
    Configuration("sphere emitter on black, scale", 0.08, GROWING, (), (bright([0, 0, 0], 1, 1),), motion="scale"),
    Configuration("occluder before a small light, x", 0.02, SECOND, (WALL, OCCLUDER), (bright([4, 0, 4], 0.05, 1000),)),
    Configuration("shadow receiver under a sky, x *", 0.02, FIRST, (WALL, OCCLUDER), sky=1.0),
    Configuration("textured plane under a sky, x", 0.1, FIRST, (PAINTED,), sky=1.0),
    Configuration("self-shadow, lamp and sky .1, x **", 0.06, FIRST | SECOND, (WALL, UPRIGHT), (LAMP,), 0.1, depth=2),
    Configuration("sphere over a glossy floor, sky, x **", 0.25, SECOND, (GLOSSY, ORANGE), sky=1.0, depth=2),
    Configuration("camera under a sky, x *", 0.3, CAMERA, (BALL,), sky=1.0),
)


def write(configuration: Configuration, folder: Path) -> Path:
    """Return the path of the scene file, written beside its meshes."""
    jaxrt.save_image(folder / "paint.exr", TEXELS)
    for name, (vertices, faces) in SHAPES.items():
        corners = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices]
        corners += [f"vt {(x + 1) / 2:.9g} {(y + 1) / 2:.9g}" for x, y, _ in vertices]
        (folder / name).write_text("\n".join([*corners, *(f"f {a}/{a} {b}/{b} {c}/{c}" for a, b, c in faces + 1), ""]))
    path = folder / "scene.toml"
    path.write_text(text_of(configuration.tables))
    return path


def text_of(tables: list[tuple[str, Description]]) -> str:
    """Return the scene file of tables with their heads; JSON's values are TOML's."""
    rows = [[head, *(f"{key} = {json.dumps(value)}" for key, value in table.items()), ""] for head, table in tables]
    return "\n".join(line for row in rows for line in row)


class Ours:
    """Compiled programs of one configuration."""

    def __init__(self, configuration: Configuration, path: Path) -> None:
        self.depth = configuration.depth
        self.scene = jaxrt.load_scene(path)
        along = {name: value for row in configuration.moved.values() for name, value in row.items()}
        self.start = {name: jaxrt.parameters(self.scene, name) for name in along}
        self.along = {k: jnp.broadcast_to(jnp.asarray(along[k], v.dtype), v.shape) for k, v in self.start.items()}

    def draw(self, theta: Array, key: Array | int, spp: int, boundary_samples: int = 0) -> Array:
        """Return the picture (H, W, 3) of the scene moved by theta."""
        values = {name: value + theta * self.along[name] for name, value in self.start.items()}
        scene = jaxrt.with_parameters(self.scene, values)
        return jaxrt.render(scene, key, spp=spp, max_depth=self.depth, boundary_samples=boundary_samples)

    def derivatives(self) -> Pictures:
        """Return derivatives of independent seeds."""

        @jax.jit
        def slope(key: Array) -> Array:
            draw = partial(self.draw, key=key, spp=SPP, boundary_samples=SPP * SIZE**2)
            return jax.jvp(draw, (jnp.float32(0),), (jnp.float32(1),))[1]

        return np.stack([np.asarray(slope(jnp.uint32(seed)), float) for seed in range(SEEDS)])

    def ends(self) -> np.ndarray:
        """Return pictures (keys, 2, H, W, 3) a step on both sides, drawn with the same random numbers."""
        keys = range(FD_FIRST, FD_FIRST + FD_KEYS)
        steps = jnp.float32(-STEP), jnp.float32(STEP)
        return np.stack([[np.asarray(self.draw(step, key, FD_SPP), float) for step in steps] for key in keys])


def theirs(python: str, configuration: Configuration, path: Path) -> tuple[dict[str, Pictures], dict[str, str]]:
    """Return Mitsuba's pictures and its derivatives by integrator, and what the others raise."""
    integrators = INTEGRATORS[configuration.depth > 1 :]
    given = flags(motion=configuration.motion, max_depth=configuration.depth, spp=SPP, seeds=SEEDS)
    out = path.with_name("theirs.npz")
    command = [python, str(HERE / "mitsuba_edges.py"), str(path), str(out), *given, "--moved", *configuration.moved]
    done = subprocess.run([*command, "--integrators", *integrators], capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)}: exit status {done.returncode}\n{done.stderr}")
    return dict(np.load(out)), json.loads(done.stdout.strip().splitlines()[-1])


def pixels(off: np.ndarray, truth: np.ndarray) -> float:
    """Return Mitsuba's measure of a distance to the finite differences."""
    return float(np.mean(np.abs(off) / np.maximum(np.abs(truth), LEAST)))


def noises(values: Pictures, truth: np.ndarray) -> tuple[float, float]:
    """Return both measures of a mean over seeds whose expectation is right."""
    error = values.std(0, ddof=1) / len(values) ** 0.5
    return pixels(error, truth) * (2 / math.pi) ** 0.5, noise_of(bumps(values)) / float(np.linalg.norm(bumps(truth)))


def errors(values: Pictures, truth: np.ndarray) -> tuple[float, float]:
    """Return both measures of a mean over seeds."""
    off = values.mean(0) - truth
    return pixels(off, truth), float(np.linalg.norm(bumps(off)) / np.linalg.norm(bumps(truth)))


def line(name: str, values: Pictures, differences: Pictures, threshold: float) -> str:
    """Return the row of a renderer."""
    truth = differences.mean(0)
    (pixel, bump), (pixel_noise, bump_noise) = errors(values, truth), noises(values, truth)
    word = "" if pixel <= threshold else "  above its threshold"
    both = math.hypot(bump_noise, noises(differences, truth)[1])
    word += "" if bump <= RIGHT + SIGMA * both else "  WRONG"
    return f"  {name:<24}{pixel:9.4f}{pixel_noise:9.4f}{bump:9.4f}{bump_noise:9.4f}{word}"


def agreement(ours: Pictures, others: Pictures) -> str:
    """Return how far the pictures are apart, and whether that is more than noise."""
    pair = bumps(ours), bumps(others)
    size = float(np.linalg.norm(pair[0].mean(0)))
    off = float(np.linalg.norm(pair[0].mean(0) - pair[1].mean(0))) / size
    noise = math.hypot(*(noise_of(values) / size for values in pair))
    return f"  pictures {off:.4f} apart, noise {noise:.4f}" + (": NOT THE SAME" if off > SAME + SIGMA * noise else "")


HEAD = f"{'':<26}{'pixels':>9}{'noise':>9}{'bumps':>9}{'noise':>9}"


def show(configuration: Configuration, python: str | None, console: Console) -> None:
    """Print the rows of one configuration."""
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", jaxrt.SceneWarning)  # nothing but a light
        path = write(configuration, Path(folder))
        ours = Ours(configuration, path)
        others, raised = theirs(python, configuration, path) if python else ({}, {})
    ends = ours.ends()
    console.print(f"{configuration.name}, threshold {configuration.threshold}")
    if others:
        console.print(agreement(ends.mean(1), others.pop("pictures")))
    differences = np.diff(ends, axis=1)[:, 0] / (2 * STEP)
    pixel, bump = noises(differences, differences.mean(0))
    console.print(f"  {'finite differences':<24}{'':9}{pixel:9.4f}{'':9}{bump:9.4f}")
    for name, values in {"jaxrt": ours.derivatives(), **others}.items():
        console.print(line(name, values, differences, configuration.threshold))
    for name, error in raised.items():
        console.print(f"  {name:<24} raises {error}")
    if configuration.depth > 1:
        console.print(f"  {INTEGRATORS[0]:<24} has no second event")


def main(options: argparse.Namespace, console: Console) -> int:
    """Print the table, each configuration as soon as it is known."""
    python, peer = find_peer(options.peer_python)
    console.print(f"{peer}; {SIZE}×{SIZE}, {SEEDS} seeds of {SPP} samples a pixel, and as many of each kind of edge")
    console.print(HEAD)
    for configuration in CONFIGURATIONS:
        show(configuration, python, console)
    return 0
