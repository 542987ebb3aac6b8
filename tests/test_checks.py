"""What is warned of, and above all what is not: meshes that cross, coincide, nearly close; lights by the thousand."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from jaxrt.description import parse_description
from jaxrt.description.mesh_facts import count_edges, weld_near, winding_number, winding_numbers
from jaxrt.io.scene_file import read_description
from jaxrt.scene.checks import warnings_of

CAMERA = {"position": [0.3, 0.7, 9], "width": 16, "height": 16, "fov": 40}
LAMP = {"position": [2, 7, 8], "intensity": 90, "radius": 0.2}
MATERIALS = {"white": {"type": "diffuse", "albedo": [0.8] * 3}, "glass": {"type": "glass", "ior": 1.5}}


def mesh(solid, material="white", **rest):
    return {"vertices": np.array(solid.vertices), "faces": np.array(solid.faces), "material": material} | rest


def box(low, high, material="white"):
    solid = trimesh.creation.box(bounds=[low, high])
    return mesh(solid, material)


def rectangle(low, high, y, material="white", up=True):
    """Return a level rectangle that faces up or down."""
    (x0, z0), (x1, z1) = low, high
    faces = np.array([[0, 2, 1], [0, 3, 2]])
    vertices = [[x0, y, z0], [x1, y, z0], [x1, y, z1], [x0, y, z1]]
    return {"vertices": vertices, "faces": faces if up else faces[:, ::-1], "material": material}


def turned(part, degrees=(20, 30, 50)):
    return part | {"rotate": list(degrees)}


def warned(*meshes, **rest):
    scene = {"camera": CAMERA, "materials": MATERIALS, "meshes": list(meshes), "lights": [LAMP]} | rest
    told = warnings_of(parse_description(scene))
    return [message for message in told if "is used by nothing" not in message]


# Meshes that are closed but for rounding

BALL = trimesh.creation.icosphere(3)


def soup(solid, error, seed=0):
    """Return vertices and faces where each face has corners of its own, each moved by up to `error` an axis."""
    corners = np.array(solid.vertices)[np.array(solid.faces)].reshape(-1, 3)
    moved = corners + np.random.default_rng(seed).uniform(-error, error, corners.shape)
    return moved, np.arange(len(moved)).reshape(-1, 3)


@pytest.mark.parametrize("size", [1e-3, 1, 1e3])
def test_f10_vertices_that_agree_to_a_millionth_are_one(size):
    vertices, faces = soup(BALL, 1e-6)
    assert count_edges(size * vertices, faces) == (0, 0, 0)
    assert warned({"vertices": vertices, "faces": faces, "material": "glass"}) == []


def test_f10_six_digits_close_a_solid_far_out():
    """As CAD programs write them: each face with its own corners, rounded to six digits of a coordinate."""
    vertices, faces = soup(trimesh.creation.cylinder(1, 2, sections=97), 0)
    rounded = np.array([float(f"{x:.6g}") for x in (vertices * 123.4567).ravel()]).reshape(-1, 3)
    split = rounded + np.random.default_rng(1).choice([0, 1e-4], rounded.shape)
    assert count_edges(split, faces) == (0, 0, 0)


def test_f10_a_gap_stays_open():
    """One of a hundredth of a side, though tiny; and a stray vertex far out does not widen the tolerance."""
    vertices, faces = soup(BALL, 1e-6)
    vertices[:3] += [1e-3, 0, 0]
    assert count_edges(vertices, faces).open > 0
    far = np.concatenate([vertices, [[1e6, 0, 0], [1e6, 1, 0], [1e6, 0, 1]]])
    assert count_edges(far, np.concatenate([faces, [[len(vertices) + i for i in range(3)]]])).open > 3


def test_f10_welding_is_no_chain():
    """A row of vertices, each within the tolerance of the next: no two of a cluster are farther apart than twice it."""
    row = np.zeros((1000, 3))
    row[:, 0] = 0.9 * np.arange(1000)
    row = row[np.random.default_rng(0).permutation(1000)]
    leaders = weld_near(row, 1.0)
    assert np.array_equal(leaders[leaders], leaders)
    assert np.abs(row[:, 0] - row[leaders, 0]).max() <= 1
    assert len(np.unique(leaders)) < 600


# Glass that crosses

CROSSING = "are glass and overlap: refraction is wrong where they do"


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (box([-1, -1, -1], [0.3, 1, 1], "glass"), box([-0.3, -0.9, -0.9], [1.2, 0.8, 0.9], "glass")),
        # Each edge that runs through a face does so on the face's diagonal
        (box([0, 0, 0], [1, 1, 1], "glass"), box([0.5, 0.5, 0.5], [1.5, 1.5, 1.5], "glass")),
        (mesh(BALL, "glass"), mesh(BALL, "glass", translate=[1.9, 0, 0])),
        (mesh(BALL, "glass"), turned(box([-0.1, -0.1, -4], [0.1, 0.1, 4], "glass"))),
    ],
    ids=["boxes", "on diagonals", "balls", "rod"],
)
def test_f10_crossing_glass_meshes_are_named(one, other):
    (message,) = warned(one, other)
    assert message.startswith(f"meshes[0] and meshes[1] {CROSSING}")
    (message,) = warned(other, one)
    assert CROSSING in message


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (mesh(BALL, "glass"), mesh(BALL, "glass", scale=0.9)),
        (mesh(BALL, "glass"), mesh(BALL, "glass", translate=[2.01, 0, 0])),
        (box([-1, -1, -1], [0, 1, 1], "glass"), box([0, 1, -1], [1, 2, 1], "glass")),
        (box([-1, -1, -1], [0, 1, 1], "glass"), box([0.001, -1, -1], [1, 1, 1], "glass")),
        (box([-1, -1, -1], [1, 1, 1], "glass"), box([-0.5, 0.5, -0.5], [0.5, 0.9, 0.5], "glass")),
        (box([-1, -1, -1], [1, 1, 1], "glass"), turned(box([1, 1, 1], [2, 2, 2], "glass"), (0, 0, 0))),
    ],
    ids=["nested", "apart", "by an edge", "a gap", "box in box", "by a corner"],
)
def test_f10_glass_that_touches_or_is_nested_does_not_cross(one, other):
    assert warned(one, other) == []
    assert warned(other, one) == []


@pytest.mark.parametrize(("x", "crosses"), [(0, False), (1.5, True), (2.6, False)])
def test_f10_a_glass_ball_that_crosses_a_glass_mesh(x, crosses):
    """Radius 1.5 around the mesh of radius 1; then across; then beside."""
    sphere = {"center": [x, 0, 0], "radius": 1.5, "material": "glass"}
    told = warned(mesh(BALL, "glass"), spheres=[sphere])
    assert [CROSSING in message for message in told] == [True] * crosses


# Faces in one plane

COINCIDE = "lie in one plane and overlap: rounding decides which one is seen"
FLOOR = rectangle([-8, -8], [8, 8], -1)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (FLOOR, rectangle([-1, -1], [1, 1], -1)),
        (FLOOR, rectangle([-1, -1], [1, 1], -1, up=False)),
        (FLOOR, box([-1, -1, -1], [1, 1, 1], "glass")),
        (box([-1, -1, -1], [1, 1, 1]), rectangle([-0.5, -0.5], [0.5, 0.5], 1)),
        (turned(FLOOR), turned(rectangle([-1.1, -1.3], [1.2, 1], -1))),
    ],
    ids=["decal", "decal turned over", "glass on a floor", "decal on a box", "tilted"],
)
def test_f10_coincident_faces_are_named(one, other):
    (message,) = warned(one, other)
    assert COINCIDE in message and "of meshes[0] and face" in message and "of meshes[1] lie" in message


def test_f10_coincident_faces_of_one_mesh_and_single_triangles():
    vertices = np.array(BALL.vertices)
    faces = np.concatenate([np.array(BALL.faces), np.array(BALL.faces)[7:8]])
    (message,) = warned({"vertices": vertices, "faces": faces, "material": "white"})
    assert message.startswith(f"face 7 of meshes[0] and face {len(faces) - 1} of meshes[0] {COINCIDE}")
    triangle = {"vertices": [[-1, -1, -1], [1, -1, -1], [0, -1, 1]], "material": "white"}
    (message,) = warned(FLOOR, triangles=[triangle])
    assert message.startswith("face 0 of meshes[0] and triangles[0] lie") or "face 1 of meshes[0] and" in message


@pytest.mark.parametrize(
    "meshes",
    [
        (FLOOR, box([-1, -1, -1], [1, 1, 1])),
        (FLOOR, box([-1, -0.999, -1], [1, 1, 1], "glass")),
        (box([-1, -1, -1], [0, 0, 0]), box([0, 0, -1], [1, 1, 0])),
        (box([-1, -1, -1], [0, 0, 0]), box([0, -1, -1], [1, 0, 0])),
        (turned(mesh(trimesh.creation.icosphere(5))),),
        (turned(mesh(trimesh.creation.cylinder(1, 2, sections=301))), mesh(trimesh.creation.annulus(2, 3, 1))),
        (turned(mesh(trimesh.creation.box().subdivide().subdivide().subdivide())),),
        (turned(rectangle([-8, -8], [0, 8], -1)), turned(rectangle([0, -8], [8, 8], -1))),
    ],
    ids=["stands", "hovers", "by an edge", "side by side", "ball", "lathe", "flat parts", "floors side by side"],
)
def test_f10_faces_beside_each_other_do_not_coincide(meshes):
    assert warned(*meshes) == []


def test_f10_rounded_flat_parts_do_not_coincide():
    """A grid on a tilted plane, its vertices rounded to float32 far from the origin."""
    x, z = np.meshgrid(np.arange(40.0), np.arange(40.0))
    vertices = np.stack([x, 0.3 * x + 0.7 * z, z], -1).reshape(-1, 3) / 7 + 100
    corner = (np.arange(39)[:, None] * 40 + np.arange(39)).ravel()
    faces = np.concatenate(
        [np.stack([corner, corner + 1, corner + 40], 1), np.stack([corner + 1, corner + 41, corner + 40], 1)]
    )
    assert warned({"vertices": vertices.astype(np.float32), "faces": faces, "material": "white"}) == []


def test_f10_a_million_faces_are_compared_within_a_bound(monkeypatch):
    """Two coincident meshes have a pair found at once, and what is looked at ends."""
    seen = []
    monkeypatch.setattr("jaxrt.description.mesh_pairs.PAIRS", 10_000)
    monkeypatch.setattr(
        "jaxrt.description.mesh_pairs._coincide", lambda c, n, h, a, b: (seen.append(len(a)), np.zeros(len(a), bool))[1]
    )
    fine = trimesh.creation.icosphere(6)
    assert warned(mesh(fine), mesh(fine)) == []
    assert 0 < sum(seen) < 50_000


# Lights by the thousand


def test_l8_many_points_are_told_inside_from_outside_as_one_is():
    vertices, faces = np.array(BALL.vertices), np.array(BALL.faces)
    places = np.random.default_rng(3).normal(size=(500, 3)) * 0.6
    found = winding_numbers(places, vertices, faces)
    assert np.array_equal(found, [winding_number(place, vertices, faces) for place in places])
    far = np.abs(np.linalg.norm(places, axis=1) - 0.99) > 0.02
    assert np.array_equal(found[far] != 0, np.linalg.norm(places[far], axis=1) < 1)


def test_l8_a_thousand_lights_look_at_few_faces(monkeypatch):
    """Of 80,000 faces: by each light's row, some hundred boxes and faces, not all."""
    from jaxrt.description import mesh_facts

    seen, exact = [], mesh_facts.triangle_distances
    monkeypatch.setattr(mesh_facts, "triangle_distances", lambda p, c: (seen.append(len(c)), exact(p, c))[1])
    rng = np.random.default_rng(4)
    out = rng.normal(size=(1000, 3))
    out *= rng.uniform(1.001, 2, (1000, 1)) / np.linalg.norm(out, axis=1, keepdims=True)
    lights = [{"position": place.tolist(), "intensity": 1} for place in out]
    (message,) = warned(mesh(trimesh.creation.icosphere(6)), lights=lights)
    near = np.linalg.norm(out, axis=1) - 1 < 0.01 * np.linalg.norm(out - CAMERA["position"], axis=1)
    assert message.startswith(f"lights[{np.argmax(near)}] is a point light at ")
    assert message.endswith(f"(and {near.sum() - 1} more lights)")
    assert sum(seen) < 1000 * 400


