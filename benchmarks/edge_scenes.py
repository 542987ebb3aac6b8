"""Scenes whose derivatives live on edges: of everything that can move, each kind of edge, and how each is moved."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

import jaxrt
from benchmarks.ladder import build
from tests.meshes import icosphere

Description = dict[str, Any]

CUBE = np.asarray([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
SIDES = [[a, *pair] for a, b, c, d in QUADS for pair in ((b, c), (c, d))]
MATERIALS: Description = {
    "grey": {"type": "diffuse", "albedo": [0.6, 0.6, 0.6]},
    "red": {"type": "diffuse", "albedo": [0.8, 0.3, 0.2]},
    "blue": {"type": "diffuse", "albedo": [0.3, 0.4, 0.8]},
    "dark": {"type": "diffuse", "albedo": [0.1, 0.1, 0.1]},
    "light": {"type": "diffuse", "albedo": [0.9, 0.9, 0.9]},
    "white": {"type": "diffuse", "albedo": [1, 1, 1]},
    "black": {"type": "diffuse", "albedo": [0, 0, 0]},
    "mirror": {"type": "mirror", "albedo": [0.9, 0.9, 0.9]},
    "glass": {"type": "glass", "ior": 1.5},
    "metal": {"type": "conductor", "albedo": [0.9, 0.8, 0.6], "roughness": 0.3},
    "shiny": {"type": "conductor", "albedo": [0.9, 0.9, 0.9], "roughness": 0.15},
    "plastic": {"type": "plastic", "albedo": [0.3, 0.5, 0.7], "roughness": 0.4},
    "frosted": {"type": "rough_glass", "ior": 1.5, "roughness": 0.3},
    "milky": {"type": "rough_glass", "ior": 1.4, "roughness": 0.6, "absorption": [0.2, 0.5, 1]},
    "tinted": {"type": "glass", "ior": 1, "absorption": [0.3, 0.6, 1]},
}
CAMERA = {"position": [0, 3, 6], "target": [0, 0.5, 0], "fov": 45}
BEFORE = {"position": [0, 2, 7], "target": [0, 1, 0], "fov": 45}
LAMP = {"position": [-2, 5, 4], "intensity": 40, "radius": 0.5}


def ball(name: str, material: str, center: list[float], radius: float) -> Description:
    """Return a sphere of a scene file."""
    return {"name": name, "material": material, "center": center, "radius": radius}


def box(name: str, material: str, center: list[float], half: float, turn: list[float]) -> Description:
    """Return a cube of twelve faces, turned by these degrees."""
    return {
        "name": name,
        "vertices": (half * CUBE).tolist(),
        "faces": SIDES,
        "material": material,
        "rotate": turn,
        "translate": center,
    }


def quad(corner: list[float], first: list[float], second: list[float], material: str) -> list[Description]:
    """Return a parallelogram as two triangles."""
    a, b, c = (np.asarray(v, float) for v in (corner, first, second))
    return [
        {"vertices": np.asarray(face).tolist(), "material": material}
        for face in ([a, a + b, a + b + c], [a, a + b + c, a + c])
    ]


def round_mesh(smooth: bool = False) -> Description:
    """Return a mesh of 320 faces that is nearly a ball."""
    vertices, faces = icosphere(2)
    mesh = {"vertices": (0.7 * vertices).tolist(), "faces": faces.tolist(), "material": "grey", "smooth": smooth}
    return mesh | {"name": "mesh", "translate": [0, 1, 0]}


def scene(camera: Description, sky: float = 0, **more: Any) -> Description:
    """Return a scene file with the materials that its shapes name."""
    shapes = [shape for group in ("spheres", "meshes", "triangles") for shape in more.get(group, [])]
    materials = {name: MATERIALS[name] for name in dict.fromkeys(shape["material"] for shape in shapes)}
    return {"camera": camera, "materials": materials, **more} | (
        {"environment": {"radiance": [sky] * 3}} if sky else {}
    )


GROUND = ball("ground", "grey", [0, -1000, 0], 1000)
PLANE = quad([-20, 0, -20], [0, 0, 40], [40, 0, 0], "dark")
WALLS = {
    "floor": ([0, -1000, 0], 990, [0.4, 0.4, 0.8]),
    "ceiling": ([0, 1000, 0], 940, [0.8, 0.3, 0.3]),
    "left": ([-1000, 0, 0], 940, [0.3, 0.8, 0.3]),
    "right": ([1000, 0, 0], 940, [0.8, 0.8, 0.2]),
    "back": ([0, 0, -1000], 940, [0.2, 0.8, 0.8]),
    "front": ([0, 0, 1000], 940, [0.8, 0.2, 0.8]),
}
# The room with a ball in it, before each camera: its keys, and which of its numbers move by which step
CAMERAS: dict[str, tuple[Description, dict[str, float]]] = {
    "pinhole": ({"fov": 60}, {"roll": 0.5, "rotate": 0.5}),
    "calibrated": (
        {"size": [64, 64], "fx": 58, "fy": 55, "cx": 33, "cy": 31, "k1": -0.15, "k2": 0.05, "p1": 0.01, "p2": -0.01},
        {"fx": 0.5, "fy": 0.5, "cx": 0.25, "cy": 0.25, "k1": 0.01, "k2": 0.02, "p1": 0.005, "p2": 0.005, "roll": 0.5},
    ),
    "orthographic": (
        {"position": [5, 25, 52], "target": [0, 20, 0], "tall": 60},
        {"tall": 0.5, "position": 0.5, "roll": 0.5},
    ),
    "fisheye": ({"angle": 140}, {"angle": 1.0, "position": 0.5, "roll": 0.5}),
    "equirectangular": ({}, {"position": 0.2, "rotate": 0.5}),
    "thin_lens": (
        {"fov": 60, "focus": 60, "aperture": 6},
        {"focus": 2.0, "aperture": 0.5, "position": 0.5, "roll": 0.5},
    ),
}
CORNER = quad([-3, 0, -2], [0, 0, 5], [6, 0, 0], "grey") + quad([-3, 0, -2], [6, 0, 0], [0, 4, 0], "blue")

SCENES: dict[str, Description] = {
    # A white plane, seen from under a black ball of radius ½ that hides the middle of a white sky
    "under a black ball": scene(
        {"position": [0, 0.3, 0], "target": [0, 0, 0], "up": [0, 0, -1], "fov": 2},
        sky=1,
        triangles=[{"vertices": [[-50, 0, 50], [50, 0, 50], [0, 0, -90]], "material": "white"}],
        spheres=[ball("ball", "black", [0, 1.2, 0], 0.5)],
    ),
    # Under a sky
    "ball over floor": scene(CAMERA, sky=1, spheres=[ball("ball", "grey", [0, 1, 0], 0.7), GROUND]),
    "ball over plane": scene(
        {"position": [0, 3, 6], "target": [0, 0, 0], "fov": 30},
        sky=1,
        spheres=[ball("ball", "light", [0, 1.2, 0], 1)],
        triangles=PLANE,
    ),
    "round mesh": scene(CAMERA, sky=1, meshes=[round_mesh()], spheres=[GROUND]),
    "smooth mesh": scene(CAMERA, sky=1, meshes=[round_mesh(smooth=True)], spheres=[GROUND]),
    "box": scene(CAMERA, sky=1, meshes=[box("mesh", "grey", [0, 1.2, 0], 0.5, [20, 30, 0])], spheres=[GROUND]),
    "cube alone": scene(
        {"position": [0, 0, 4], "target": [0, 0, 0], "fov": 45},
        sky=1,
        meshes=[box("mesh", "grey", [0, 0, 0], 0.5, [20, 30, 0])],
    ),
    "box beside a lamp": scene(
        CAMERA,
        sky=0.1,
        meshes=[box("mesh", "red", [0.3, 1, 0], 0.5, [20, 30, 0])],
        spheres=[GROUND],
        lights=[{"position": [-1.5, 3, 1.5], "intensity": 12, "radius": 0.3}],
    ),
    # Surfaces that cross
    "half-sunk ball": scene(
        {"position": [0, 3, 6], "target": [0, 0, 0], "fov": 30},
        spheres=[ball("ball", "light", [0, 0, 0], 1)],
        triangles=PLANE,
        lights=[{"position": [0, 3, 6], "intensity": 60}],
    ),
    "room of balls": {
        "camera": {"position": [0, 0, 52], "target": [0, 0, 0], "fov": 60},
        "materials": {name: {"type": "diffuse", "albedo": colour} for name, (_, _, colour) in WALLS.items()},
        "spheres": [ball(name, name, center, radius) for name, (center, radius, _) in WALLS.items()],
        "lights": [{"position": [0, 5, 57], "intensity": 3000}],
    },
    "two boxes": scene(
        {"position": [0, 3, 6], "target": [0, 0.2, 0], "fov": 30},
        meshes=[
            box("first", "red", [-0.3, 0.5, 0], 0.6, [0, 20, 0]),
            box("second", "blue", [0.4, 0.5, 0.3], 0.45, [0, 50, 0]),
        ],
        triangles=PLANE,
        lights=[{"position": [1, 5, 6], "intensity": 60}],
    ),
    # Indirect light
    "ball in a corner": scene(
        CAMERA,
        spheres=[ball("ball", "red", [-0.4, 0.8, 0], 0.6)],
        triangles=CORNER,
        lights=[{"position": [0.8, 3.2, 1.2], "intensity": 20, "radius": 0.4}],
    ),
    # Mirrors
    "mirror ball": scene(
        BEFORE,
        spheres=[
            ball("mirror", "mirror", [0, 1.2, -2.5], 1.3),
            ball("ball", "red", [0.8, 0.6, 0.8], 0.5),
            GROUND,
        ],
        lights=[LAMP],
    ),
    "flat mirror": scene(
        {"position": [0, 1.5, 6], "target": [0, 1, 0], "fov": 40},
        triangles=[{"vertices": [[-6, 0, -2], [6, 0, -2], [0, 9, -2]], "material": "mirror"}],
        spheres=[ball("ball", "red", [0, 1, 7.5], 0.8)],
        lights=[{"position": [2, 5, 4], "intensity": 90}],
    ),
    # Glass
    "glass ball": scene(
        BEFORE,
        spheres=[
            ball("glass", "glass", [0, 1.2, 3], 0.6),
            ball("ball", "red", [0.1, 1, -0.5], 0.5),
            GROUND,
        ],
        lights=[LAMP],
    ),
    # Rough surfaces, and what is inside of glass
    "ball over metal": scene(
        CAMERA,
        sky=1,
        spheres=[ball("ball", "red", [0, 1, 0], 0.7)],
        triangles=quad([-9, 0, -9], [0, 0, 18], [18, 0, 0], "metal"),
    ),
    "box over shiny metal": scene(
        CAMERA,
        sky=1,
        meshes=[box("mesh", "red", [0.1, 1, 0], 0.5, [20, 30, 0])],
        spheres=[ball("ground", "shiny", [0, -1000, 0], 1000)],
    ),
    "box before plastic": scene(
        CAMERA,
        meshes=[box("mesh", "red", [0.6, 0.6, 0.3], 0.4, [20, 30, 0])],
        spheres=[ball("plastic", "plastic", [-0.6, 0.8, 0], 0.7)],
        triangles=quad([-9, 0, -9], [0, 0, 18], [18, 0, 0], "grey"),
        lights=[{"position": [1.5, 4, 3], "intensity": 40}],
    ),
    "ball behind frosted glass": scene(
        BEFORE,
        sky=0.5,
        spheres=[ball("glass", "frosted", [0, 1.2, 1.5], 0.7), ball("ball", "red", [0.1, 1, -0.5], 0.5), GROUND],
    ),
    "lamp in frosted glass": scene(
        CAMERA,
        spheres=[ball("glass", "milky", [0, 1, 0], 1), ball("ball", "dark", [0.2, 1.3, 0.4], 0.25)],
        lights=[{"position": [-0.2, 0.8, -0.1], "intensity": 3}],
    ),
    "lamp in tinted glass": scene(
        CAMERA,
        spheres=[
            ball("glass", "tinted", [0, 1, 0], 1.4),
            ball("ball", "red", [0.3, 1.3, 0.3], 0.25),
            ball("block", "light", [-0.4, 0.7, 0], 0.5),
        ],
        lights=[{"position": [0.9, 1.5, 0.4], "intensity": 3}],
    ),
    # Others like them
    "other box beside a lamp": scene(
        {"position": [1.5, 2.5, 5.5], "target": [0.2, 0.6, 0], "fov": 40},
        sky=0.2,
        meshes=[box("mesh", "blue", [0, 0.9, 0.2], 0.45, [15, 50, 10])],
        triangles=quad([-15, 0, -15], [0, 0, 30], [30, 0, 0], "grey"),
        lights=[{"position": [1.6, 2.8, 1], "intensity": 9, "radius": 0.25}],
    ),
    "two balls that cut": scene(
        {"position": [0.5, 2.5, 5], "target": [0, 0.4, 0], "fov": 35},
        spheres=[ball("first", "red", [-0.4, 0.5, 0], 0.7), ball("second", "blue", [0.4, 0.4, 0.2], 0.6)],
        triangles=PLANE,
        lights=[{"position": [1.5, 4, 4], "intensity": 40}],
    ),
    "flat mirror and mirror ball": scene(
        {"position": [0.5, 2, 6], "target": [0, 0.9, 0], "fov": 40},
        spheres=[ball("mirror", "mirror", [1.1, 0.8, -0.6], 0.8), ball("ball", "red", [-0.5, 0.6, 0.8], 0.5), GROUND],
        triangles=quad([-4, 0, -2], [8, 0, 0], [0, 5, 0], "mirror"),
        lights=[{"position": [1, 5, 4], "intensity": 35, "radius": 0.4}],
    ),
    "other glass ball": scene(
        {"position": [0.3, 1.6, 6], "target": [0.1, 1, 0], "fov": 38},
        spheres=[
            ball("glass", "glass", [0.2, 1.1, 2.2], 0.7),
            ball("ball", "blue", [-0.2, 0.9, -0.6], 0.6),
            GROUND,
        ],
        lights=[{"position": [2, 5, 3], "intensity": 40, "radius": 0.6}],
    ),
    "bright ball near a wall": scene(
        {"position": [0.5, 2, 5], "target": [0, 1, 0], "fov": 42},
        spheres=[ball("ball", "red", [0.9, 0.5, 0.3], 0.5)],
        triangles=CORNER,
        lights=[{"position": [-0.6, 1.4, -1.1], "intensity": 4, "radius": 0.4}],
    ),
}

for kind, (own, _) in CAMERAS.items():
    here = SCENES["room of balls"]
    stands = {"type": kind, "position": [0, 0, 52], "target": [0, 0, 0]}
    balls = [*here["spheres"], ball("ball", "right", [-8, -1, 0], 8)]
    SCENES[f"room, {kind}"] = {**here, "camera": {**stands, **own}, "spheres": balls}

for name in ("gaussian", "blackman-harris"):
    SCENES[f"room, {name}"] = {**SCENES["room, pinhole"], "render": {"filter": name}}


class Row(NamedTuple):
    """One derivative, and how far it may be from finite differences."""

    name: str
    scene: str  # of SCENES
    parameter: str  # what moves, as a selector
    motion: str  # along an axis, turned about the vertical, scaled, or all by one
    bound: float
    step: float = 0.02
    depth: int = 1
    less: int = 0  # events of a picture that is taken away, for indirect light alone: then the error is of a slope
    size: int = 48
    samples: int = 16  # boundary samples a pixel
    seeds: int = 4  # at least
    fd_spp: int = 4096  # of the finite differences: more where light is found by chance


MOTIONS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "x": lambda value: np.broadcast_to([1.0, 0, 0], value.shape),
    "y": lambda value: np.broadcast_to([0.0, 1, 0], value.shape),
    "z": lambda value: np.broadcast_to([0.0, 0, 1], value.shape),
    "turn": lambda value: np.cross([0.0, 1, 0], value - value.mean(0)),
    "scale": lambda value: np.asarray(value - value.mean(0)),
    "one": lambda value: np.ones(value.shape),
}


def built(row: Row) -> jaxrt.Scene:
    """Return the row's scene in its size."""
    return build(SCENES[row.scene], width=row.size, height=row.size)


