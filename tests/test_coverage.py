"""What `gradcheck` and `fit` say that a derivative lacks, and the steps of finite differences: nothing is drawn."""

import warnings

import numpy as np
import pytest

import jaxrt
from jaxrt.gradcheck.coverage import coverage
from jaxrt.gradcheck.steps import default_step
from jaxrt.scene.selectors import select

MATERIALS = {
    "silver": {"type": "mirror", "albedo": [0.9, 0.9, 0.9]},
    "white": {"type": "diffuse", "albedo": [0.8, 0.7, 0.6]},
    "crown": {"type": "glass", "ior": 1.5},
}


def ball(center, radius=1.0, material="white"):
    return {"center": center, "radius": radius, "material": material}


def box(low, high, **more):
    corners = [[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)]
    places = (np.array(low) + np.array(corners) * (np.array(high) - low)).tolist()
    faces = [[0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4]]
    faces += [[2, 6, 7], [2, 7, 3], [0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5]]
    return {"vertices": places, "faces": faces, "material": "white"} | more


def kinds(depth=1, lights=(), sky=None, **shapes):
    """Return a scene of these shapes, seen from (0, 3, 8)."""
    table = {"camera": {"position": [0, 3, 8], "target": [0, 0, 0], "width": 8, "height": 8}, "lights": list(lights)}
    table |= {"materials": MATERIALS, "render": {"max_depth": depth}, **shapes}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return jaxrt.build(table | ({} if sky is None else {"environment": {"radiance": [sky] * 3}}))


def floor(y, material="white"):
    a, b, c, d = [-20, y, 20], [20, y, 20], [20, y, -20], [-20, y, -20]
    return [{"vertices": corners, "material": material} for corners in ([a, b, c], [a, c, d])]


LAMP, BULB = {"position": [0, 5, 4], "intensity": 9}, {"position": [0, 5, 4], "intensity": 9, "radius": 0.5}
WALLS = [ball([0, -1000, 0], 990), ball([0, 1000, 0], 940), ball([-1000, 0, 0], 940), ball([1000, 0, 0], 940)]
WIDE = ball([0, -1e6, 0], 1e6)
MIRROR = [{"vertices": [[-6, 0, -2], [6, 0, -2], [0, 9, -2]], "material": "silver"}]
CROSSING, SKY = "curves where surfaces cross", "outlines before the sky as diffuse surfaces see them"
INDIRECT = "edges in indirect light of moving shapes or cameras"
SPECULAR = "edges seen in mirrors and through glass"
SHAPES = ("spheres.center", "spheres.radius", "camera.position", "camera.target", "camera.fov")
LIGHTS = ("lights.position", "lights.radius")


def missing(places, *terms, row=0):
    return {(name, None if name.startswith("camera.") else row): set(terms) for name in places}


