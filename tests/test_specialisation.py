"""What a scene lacks is not in its program; values alone never make a new one."""

import warnings
from collections import Counter
from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import pytest
from jax.extend import core

import jaxrt
from jaxrt.render import draw_sum

CAMERA = {"position": [0, 0, 55], "width": 8, "height": 8}
BALL = {"center": [0, 0, 0], "radius": 10, "material": "white"}
WHITE = {"type": "diffuse", "albedo": [0.8, 0.8, 0.8]}
POINT = {"position": [-10, 20, 40], "intensity": 3000}

BASE: dict[str, Any] = {
    "camera": CAMERA,
    "materials": {"white": WHITE},
    "spheres": [BALL],
    "lights": [POINT],
}


def with_material(kind: dict[str, Any]) -> dict[str, Any]:
    extra = {"center": [20, 0, 0], "radius": 5, "material": "extra"}
    return BASE | {"materials": {"white": WHITE, "extra": kind}, "spheres": [BALL, extra]}


TRIANGLE = {"vertices": [[-9, 12, 0], [9, 12, 0], [0, 20, 0]], "material": "white"}
LADDER: dict[str, dict[str, Any]] = {
    "base": BASE,
    "mirror": with_material({"type": "mirror"}),
    "glass": with_material({"type": "glass", "ior": 1.5}),
    "triangles": BASE | {"triangles": [TRIANGLE]},
    "sphere light": BASE | {"lights": [POINT | {"radius": 5}]},
    "two lights": BASE | {"lights": [POINT, POINT | {"position": [10, 20, 40]}]},
    "environment": BASE | {"environment": {"radiance": [0.1, 0.1, 0.1]}},
    "no light": {k: v for k, v in BASE.items() if k != "lights"},
}


def build(name: str) -> jaxrt.Scene:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jaxrt.SceneWarning)  # glass under a point light, and no light at all
        return jaxrt.build(LADDER[name])


def equations(jaxpr: core.Jaxpr) -> Iterator[core.JaxprEqn]:
    for equation in jaxpr.eqns:
        yield equation
        for inner in core.jaxprs_in_params(equation.params):
            yield from equations(inner)


def program(name: str) -> Counter[str]:
    """Return how often each operation stands in the traced program; the same for a jit-cached part each time."""
    scene = build(name)
    closed = jax.make_jaxpr(lambda s: jaxrt.render(s, 0, spp=1, max_depth=3, unroll=True))(scene)
    return Counter(f"{e.primitive}" for e in equations(closed.jaxpr))


@pytest.fixture(scope="module")
def programs() -> dict[str, Counter[str]]:
    return {name: program(name) for name in LADDER}


@pytest.mark.parametrize("name", [n for n in LADDER if n not in ("base", "no light")])
def test_each_feature_adds_equations(programs: dict[str, Counter[str]], name: str) -> None:
    assert programs[name].total() > programs["base"].total()


def test_no_light_removes_equations(programs: dict[str, Counter[str]]) -> None:
    assert programs["no light"].total() < programs["base"].total()


def functions(name: str) -> set[str]:
    """Return the names of jaxrt's functions that the program of a scene was traced from."""
    closed = jax.make_jaxpr(lambda s: jaxrt.render(s, 0, spp=1, max_depth=2))(build(name))
    found = set()
    for equation in equations(closed.jaxpr):
        traceback = equation.source_info.traceback
        for frame in traceback.frames if traceback else ():
            if "/jaxrt/" in frame.file_name:
                found.add(f"{frame.file_name.split('/jaxrt/')[-1]}:{frame.function_name}")
    return found


# Functions, or whole files, that only the scenes named may be traced from
OWNERS = {
    "materials/mirror.py": {"mirror", "glass"},  # glass reflects too
    "materials/glass.py": {"glass"},
    "shapes/triangle.py": {"triangles"},
    "lights.py:emitted_radiance": {"sphere light"},
    "sampling.py:sample_cone": {"sphere light"},
    "lights.py:_pick_light": {"two lights"},
    "lights.py:sample_light": set(LADDER) - {"no light"},
    "path.py:_direct": set(LADDER) - {"no light"},
}


@pytest.mark.parametrize("name", list(LADDER))
def test_no_operation_of_what_is_absent(name: str) -> None:
    found = functions(name)
    for owner, scenes in OWNERS.items():
        present = any(f.startswith(owner) for f in found)
        assert present == (name in scenes), f"{owner} in the program of {name!r}: {present}"


def test_cumulative_pick_only_for_several_lights(programs: dict[str, Counter[str]]) -> None:
    assert programs["base"]["cumsum"] == 0 < programs["two lights"]["cumsum"]


def test_one_program_for_many_values() -> None:
    scene = build("sphere light")
    before = draw_sum._cache_size()
    pictures = []
    for value in (1.0, 2.0, 3.0):
        changes = {
            "lights.position": jnp.full((1, 3), 20 * value),
            "materials.albedo": jnp.full((1, 3), value / 4),
            "spheres.center": jnp.full((1, 3), value),
            "spheres.radius": jnp.full((1,), 8 + value),
            "camera.fov": jnp.asarray(50 + value),
        }
        other = jaxrt.with_parameters(scene, changes)
        for key, spp in ((0, 1), (jax.random.key(7), 2)):
            pictures.append(jaxrt.render(other, key, spp=spp, max_depth=1))
    assert draw_sum._cache_size() == before + 1
    assert len({float(jnp.sum(p)) for p in pictures}) == len(pictures)