def direction(row: Row, scene: jaxrt.Scene) -> Array:
    """Return how the row's parameter moves."""
    value = jaxrt.parameters(scene, row.parameter)
    return jnp.asarray(MOTIONS[row.motion](np.asarray(value, float)), value.dtype)


def sky_rows() -> list[Row]:
    """Return what moves under a sky."""
    ball, mesh = "spheres.center[ball]", "meshes.vertices[mesh]"
    rows = [Row("plane under a black ball, height", "under a black ball", ball, "y", 0.01)]
    for depth in (1, 2):
        rows += [
            Row(f"ball over floor, sky, depth {depth}, {word}", "ball over floor", ball, axis, 0.03, 0.03, depth)
            for word, axis in (("height", "y"), ("sideways", "x"))
        ]
    rows += [Row("ball over plane, sky, height", "ball over plane", ball, "y", 0.03, 0.03)]
    for name, step in (("round mesh", 0.03), ("smooth mesh", 0.02), ("box", 0.03)):
        rows += [Row(f"{name} over floor, sky, height", name, mesh, "y", 0.03, step)]
    rows += [Row("box over floor, sky, turn", "box", mesh, "turn", 0.03, 0.03)]
    rows += [Row("cube alone, sky, depth 3, z", "cube alone", mesh, "z", 0.03, 0.03, 3)]
    for motion in ("x", "y", "z", "turn", "scale"):
        rows += [Row(f"box, sky .1 beside a lamp, {motion}", "box beside a lamp", mesh, motion, 0.03, 0.03)]
    return rows