def test_f9_a_wide_floor_makes_no_light_near():
    """Seven above a floor of 1e6 is not near, nor is it with a mountain at the horizon; a hair above is."""
    floor = rectangle([-1e6, -1e6], [1e6, 1e6], -1)
    above = {"position": [3, 6, 4], "intensity": 120}
    assert warned(floor, lights=[above]) == []
    mountain = mesh(BALL, translate=[5e5, 0, 0], scale=1e4)
    assert warned(floor, mountain, box([-1, -0.9, -1], [1, 1, 1]), lights=[above]) == []
    (message,) = warned(floor, lights=[above | {"position": [3, -0.99, 4]}])
    assert message.startswith("lights[0] is a point light at 0.01 from a surface")


# Other things hardly meant


def sphere(center, radius, material="white"):
    return {"center": center, "radius": radius, "material": material}


def test_s8_lights_in_balls():
    ball = sphere([0, 0, 0], 2)
    for radius in (0, 0.5):
        (message,) = warned(spheres=[ball], lights=[LAMP | {"position": [0.5, 0, 0], "radius": radius}])
        assert message.startswith("lights[0] is inside of spheres[0] (white) and the camera outside")
    (message,) = warned(spheres=[ball], lights=[LAMP | {"position": [1.9, 0, 0], "radius": 0.5}])
    assert message.startswith("lights[0] has its centre inside of spheres[0] (white): only what sticks out shines")
    (message,) = warned(spheres=[sphere([0, 0, 0], 0.5)], lights=[LAMP | {"position": [0, 0.1, 0], "radius": 2}])
    assert message.startswith("spheres[0] is inside of lights[0]: it cannot be seen")
    # A lamp let into a wall that is a huge sphere, one that touches a ball, and one in a ball of glass
    assert warned(spheres=[sphere([0, 1e5 + 8, 0], 1e5)], lights=[LAMP | {"position": [0, 10, 0], "radius": 3}]) == []
    assert warned(spheres=[ball], lights=[LAMP | {"position": [2.2, 0, 0], "radius": 0.5}]) == []
    assert warned(spheres=[sphere([0, 0, 0], 2, "glass")], lights=[LAMP | {"position": [0, 0, 0]}]) == []


