"""A ladder of scenes, from one sphere under one point light up to everything; and how large their programs are."""

import warnings
from collections.abc import Iterator
from functools import cache
from typing import Any

import jax
from jax.extend import core

import jaxrt
from benchmarks.mesh_rays import bumpy_sphere
from jaxrt.render import draw_sum, prepare

DEPTH = 3  # scattering events of the programs that are counted: any number gives the same program

WHITE = {"type": "diffuse", "albedo": [0.8, 0.8, 0.8]}
POINT = {"position": [-10, 20, 40], "intensity": 3000}
BASE: dict[str, Any] = {
    "camera": {"position": [0, 0, 30], "width": 8, "height": 8},
    "materials": {"white": WHITE},
    "spheres": [{"center": [0, 0, 0], "radius": 10, "material": "white"}],
    "lights": [POINT],
}

MIRROR, GLASS = {"type": "mirror"}, {"type": "glass", "ior": 1.5}
TRIANGLE = {"vertices": [[-12, -12, -5], [12, -12, -5], [0, -12, 15]], "material": "white"}
SPHERE_LIGHT = POINT | {"radius": 5}
SECOND_LIGHT = POINT | {"position": [10, 20, 40]}
ENVIRONMENT = {"radiance": [0.1, 0.1, 0.1]}
BUMPS = bumpy_sphere(2)


def mesh(smooth: bool, scale: float = 5.0, place: tuple[float, float, float] = (-11, -3, 8)) -> dict[str, Any]:
    """Return a mesh of 320 faces: enough for a tree."""
    vertices, faces = BUMPS
    where = {"scale": scale, "translate": place, "smooth": smooth}
    return {"vertices": vertices, "faces": faces, "material": "white"} | where


def ball(material: str, x: float) -> dict[str, Any]:
    """Return a ball beside the white one."""
    return {"center": [x, 0, 8], "radius": 5, "material": material}


def with_ball(kind: dict[str, Any]) -> dict[str, Any]:
    """Return the base with a ball of another material."""
    extra = {"materials": {"white": WHITE, "extra": kind}, "spheres": [*BASE["spheres"], ball("extra", 11)]}
    return BASE | extra


LADDER: dict[str, dict[str, Any]] = {
    "base": BASE,
    "mirror": with_ball(MIRROR),
    "glass": with_ball(GLASS),
    "triangles": BASE | {"triangles": [TRIANGLE]},
    "sphere light": BASE | {"lights": [SPHERE_LIGHT]},
    "two lights": BASE | {"lights": [POINT, SECOND_LIGHT]},
    "environment": BASE | {"environment": ENVIRONMENT},
    "mesh": BASE | {"meshes": [mesh(smooth=False)]},
    "smooth mesh": BASE | {"meshes": [mesh(smooth=True)]},
    "everything": BASE
    | {
        "materials": {"white": WHITE, "mirror": MIRROR, "glass": GLASS},
        "spheres": [*BASE["spheres"], ball("mirror", 11), ball("glass", 2)],
        "triangles": [TRIANGLE],
        "meshes": [mesh(smooth=True)],
        "lights": [SPHERE_LIGHT, SECOND_LIGHT],
        "environment": ENVIRONMENT,
    },
    "no light": {k: v for k, v in BASE.items() if k != "lights"},
}


def forced(description: dict[str, Any]) -> dict[str, Any]:
    """Return the scene with every feature in it, and the same picture: what it lacks is there, and is not seen.

    The environment is black; a mirror ball, one of glass, a smooth mesh and a dark sphere light lie inside the white
    ball. A dark light takes 1/200 of the light samples, so pixels change by that much noise.
    """
    materials = {"inert mirror": MIRROR, "inert glass": GLASS}
    inert = [{"center": [0, y, 0], "radius": 0.5, "material": name} for y, name in zip((5, -5), materials, strict=True)]
    dark = {"position": [-5, 0, 0], "intensity": 0, "radius": 0.5}
    return (
        {"environment": {"radiance": [0, 0, 0]}}
        | description
        | {
            "materials": description["materials"] | materials,
            "spheres": [*description.get("spheres", []), *inert],
            "meshes": [*description.get("meshes", []), mesh(smooth=True, scale=0.5, place=(5, 0, 0))],
            "lights": [*description.get("lights", []), dark],
        }
    )


def build(description: dict[str, Any], **camera: Any) -> jaxrt.Scene:
    """Return the scene, with changes to its camera; warnings are left out."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jaxrt.SceneWarning)  # glass under a point light, and no light at all
        return jaxrt.build(description | {"camera": description["camera"] | camera})


@cache
def program(name: str) -> core.ClosedJaxpr:
    """Return the program of a rung, as `render` traces it for one device."""
    scene, run, plan = prepare(build(LADDER[name]), 0, 0, 1, 1, max_depth=DEPTH, devices=jax.devices()[:1])
    return jax.make_jaxpr(lambda scene, run: draw_sum.__wrapped__(scene, run, plan))(scene, run)


def equations(jaxpr: core.Jaxpr) -> Iterator[core.JaxprEqn]:
    """Return all equations, those of inner programs included; of a part that is called twice, twice."""
    for equation in jaxpr.eqns:
        yield equation
        for inner in core.jaxprs_in_params(equation.params):
            yield from equations(inner)


def count(traced: core.ClosedJaxpr) -> int:
    """Return how many equations a program has, but for marks of where stages begin, which compile to nothing."""
    return sum(e.primitive.name != "enter_stage" for e in equations(traced.jaxpr))