def crossing_rows() -> list[Row]:
    """Return what moves where surfaces cross."""
    rows = [
        Row("half-sunk ball, radius", "half-sunk ball", "spheres.radius[ball]", "one", 0.03),
        Row("half-sunk ball, x", "half-sunk ball", "spheres.center[ball]", "x", 0.03),
    ]
    rows += [Row(f"room of balls, camera {k}", "room of balls", "camera.position", k, 0.03, 0.5) for k in "xy"]
    rows += [Row("room of balls, fov", "room of balls", "camera.fov", "one", 0.03, 0.5)]
    return rows + [Row(f"two boxes that overlap, {k}", "two boxes", "meshes.vertices[first]", k, 0.03) for k in "xy"]


def camera_rows() -> list[Row]:
    """Return what each camera's own numbers move: corners of a room of balls, an outline, a shadow."""
    return [
        Row(f"room before a {kind} camera, {name}", f"room, {kind}", f"camera.{name}", motion, 0.03, step)
        for kind, (_, steps) in CAMERAS.items()
        for name, step in steps.items()
        for motion in ("x" if name in ("position", "rotate") else "one",)
    ]


def filter_rows() -> list[Row]:
    """Return the same room before a pinhole, its pixels filtered."""
    names = ("gaussian", "blackman-harris")
    return [Row(f"room, {name} filter, roll", f"room, {name}", "camera.roll", "one", 0.03, 0.5) for name in names]