def test_s8_camera_in_a_ball():
    (message,) = warned(spheres=[sphere([0, 0, 9], 2)], lights=[LAMP | {"position": [0, 30, 0]}])
    assert message.startswith("lights[0] is outside of spheres[0] (white) and the camera inside")


@pytest.mark.parametrize(
    ("fov", "told"),
    [(0.6, "use 34.4 if it is meant in radians"), (1.5, "use 85.9 if it is meant in radians"), (170, "stretches")],
)
def test_s8_fov_hardly_meant(fov, told):
    (message,) = warned(mesh(BALL), camera=CAMERA | {"fov": fov})
    assert message.startswith(f"camera: fov {fov} degrees") and told in message


@pytest.mark.parametrize("distance", [9, 100, 300])
def test_s8_a_long_lens_is_meant(distance):
    """A ball that fills the picture, from far away, is what the camera is for."""
    fov = 2.5 * np.degrees(1 / distance)
    assert warned(mesh(BALL), camera=CAMERA | {"position": [0.3, 0.7, distance], "fov": fov}) == []
    assert warned(mesh(BALL), camera=CAMERA | {"fov": 120}) == []
    assert warned(mesh(BALL), camera=CAMERA | {"fov": 0.001}) == []  # a probe of one place


def test_s8_materials_that_nothing_is_made_of():
    scene = {"camera": CAMERA, "materials": MATERIALS, "meshes": [mesh(BALL)], "lights": [LAMP]}
    assert warnings_of(parse_description(scene)) == [
        'materials: "glass" is used by nothing: name it in a sphere, triangle or mesh, or remove it'
    ]


GLASS_UNDER_POINT = {"glass_ball.toml": ["lights[0] is a point light and the scene has glass"]}


@pytest.mark.parametrize("path", sorted(Path("scenes").rglob("*.toml")), ids=lambda path: path.name)
def test_s8_no_scene_of_ours_raises_a_false_alarm(path):
    told, expected = warnings_of(read_description(path)), GLASS_UNDER_POINT.get(path.name, [])
    assert len(told) == len(expected) and all(map(str.startswith, told, expected))
