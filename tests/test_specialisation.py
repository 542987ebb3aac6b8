"""What a scene lacks is not in its program; values alone never make a new one."""

import jax
import jax.numpy as jnp
import pytest

import jaxrt
from benchmarks.ladder import LADDER, build, count, equations, forced, program
from jaxrt.render import draw_sum, prepare

# Equations of each rung's program, and the JAX that wrote them; to make them anew, see HOW_TO
COUNTED_WITH = "0.10.1"
COUNTS = {
    "base": 2725,
    "mirror": 2761,
    "glass": 2865,
    "triangles": 4052,
    "sphere light": 2950,
    "two lights": 2773,
    "environment": 2730,
    "mesh": 8220,
    "smooth mesh": 8789,
    "everything": 9255,
    "no light": 2305,
}
ELSEWHERE = 0.1  # by how much a rung's share of "everything" may differ in another JAX, which writes other equations

HOW_TO = """The program of {name!r} has {now} equations, {stored} are stored. A feature that a scene does not have must
add nothing to its program: make it `None` there. If all of the change is meant, paste what
`python -m benchmarks.specialisation --counts` prints into tests/test_specialisation.py; of a new feature, only scenes
that have it may grow."""


@pytest.mark.parametrize("name", list(LADDER))
def test_programs_have_their_stored_counts(name: str) -> None:
    now, stored = count(program(name)), COUNTS[name]
    message = HOW_TO.format(name=name, now=now, stored=stored)
    if jax.__version__ == COUNTED_WITH:
        assert now == stored, message
    else:
        share = now / count(program("everything"))
        assert share == pytest.approx(stored / COUNTS["everything"], rel=ELSEWHERE), message


@pytest.mark.parametrize("name", [n for n in LADDER if n not in ("base", "no light")])
def test_each_feature_adds_equations(name: str) -> None:
    assert count(program("no light")) < count(program("base")) < count(program(name))


@pytest.mark.parametrize("name", [n for n in LADDER if n != "everything"])
def test_no_program_is_as_large_as_everything(name: str) -> None:
    assert count(program(name)) < count(program("everything"))


def test_forcing_every_feature_in_makes_everything_of_the_base() -> None:
    scene, run, plan = prepare(build(forced(LADDER["base"])), 0, 0, 1, 1, devices=jax.devices()[:1])
    traced = jax.make_jaxpr(lambda scene, run: draw_sum.__wrapped__(scene, run, plan))(scene, run)
    assert count(traced) == pytest.approx(count(program("everything")), rel=0.01)


def functions(name: str) -> set[str]:
    """Return the names of jaxrt's functions that the program of a scene was traced from."""
    found = set()
    for equation in equations(program(name).jaxpr):
        traceback = equation.source_info.traceback
        for frame in traceback.frames if traceback else ():
            if "/jaxrt/" in frame.file_name:
                found.add(f"{frame.file_name.split('/jaxrt/')[-1]}:{frame.function_name}")
    return found


MESHES, TRIANGLES = {"mesh", "smooth mesh", "everything"}, {"triangles", "mesh", "smooth mesh", "everything"}

# Functions, or whole files, that only the scenes named may be traced from
OWNERS = {
    "materials/mirror.py": {"mirror", "everything"},
    "materials/glass.py": {"glass", "everything"},
    "shapes/triangle.py": TRIANGLES,
    "shapes/search/boxes.py": MESHES,
    "shapes/search/traverse.py": MESHES,
    "shapes/smooth.py": {"smooth mesh", "everything"},
    "lights/__init__.py:emitted_radiance": {"sphere light", "everything"},
    "core/sampling.py:sample_cone": {"sphere light", "everything"},
    "lights/pick.py:pick": {"two lights", "everything"},
    "lights/__init__.py:_sample": set(LADDER) - {"no light"},
    "transport/path.py:_direct": set(LADDER) - {"no light"},
}


@pytest.mark.parametrize("name", list(LADDER))
def test_no_operation_of_what_is_absent(name: str) -> None:
    found = functions(name)
    for owner, scenes in OWNERS.items():
        present = any(f.startswith(owner) for f in found)
        assert present == (name in scenes), f"{owner} in the program of {name!r}: {present}"


def test_cumulative_pick_only_for_several_lights() -> None:
    found = {name: {f"{e.primitive}" for e in equations(program(name).jaxpr)} for name in ("base", "two lights")}
    assert "cumsum" in found["two lights"] - found["base"]


def test_one_program_for_many_values() -> None:
    scene = build(LADDER["sphere light"])
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