def chain_rows() -> list[Row]:
    """Return what is seen in mirrors and through glass, and the indirect light of a moved ball."""
    ball = "spheres.center[ball]"
    name = "ball in a corner, indirect part, depth 3"
    steps = {"x": 0.05, "y": 0.03}
    rows = [Row(f"{name}, {k}", "ball in a corner", ball, k, 0.05, steps[k], 3, less=1) for k in "xy"]
    far, chance = 0.1, 8192
    return rows + [
        Row("mirror ball, ball x", "mirror ball", ball, "x", 0.05, 0.05, 2, fd_spp=chance),
        Row("mirror ball, light x", "mirror ball", "lights.position[0]", "x", 0.05, far, 2, fd_spp=chance),
        Row("mirror ball, camera x", "mirror ball", "camera.position", "x", 0.05, 0.05, 2, fd_spp=chance),
        Row("flat mirror, ball x", "flat mirror", ball, "x", 0.05, 0.03, 3),
        Row("flat mirror, ball radius", "flat mirror", "spheres.radius[ball]", "one", 0.05, 0.03, 3),
        Row("flat mirror, camera x", "flat mirror", "camera.position", "x", 0.05, 0.01, 3),
        Row("glass ball, ball x", "glass ball", ball, "x", 0.05, 0.025, 4, fd_spp=chance),
        Row("glass ball, light x", "glass ball", "lights.position[0]", "x", 0.05, far, 4, fd_spp=chance),
        Row("glass ball, ior", "glass ball", "materials.ior[0]", "one", 0.1, 0.008, 4, fd_spp=chance),
    ]