MISSING = {
    # The sky
    "hovering under a sky": (kinds(spheres=[ball([0, 1.2, 0])], triangles=floor(0), sky=1), missing(SHAPES, SKY)),
    "deeper": (kinds(2, spheres=[ball([0, 1.2, 0])], triangles=floor(0), sky=1), missing(SHAPES, SKY, INDIRECT)),
    "the floor's corner": (
        kinds(spheres=[ball([0, 1.2, 0])], triangles=floor(0), sky=1),
        missing(["meshes.vertices"], SKY),
    ),
    "a black sky": (kinds(spheres=[ball([0, 1.2, 0])], triangles=floor(0), sky=0), missing(SHAPES)),
    "a lamp instead": (kinds(spheres=[ball([0, 1.2, 0])], triangles=floor(0), lights=[LAMP]), missing(SHAPES)),
    "two boxes": (
        kinds(meshes=[box([0, 0, 0], [1, 1, 1]), box([3, 0, 0], [4, 1, 1])], sky=1),
        missing(["meshes.vertices", "camera.fov"], SKY),
    ),
    "a bulb under the sky": (
        kinds(triangles=floor(0), lights=[BULB], sky=1),
        missing(LIGHTS) | missing(["camera.fov"], SKY),
    ),
    "a bulb in indirect light": (kinds(2, triangles=floor(0), lights=[BULB]), missing(LIGHTS)),
    # What nothing else sees
    "a ball alone": (kinds(3, spheres=[ball([0, 0, 0])], sky=1), missing(SHAPES)),
    "a cube alone": (
        kinds(3, meshes=[box([-1, -1, -1], [1, 1, 1], rotate=[20, 30, 0])], sky=1),
        missing(["meshes.vertices", "camera.position"]),
    ),
    "a plane alone": (kinds(3, triangles=floor(0), sky=1), missing(["meshes.vertices", "camera.position"])),
    "a box from inside": (
        kinds(3, meshes=[box([-9, -9, -9], [9, 9, 9])], lights=[LAMP]),
        missing(["meshes.vertices", "camera.position"], INDIRECT),
    ),
    # Crossing surfaces
    "a half-sunk ball": (
        kinds(spheres=[ball([0, 0, 0])], triangles=floor(0), lights=[LAMP]),
        missing([*SHAPES, "meshes.vertices"], CROSSING) | missing(["lights.position"]),
    ),
    "a ball that rests": (
        kinds(spheres=[ball([0, 0.7, 0], 0.7), ball([0, -1000, 0], 1000)], triangles=floor(0), lights=[LAMP]),
        missing(SHAPES),
    ),
    "a ball in a ball": (kinds(spheres=[ball([0, 0, 0]), ball([0.2, 0, 0], 0.5)], lights=[LAMP]), missing(SHAPES)),
    "a huge floor": (
        kinds(spheres=[ball([3, 0.2, 0], 0.4), WIDE], lights=[LAMP]),
        missing(SHAPES, CROSSING),
    ),
    "above a huge floor": (kinds(spheres=[ball([3, 0.41, 0], 0.4), WIDE], lights=[LAMP]), missing(SHAPES)),
    "a cube in a huge floor": (
        kinds(spheres=[WIDE], meshes=[box([0, -0.5, 0], [1, 0.5, 1])], lights=[LAMP]),
        missing([*SHAPES, "meshes.vertices"], CROSSING),
    ),
    "a cube on a plane": (
        kinds(triangles=floor(0), meshes=[box([0, 0, 0], [1, 1, 1])], lights=[LAMP]),
        missing(["meshes.vertices", "camera.fov"]),
    ),
    "a cube through a plane": (
        kinds(triangles=floor(0.5), meshes=[box([0, 0, 0], [1, 1, 1])], lights=[LAMP]),
        missing(["meshes.vertices", "camera.fov"], CROSSING),
    ),
    "a room of balls": (
        kinds(spheres=WALLS, lights=[LAMP]),
        missing(SHAPES, CROSSING) | missing(["lights.position"]),
    ),
    "a ball beside two that cross": (
        kinds(spheres=[ball([-4, 0, 0]), ball([2, 0, 0]), ball([3, 0, 0])], lights=[LAMP]),
        missing(SHAPES[:2])
        | missing(SHAPES[2:], CROSSING)
        | missing(SHAPES[:2], CROSSING, row=1)
        | missing(SHAPES[:2], CROSSING, row=None),
    ),
    "a bulb sunk in the wall": (
        kinds(spheres=WALLS[:1], triangles=floor(5.2), lights=[BULB, LAMP]),
        missing([*LIGHTS, "camera.fov", "meshes.vertices"], CROSSING)
        | missing(["lights.position"], row=1)
        | missing(["spheres.center"]),
    ),
    # Mirrors and glass
    "seen in a mirror": (
        kinds(3, spheres=[ball([0, 1, 7.5], 0.8)], triangles=MIRROR, lights=[LAMP]),
        missing(SHAPES, SPECULAR, INDIRECT) | missing(["lights.position"], SPECULAR),
    ),
    "no event left": (
        kinds(1, spheres=[ball([0, 1, 7.5], 0.8)], triangles=MIRROR, lights=[LAMP]),
        missing([*SHAPES, "lights.position"]),
    ),
    "a bulb in a mirror": (kinds(triangles=MIRROR, lights=[BULB]), missing([*LIGHTS, "camera.fov"], SPECULAR)),
    "a glass ball": (
        kinds(2, spheres=[ball([0, 0, 0], material="crown")], sky=1),
        missing(SHAPES, SPECULAR) | missing(["materials.ior"], "edges seen through glass"),
    ),
}
COLOURS = {"materials.albedo": 0, "lights.intensity": 0, "environment.radiance": None}


@pytest.mark.parametrize("kind", MISSING)
def test_what_is_missing_is_told_where_it_is_missing(kind):
    scene, expected = MISSING[kind]
    there = jaxrt.parameters(scene)
    expected = expected | {(name, row): set() for name, row in COLOURS.items() if name in there}
    found = {
        (name, row): set(coverage(scene, name, scene.defaults.max_depth, 9, row).missing) for name, row in expected
    }
    assert found == expected and {name for name, _ in expected} <= set(there)


# Steps


@pytest.mark.parametrize(
    ("scene", "name", "row", "step"),
    [
        # Nothing is small or near: 1 % of the distance that the camera looks over
        (kinds(spheres=[WIDE], lights=[LAMP]), "lights.position", 0, 0.01 * 20**0.5),
        (kinds(spheres=[ball([0, 0, 0])], triangles=floor(0)), "spheres.center", 0, 0.05),
        (kinds(spheres=[ball([0, 0, 0])], triangles=floor(0)), "spheres.radius", 0, 0.02),
        (kinds(spheres=[ball([0, 0, 0], 0.1)], triangles=floor(0)), "spheres.center", 0, 0.005),
        # On the way to where it touches: from above, and sunk by as much
        (kinds(spheres=[ball([0, 1.2, 0])], triangles=floor(0)), "spheres.center", 0, 0.01),
        (kinds(spheres=[ball([0, 0.8, 0])], triangles=floor(0)), "spheres.center", 0, 0.01),
        (kinds(spheres=[ball([0, 1, 0]), ball([2.2, 1, 0])]), "spheres.center", 1, 0.01),
        (kinds(spheres=[ball([0, 1, 0], 2), ball([0.8, 1, 0])]), "spheres.center", 1, 0.01),
        # What touches already says nothing
        (kinds(spheres=[ball([0, 1, 0])], triangles=floor(0)), "spheres.center", 0, 0.05),
        (kinds(triangles=floor(4), lights=[BULB]), "lights.position", 0, 0.025),
        (kinds(triangles=floor(4.8), lights=[LAMP]), "lights.position", 0, 0.01),
        (kinds(triangles=floor(2.8)), "camera.position", None, 0.01),
        (kinds(meshes=[box([0, 0, 0], [0.2, 1, 1])]), "meshes.vertices", 0, 0.01),
    ],
)
def test_steps_are_small_against_what_moves(scene, name, row, step):
    assert default_step(scene, select(scene, name, row), 1.0) == pytest.approx(step, rel=1e-4)
