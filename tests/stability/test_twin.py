"""Every scene in float32 and in float64 with the same random numbers: what precision alone does to a picture.

Two scenes, which between them have all kinds of things but meshes, are drawn in every run; the others, each of which
costs two compilations, for the page that lists them all.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrt
from jaxrt.io.scene_file import read_description
from tests.stability.report import TWIN

ROOT = Path(__file__).parent.parent.parent
SIZE, SPP = (48, 32), 16
ALWAYS = {"scenes/room.toml", "scenes/seed/several_balls_and_triangles.toml"}
SCENES = sorted(str(path.relative_to(ROOT)) for path in (ROOT / "scenes").rglob("*.toml"))
WHY = {
    "scenes/seed/several_balls_and_triangles.toml": "one of the pixel's 16 samples, up to 4 % off: a path of up to six "
    "events by curved mirrors and glass, each of which magnifies rounding; with two events no pixel is off",
    "scenes/rough_balls.toml": "one of the pixel's 16 samples: a path of up to four events by narrow highlights of "
    "curved metal, each of which magnifies rounding; with two events no pixel is off by 1e-4",
    "scenes/rough_glass.toml": "one of the pixel's 16 samples: a path of up to seven events by curved glass, each of "
    "which magnifies rounding, to the other side of a tile's edge; with two events no pixel is off by 1e-4",
}
# Pixels; which paths are magnified most is up to the processor's rounding
LIMIT = {"scenes/seed/several_balls_and_triangles.toml": 4, "scenes/rough_balls.toml": 2, "scenes/rough_glass.toml": 10}


@pytest.fixture
def twin(record_property: Callable[[str, object], None]) -> Callable[..., None]:
    """Return the function that states what a scene's twins differ by."""
    return lambda **figures: record_property(TWIN, figures)


def picture(scene: str, dtype: object) -> np.ndarray:
    width, height = SIZE
    built = jaxrt.build(read_description(ROOT / scene), dtype)
    small = replace(built, camera=replace(built.camera, width=width, height=height))
    return np.asarray(jaxrt.render(small, 7, spp=SPP, devices=jax.devices()[:1]))


@pytest.mark.filterwarnings("ignore::jaxrt.SceneWarning")
@pytest.mark.parametrize(
    "scene",
    [pytest.param(s, marks=() if s in ALWAYS else pytest.mark.report) for s in SCENES],
    ids=lambda s: Path(s).stem,
)
def test_twins_agree(twin, scene):
    """To 1e-3 of the mean, in all pixels but those that are listed and explained."""
    single = picture(scene, jnp.float32)
    with jax.enable_x64(True):
        double = picture(scene, jnp.float64)
    assert single.dtype == np.float32 and double.dtype == np.float64 and np.any(single != double)
    error = np.abs(single - double).max(-1) / double.mean()
    off, limit = int(np.sum(error > 1e-3)), LIMIT.get(scene, 0)
    figures = {"off": off, "median": float(np.median(error)), "largest": float(error.max()), "limit": f"{limit} off"}
    twin(scene=scene, pixels=f"{SIZE[0]} × {SIZE[1]}", samples=SPP, why=WHY.get(scene, ""), **figures)
    assert off <= limit and np.median(error) < 1e-5, np.argwhere(error > 1e-3)