def rough_rows() -> list[Row]:
    """Return what rough surfaces see, and what moves inside of glass."""
    ball, mesh = "spheres.center[ball]", "meshes.vertices[mesh]"
    rows = [Row(f"ball over metal, {k}", "ball over metal", ball, k, 0.05, 0.03) for k in "xy"]
    rows += [Row("ball over metal, camera x", "ball over metal", "camera.position", "x", 0.05, 0.02)]
    rows += [Row(f"box over shiny metal, {k}", "box over shiny metal", mesh, k, 0.05, 0.02, 2) for k in ("x", "turn")]
    rows += [Row(f"box before plastic, {k}", "box before plastic", mesh, k, 0.05, 0.02, 2) for k in ("x", "turn")]
    rows += [Row("ball behind frosted glass, ball x", "ball behind frosted glass", ball, "x", 0.05, 0.02, 3)]
    return rows + [
        Row(f"lamp in {glass} glass, {word}", f"lamp in {glass} glass", name, "x", 0.05, step, depth)
        for glass, depth, step in (("frosted", 1, 0.02), ("tinted", 3, 0.005))
        for word, name in (("ball x", ball), ("light x", "lights.position[0]"), ("camera x", "camera.position"))
    ]


OTHERS: dict[str, tuple[float, int, list[tuple[str, str]]]] = {
    # bound, depth, what moves how
    "other box beside a lamp": (0.04, 2, [("meshes.vertices[mesh]", k) for k in ("turn", "x", "y")]),
    "two balls that cut": (
        0.04,
        1,
        [("spheres.radius[first]", "one"), ("spheres.center[second]", "x"), ("spheres.center[first]", "y")],
    ),
    "flat mirror and mirror ball": (
        0.06,
        3,
        [("spheres.center[ball]", "x"), ("spheres.center[mirror]", "x"), ("spheres.radius[ball]", "one")],
    ),
    "other glass ball": (
        0.06,
        4,
        [("spheres.center[ball]", "x"), ("spheres.center[glass]", "x"), ("materials.ior[0]", "one")],
    ),
    "bright ball near a wall": (
        0.06,
        3,
        [("lights.position[0]", "z"), ("lights.radius[0]", "one"), ("spheres.center[ball]", "y")],
    ),
}


