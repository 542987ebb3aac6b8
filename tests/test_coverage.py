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
CROSSING, SUNK = (
    "curves where surfaces cross, as diffuse surfaces see them",
    "curves where lights are sunk into surfaces",
)
SPECULAR = "edges that diffuse surfaces see in mirrors and through glass"
BEHIND = "caustics and indirect shadows seen in mirrors and through glass"
SHAPES = ("spheres.center", "spheres.radius", "camera.position", "camera.target", "camera.fov")
LIGHTS = ("lights.position", "lights.radius")


def missing(places, *terms, row=0):
    return {(name, None if name.startswith("camera.") else row): set(terms) for name in places}


HOVERING, SUNK_BALL = ball([0, 1.2, 0]), ball([0, 0, 0])
MISSING = {
    # Outlines are all there, and are seen from everywhere: by spheres and meshes, under a sky and in indirect light
    "hovering under a sky": (
        kinds(3, spheres=[HOVERING], triangles=floor(0), sky=1),
        missing([*SHAPES, "meshes.vertices"]),
    ),
    "hovering below a lamp": (kinds(3, spheres=[HOVERING], triangles=floor(0), lights=[LAMP]), missing(SHAPES)),
    "two boxes": (
        kinds(2, meshes=[box([0, 0, 0], [1, 1, 1]), box([3, 0, 0], [4, 1, 1])], sky=1),
        missing(["meshes.vertices", "camera.fov"]),
    ),
    "a bulb under the sky": (
        kinds(2, triangles=floor(0), lights=[BULB], sky=1),
        missing([*LIGHTS, "camera.fov", "meshes.vertices"]),
    ),
    "a ball alone": (kinds(3, spheres=[SUNK_BALL], sky=1), missing(SHAPES)),
    "a box from inside": (
        kinds(3, meshes=[box([-9, -9, -9], [9, 9, 9])], lights=[LAMP]),
        missing(["meshes.vertices", "camera.position", "lights.position"]),
    ),
    # Where surfaces cross, the camera's own view is there; a diffuse surface sees them by rays that it scatters
    "a half-sunk ball": (
        kinds(1, spheres=[SUNK_BALL], triangles=floor(0), lights=[LAMP]),
        missing([*SHAPES, "meshes.vertices", "lights.position"]),
    ),
    "a half-sunk ball, deeper": (
        kinds(2, spheres=[SUNK_BALL], triangles=floor(0), lights=[LAMP]),
        missing([*SHAPES, "meshes.vertices"], CROSSING) | missing(["lights.position"]),
    ),
    # The last event's rays see nothing but the sky, whose shadow two balls that cross cast as one
    "a half-sunk ball under a sky": (
        kinds(1, spheres=[SUNK_BALL], triangles=floor(0), sky=1),
        missing([*SHAPES, "meshes.vertices"]),
    ),
    "deeper under a sky": (
        kinds(2, spheres=[SUNK_BALL], triangles=floor(0), sky=1),
        missing([*SHAPES, "meshes.vertices"], CROSSING),
    ),
    "no light at all": (kinds(2, spheres=[SUNK_BALL], triangles=floor(0), sky=0), missing(SHAPES)),
    "a ball that rests": (
        kinds(2, spheres=[ball([0, 0.7, 0], 0.7), ball([0, -1000, 0], 1000)], triangles=floor(0), lights=[LAMP]),
        missing(SHAPES),
    ),
    "a ball in a ball": (kinds(2, spheres=[SUNK_BALL, ball([0.2, 0, 0], 0.5)], lights=[LAMP]), missing(SHAPES)),
    "a huge floor": (kinds(2, spheres=[ball([3, 0.2, 0], 0.4), WIDE], lights=[LAMP]), missing(SHAPES, CROSSING)),
    "above a huge floor": (kinds(2, spheres=[ball([3, 0.41, 0], 0.4), WIDE], lights=[LAMP]), missing(SHAPES)),
    "a cube in a huge floor": (
        kinds(2, spheres=[WIDE], meshes=[box([0, -0.5, 0], [1, 0.5, 1])], lights=[LAMP]),
        missing([*SHAPES, "meshes.vertices"], CROSSING),
    ),
    "a cube on a plane": (
        kinds(2, triangles=floor(0), meshes=[box([0, 0, 0], [1, 1, 1])], lights=[LAMP]),
        missing(["meshes.vertices", "camera.fov"]),
    ),
    "a cube through a plane": (
        kinds(2, triangles=floor(0.5), meshes=[box([0, 0, 0], [1, 1, 1])], lights=[LAMP]),
        missing(["meshes.vertices", "camera.fov"], CROSSING),
    ),
    "a room of balls": (kinds(1, spheres=WALLS, lights=[LAMP]), missing([*SHAPES, "lights.position"])),
    "a room of balls, deeper": (
        kinds(2, spheres=WALLS, lights=[LAMP]),
        missing(SHAPES, CROSSING) | missing(["lights.position"]),
    ),
    "a ball beside two that cross": (
        kinds(2, spheres=[ball([-4, 0, 0]), ball([2, 0, 0]), ball([3, 0, 0])], lights=[LAMP]),
        missing(SHAPES[:2])
        | missing(SHAPES[2:], CROSSING)
        | missing(SHAPES[:2], CROSSING, row=1)
        | missing(SHAPES[:2], CROSSING, row=None),
    ),
    # A light that is cut off moves against what cuts it, whoever looks: the camera does not change that
    "a bulb sunk in the wall": (
        kinds(1, spheres=WALLS[:1], triangles=floor(5.2), lights=[BULB, LAMP]),
        missing([*LIGHTS, "meshes.vertices"], SUNK)
        | missing(["lights.position"], row=1)
        | missing(["spheres.center", "camera.fov"]),
    ),
    "a bulb sunk in a ball": (
        kinds(2, spheres=[ball([0, 5, 5]), ball([4, 0, 0])], lights=[BULB]),
        missing(LIGHTS, CROSSING, SUNK)
        | missing(SHAPES[:2], CROSSING, SUNK)
        | missing(SHAPES[:2], row=1)
        | missing(["camera.fov"], CROSSING),
    ),
    "bulbs that cut each other": (
        kinds(1, lights=[BULB, BULB | {"radius": 0.4, "position": [0, 5.5, 4]}], triangles=MIRROR),
        missing([*LIGHTS, "camera.fov"]),
    ),
    # Mirrors and glass: all that the camera sees by them, and light that diffuse surfaces find by them
    "seen in a mirror": (
        kinds(2, spheres=[ball([0, 1, 7.5], 0.8)], triangles=MIRROR, lights=[LAMP]),
        missing([*SHAPES, "meshes.vertices", "lights.position"]),
    ),
    "three events": (
        kinds(3, spheres=[ball([0, 1, 7.5], 0.8)], triangles=MIRROR, lights=[LAMP]),
        missing([*SHAPES, "meshes.vertices"], SPECULAR, BEHIND) | missing(["lights.position"], BEHIND),
    ),
    # What a bulb hides of what a mirror shows to a diffuse surface moves with it
    "a bulb": (
        kinds(3, spheres=[ball([0, 1, 7.5], 0.8)], triangles=MIRROR, lights=[BULB]),
        missing([*SHAPES, *LIGHTS], SPECULAR, BEHIND),
    ),
    "a sky in a mirror": (
        kinds(1, spheres=[ball([0, 1, 7.5], 0.8)], triangles=MIRROR, sky=1),
        missing([*SHAPES, "meshes.vertices"]),
    ),
    "a sky that diffuse surfaces see in a mirror": (
        kinds(2, spheres=[ball([0, 1, 7.5], 0.8)], triangles=MIRROR, sky=1),
        missing([*SHAPES, "meshes.vertices"], SPECULAR),
    ),
    "mirrors alone": (
        kinds(5, spheres=[ball([0, 1, 7.5], 0.8, "silver")], triangles=MIRROR, lights=[BULB], sky=1),
        missing([*SHAPES, *LIGHTS]),
    ),
    "glass alone": (
        kinds(5, spheres=[ball([0, 0, 0], material="crown")], sky=1),
        missing([*SHAPES, "materials.ior"]),
    ),
    "a glass ball over a floor": (
        kinds(2, spheres=[ball([0, 1.2, 0], material="crown")], triangles=floor(0), lights=[BULB]),
        missing([*SHAPES, *LIGHTS, "materials.ior"]),
    ),
    "a glass ball, deeper": (
        kinds(4, spheres=[ball([0, 1.2, 0], material="crown")], triangles=floor(0), lights=[BULB]),
        missing([*SHAPES, *LIGHTS, "materials.ior"], SPECULAR, BEHIND),
    ),
    # What glass shows of a curve that does not move itself
    "behind glass": (
        kinds(3, spheres=[ball([0, 2, 5], 0.5, "crown"), SUNK_BALL], triangles=floor(0), lights=[LAMP]),
        missing(["materials.ior"], CROSSING, SPECULAR, BEHIND) | missing(["spheres.center"], SPECULAR, BEHIND),
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


SEEN, LIGHTS_SEEN = "outlines seen by the camera", "outlines of lights seen by the camera"
BOUNCED, LIGHTS_BOUNCED = "outlines seen by scattered rays", "outlines of lights seen by scattered rays"
CUT, CHAINED = "curves where surfaces cross, seen by the camera", "edges seen in mirrors and through glass"
SHADOWS, INDIRECT, CAUSTICS = "shadow edges", "shadow edges in indirect light", "edges of caustics"
SUNK_UNDER_A_SKY = kinds(1, spheres=[SUNK_BALL, ball([3, 1, 0])], triangles=floor(0), sky=1)
MIRRORED = kinds(2, spheres=[ball([0, 1, 7.5], 0.8)], triangles=MIRROR, lights=[BULB])
GLAZED = kinds(2, spheres=[ball([0, 1.2, 0], material="crown")], triangles=floor(0), lights=[BULB])
POINT = kinds(1, spheres=[ball([0, 1, 7.5], 0.8)], triangles=MIRROR, lights=[LAMP])


@pytest.mark.parametrize(
    ("scene", "name", "row", "known"),
    [
        (SUNK_UNDER_A_SKY, "spheres.radius", 0, {SEEN, CUT, BOUNCED}),
        (SUNK_UNDER_A_SKY, "spheres.radius", 1, {SEEN, BOUNCED}),
        (MIRRORED, "camera.position", None, {SHADOWS, SEEN, CHAINED, INDIRECT, BOUNCED, CAUSTICS}),
        (MIRRORED, "lights.radius", 0, {SHADOWS, LIGHTS_SEEN, CHAINED, INDIRECT, LIGHTS_BOUNCED, CAUSTICS}),
        # No event is left behind the mirror, nothing to see in it, and a lamp of no size moves nothing of its own
        (POINT, "spheres.center", 0, {SHADOWS, SEEN}),
        (POINT, "lights.position", 0, {SHADOWS}),
        # The index moves what is seen through the glass
        (GLAZED, "materials.ior", 0, {CHAINED, INDIRECT, BOUNCED, CAUSTICS}),
        (GLAZED, "materials.albedo", 0, set()),
    ],
)
def test_what_is_there_is_told(scene, name, row, known):
    depth = scene.defaults.max_depth
    assert coverage(scene, name, depth, 9, row)[:2] == (bool(known), ("interior", *_in_order(known)))
    without = tuple(f"{edge} (boundary_samples is 0)" for edge in _in_order(known))
    assert coverage(scene, name, depth, 0, row) == (False, ("interior",), without)


def _in_order(known):
    return [
        x for x in (SHADOWS, SEEN, LIGHTS_SEEN, CUT, CHAINED, INDIRECT, BOUNCED, LIGHTS_BOUNCED, CAUSTICS) if x in known
    ]


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