# Of finite differences, where 0.03 is too long, or shorter than it must be
STEPS = {
    ("other box beside a lamp", "meshes.vertices[mesh]", "x"): 0.015,
    ("other box beside a lamp", "lights.position[0]", "x"): 0.015,
    ("flat mirror and mirror ball", "camera.position", "x"): 0.02,
    ("other glass ball", "lights.position[0]", "x"): 0.06,
    ("other glass ball", "spheres.center[ball]", "x"): 0.06,
    ("other glass ball", "materials.ior[0]", "one"): 0.015,
    ("bright ball near a wall", "lights.position[0]", "x"): 0.06,
    ("bright ball near a wall", "lights.position[0]", "z"): 0.06,
    ("bright ball near a wall", "camera.position", "x"): 0.06,
}


def other_rows() -> list[Row]:
    """Return five scenes like these, smaller and with a fourth of the edge samples; light and camera move in each."""
    rows = []
    for name, (bound, depth, moves) in OTHERS.items():
        for parameter, motion in [*moves, ("lights.position[0]", "x"), ("camera.position", "x")]:
            title, chance = f"{name}, {parameter} {motion}", depth > 2
            step = STEPS.get((name, parameter, motion), 0.03)
            row = Row(title, name, parameter, motion, bound, step, depth, size=40, samples=4, seeds=16)
            rows.append(row._replace(fd_spp=8192 if chance else row.fd_spp))
    return rows


def rows() -> list[Row]:
    """Return all rows, cheap ones first."""
    return [*crossing_rows(), *camera_rows(), *filter_rows(), *sky_rows(), *rough_rows(), *chain_rows(), *other_rows()]
