"""Scene descriptions: what is accepted, what is refused and in which words, what is warned of."""

import copy
import math

import numpy as np
import pytest

from jaxrt.description import SceneDescription, SceneError, nearest, parse_description
from jaxrt.materials.diffuse import Diffuse
from jaxrt.materials.mirror import Mirror
from jaxrt.scene.checks import check_memory, warnings_of

GOOD = {
    "camera": {"position": [0, 0, 55]},
    "materials": {
        "white": {"type": "diffuse", "albedo": [0.8, 0.8, 0.8]},
        "shiny": {"type": "mirror"},
        "glass": {"type": "glass", "ior": 1.5},
    },
    "spheres": [
        {"center": [0, 0, 0], "radius": 10, "material": "white"},
        {"center": [30, 0, 0], "radius": 8, "material": "glass"},
    ],
    "triangles": [{"vertices": [[0, 0, 20], [1, 0, 20], [0, 1, 20]], "material": "shiny"}],
    "lights": [{"position": [-10, 20, 40], "intensity": 3e3, "radius": 5}],
}


def scene_with(path, value):
    """Return GOOD with one place changed, or taken away where `value` is None."""
    scene = copy.deepcopy(GOOD)
    place = scene
    for part in path[:-1]:
        place = place.setdefault(part, {}) if isinstance(place, dict) else place[part]
    if value is None:
        del place[path[-1]]
    else:
        place[path[-1]] = value
    return scene


def refusal(path, value):
    with pytest.raises(SceneError) as caught:
        parse_description(scene_with(path, value), "room.toml")
    return str(caught.value)


def test_defaults_are_those_of_the_scene_format():
    scene = parse_description(GOOD)
    assert scene.camera.target == (0.0, 0.0, 54.0)
    assert scene.camera.up == (0.0, 1.0, 0.0)
    assert (scene.camera.fov, scene.camera.width, scene.camera.height) == (60.0, 512, 512)
    assert (scene.render.spp, scene.render.max_depth) == (64, 5)
    assert scene.environment is None
    assert scene.lights[0].intensity == (3e3, 3e3, 3e3)
    assert scene.materials["shiny"] == Mirror.Table(albedo=(1.0, 1.0, 1.0))
    assert isinstance(scene.materials["white"], Diffuse.Table) and scene.materials["glass"].type == "glass"


def test_a_scene_of_a_camera_alone_is_legal():
    scene = parse_description({"camera": {"position": [0, 0, 0]}})
    assert scene.spheres == scene.triangles == scene.lights == ()


def test_numbers_become_floats_and_lists_tuples():
    scene = parse_description(GOOD)
    assert type(scene.spheres[0].radius) is float
    assert scene.triangles[0].vertices[1] == (1.0, 0.0, 20.0)


def test_arrays_and_array_scalars_are_accepted():
    scene = scene_with(("spheres", 0, "center"), np.array([1, 2, 3], np.float32))
    scene["spheres"][0]["radius"] = np.float32(2.5)
    scene["lights"][0]["intensity"] = np.float64(7)
    parsed = parse_description(scene)
    assert parsed.spheres[0].center == (1.0, 2.0, 3.0)
    assert parsed.spheres[0].radius == 2.5
    assert parsed.lights[0].intensity == (7.0, 7.0, 7.0)


def test_descriptions_are_frozen_and_nest():
    scene = parse_description(GOOD)
    with pytest.raises(ValueError, match="frozen"):
        scene.camera = None
    assert parse_description({"camera": scene.camera, "spheres": [], "materials": scene.materials})
    assert isinstance(SceneDescription(camera=scene.camera), SceneDescription)


SPHERE, TRIANGLE, LIGHT, CAMERA = ("spheres", 1), ("triangles", 0), ("lights", 0), ("camera",)

REFUSED = [
    # Numbers that are none, not finite, or not for float32
    ((*SPHERE, "radius"), "10", 'spheres[1].radius: "10" is not a number: write it without quotes'),
    ((*SPHERE, "radius"), True, "spheres[1].radius: true is not a number: write a number"),
    ((*SPHERE, "radius"), [1], "spheres[1].radius: [1] is not a number: write a number"),
    ((*SPHERE, "radius"), math.nan, "spheres[1].radius: nan is not finite: write a finite number"),
    ((*SPHERE, "center"), [0, math.inf, 0], "spheres[1].center[1]: inf is not finite: write a finite number"),
    ((*LIGHT, "intensity"), -math.inf, "lights[0].intensity: -inf is not finite: write a finite number"),
    ((*CAMERA, "position"), [0, 0, 1e39], "camera.position[2]: 1e+39 is too large for float32: stay within"),
    ((*SPHERE, "radius"), 10**400, "is too large for float32"),
    (
        (*SPHERE, "center"),
        [1e20, 0, 0],
        "spheres[1].center[0]: 1e+20 is too far out for float32: stay within",
    ),
    ((*SPHERE, "radius"), 1e-30, "spheres[1].radius: 1e-30 is too small for float32: use 1e-15 or more"),
    # Shapes of vectors
    ((*SPHERE, "center"), [0, 0], "spheres[1].center: [0, 0] has 2 values: write 3"),
    ((*SPHERE, "center"), 3, "spheres[1].center: 3 is not a list: write three values in brackets"),
    ((*SPHERE, "center"), [0, 0, "a"], 'spheres[1].center[2]: "a" is not a number'),
    ((*TRIANGLE, "vertices"), [[0, 0, 0], [1, 0, 0]], "triangles[0].vertices: [[0, 0, 0], [1, 0, 0]] has 2"),
    (
        (*TRIANGLE, "vertices"),
        [[0, 0, 0], [1, 0], [0, 1, 0]],
        "triangles[0].vertices[1]: [1, 0] has 2 values",
    ),
    # Ranges
    ((*SPHERE, "radius"), 0, "spheres[1].radius: 0.0 is not > 0: use a positive radius"),
    ((*SPHERE, "radius"), -3, "spheres[1].radius: -3.0 is not > 0: use a positive radius"),
    (
        ("materials", "white", "albedo"),
        [0.8, 1.2, 0],
        "materials.white.albedo[1]: 1.2 is outside [0, 1]: choose",
    ),
    (
        ("materials", "white", "albedo"),
        [-0.1, 0, 0],
        "materials.white.albedo[0]: -0.1 is outside [0, 1]: choose",
    ),
    (("materials", "shiny", "albedo"), [2, 0, 0], "materials.shiny.albedo[0]: 2.0 is outside [0, 1]: choose"),
    (("materials", "glass", "ior"), 0, "materials.glass.ior: 0.0 is not > 0: glass has about 1.5"),
    ((*CAMERA, "fov"), 0, "camera.fov: 0.0 is not between 0 and 180: choose degrees, such as 60"),
    ((*CAMERA, "fov"), 180, "camera.fov: 180.0 is not between 0 and 180"),
    ((*CAMERA, "fov"), 179.9999999, "camera.fov: 179.9999999 is not between 0 and 180"),
    ((*LIGHT, "intensity"), -5, "lights[0].intensity: -5 is negative: light cannot be, use 0 or more"),
    ((*LIGHT, "intensity"), [1, 2, -3], "lights[0].intensity[2]: -3.0 is negative: light cannot be"),
    ((*LIGHT, "radius"), -1, "lights[0].radius: -1.0 is negative: use 0 for a point light"),
    (
        ("environment",),
        {"radiance": [1, -1, 1]},
        "environment.radiance[1]: -1.0 is negative: light cannot be",
    ),
    # Counts
    ((*CAMERA, "width"), 0, "camera.width: 0 is out of range: write an integer from 1 to"),
    ((*CAMERA, "height"), -1, "camera.height: -1 is out of range: write an integer from 1 to"),
    ((*CAMERA, "width"), 512.0, "camera.width: 512.0 is not a whole number: write an integer >= 1"),
    (("render", "spp"), 0, "render.spp: 0 is out of range: write an integer from 1 to"),
    (("render", "spp"), 2**31, "render.spp: 2147483648 is out of range"),
    (("render", "spp"), True, "render.spp: true is not a whole number"),
    (("render", "max_depth"), 0, "render.max_depth: 0 is out of range: write an integer from 1 to"),
    # Camera frame
    (
        (*CAMERA, "up"),
        [0, 0, 2],
        "camera.up: (0.0, 0.0, 2.0) is parallel to the view: choose another direction",
    ),
    ((*CAMERA, "up"), [0, 0, 0], "camera.up: (0.0, 0.0, 0.0) is zero: use a direction such as [0, 1, 0]"),
    ((*CAMERA, "target"), [0, 0, 55], "camera.target: is the camera's position: nothing to look along"),
    # Names
    ((*SPHERE, "material"), "glas", 'spheres[1].material: unknown material "glas" (did you mean "glass"?)'),
    (
        (*TRIANGLE, "material"),
        "x",
        'triangles[0].material: unknown material "x" (known: white, shiny, glass)',
    ),
    ((*SPHERE, "material"), 3, "spheres[1].material: 3 is not a name: write a string in quotes"),
    (("sphere",), [], 'room.toml: unknown key "sphere" (did you mean "spheres"?)'),
    ((*SPHERE, "raduis"), 3, 'spheres[1]: unknown key "raduis" (did you mean "radius"?)'),
    ((*SPHERE, "q"), 3, 'spheres[1]: unknown key "q" (known: center, radius, material, name, group)'),
    (("materials", "white", "ior"), 3, 'materials.white: unknown key "ior" (known: type, albedo)'),
    (
        ("materials", "white", "type"),
        "difuse",
        'materials.white.type: unknown material type "difuse" (did you',
    ),
    (
        ("materials", "white", "type"),
        ["a"],
        "materials.white.type: unknown material type ['a'] (known: diffuse,",
    ),
    (("materials", "a.b"), {"type": "glass", "ior": -1}, 'materials."a.b".ior: -1.0 is not > 0'),
    # What is missing
    ((*SPHERE, "radius"), None, 'spheres[1]: "radius" is missing: add radius = 10'),
    ((*SPHERE, "material"), None, 'spheres[1]: "material" is missing: add material = "white"'),
    ((*CAMERA, "position"), None, 'camera: "position" is missing: add position = [0, 0, 55]'),
    (("camera",), None, 'room.toml: "camera" is missing: add a table [camera] with position'),
    (("materials", "white", "type"), None, 'materials.white: "type" is missing: add type = "diffuse"'),
    (("materials", "white", "albedo"), None, 'materials.white: "albedo" is missing: add albedo = [0.8'),
    (("materials", "glass", "ior"), None, 'materials.glass: "ior" is missing: add ior = 1.5'),
    (("environment",), {}, 'environment: "radiance" is missing: add radiance = [1, 1, 1]'),
    # Tables
    (
        ("spheres",),
        {"center": 1},
        "spheres: a single table where many can be: write [[spheres]] with two brackets",
    ),
    (("lights",), 3, "lights: 3 is not a list of tables: write [[lights]]"),
    (("spheres", 1), 3, "spheres[1]: 3 is not a table: write keys and values"),
    (("camera",), [1], "camera: [1] is not a table: write keys and values"),
    (("materials",), 1, "materials: 1 is not a table: write [materials.NAME]"),
    (("materials", "white"), "red", 'materials.white: "red" is not a table: write [materials.white]'),
    # Triangles without area
    ((*TRIANGLE, "vertices"), [[1, 2, 3]] * 3, "triangles[0].vertices: ((1.0, 2.0, 3.0), (1.0, 2.0, 3.0),"),
    ((*TRIANGLE, "vertices"), [[0.1] * 3, [0.2] * 3, [0.7] * 3], "has no area: move a vertex or remove it"),
    ((*TRIANGLE, "vertices"), [[0, 0, 0], [1e-12, 0, 0], [0, 1e-12, 0]], "is too small for float32: scale"),
]


@pytest.mark.parametrize(("path", "value", "message"), REFUSED)
def test_bad_values_are_refused_with_place_culprit_and_remedy(path, value, message):
    text = refusal(path, value)
    assert message in text
    assert text.startswith("room.toml: ") and "\n" not in text


def test_a_light_too_small_for_its_power_is_refused():
    scene = scene_with(("lights", 0), {"position": [0, 0, 30], "intensity": 1e20, "radius": 1e-12})
    with pytest.raises(SceneError, match=r"lights\[0\]\.radius: 1e-12 makes the radiance too large for float32"):
        parse_description(scene)


def test_the_first_culprit_is_named_alone():
    scene = scene_with(("spheres", 0, "radius"), -1)
    scene["camera"]["fov"] = 0
    with pytest.raises(SceneError, match=r"^scene: camera\.fov: [^;]*$"):
        parse_description(scene)


def test_long_and_broken_culprits_stay_on_one_short_line():
    text = refusal(("spheres", 1, "material"), "a\nb" * 100)
    assert "\n" not in text and len(text) < 200


def test_a_mapping_is_wanted():
    with pytest.raises(SceneError, match=r"^scene: 3 is not a table"):
        parse_description(3)


def test_sliver_triangles_and_far_off_scenes_are_kept():
    sliver = [[0, 0, 0], [1, 0, 0], [0.5, 1e-6, 0]]
    assert parse_description(scene_with(("triangles", 0, "vertices"), sliver))
    far = {"position": [1e8, 0, 1], "target": [1e8, 0, 0]}
    assert parse_description({"camera": far}).camera.position == (1e8, 0.0, 1.0)


def test_nearest_name_or_all_of_them():
    assert nearest("glas", ["white", "glass"]) == ' (did you mean "glass"?)'
    assert nearest("zzz", ["white", "glass"]) == " (known: white, glass)"
    assert nearest("zzz", []) == " (none is defined)"


def test_no_warning_for_a_sound_scene():
    assert warnings_of(parse_description(GOOD)) == []


def warned(**changes):
    """Return the warnings of GOOD with changes, but those of materials that are left over then."""
    told = warnings_of(parse_description(copy.deepcopy(GOOD) | changes))
    return [message for message in told if "is used by nothing" not in message]


def ball(center, radius, material="white"):
    return {"center": center, "radius": radius, "material": material}


LAMP = {"position": [0, 0, 30], "intensity": 100, "radius": 1}
POINT = {"position": [0, 0, 30], "intensity": 100}


def test_warns_of_no_light():
    assert warned(lights=[]) == ["no light and no environment: the picture is black, add [[lights]] or [environment]"]
    assert warned(lights=[], environment={"radiance": [1, 1, 1]}) == []


def test_warns_of_lights_without_power():
    (message,) = warned(lights=[LAMP | {"intensity": 0}])
    assert "power" in message and "raise an intensity" in message
    (message,) = warned(lights=[], environment={"radiance": [0, 0, 0]})
    assert "power" in message


def test_warns_of_a_light_walled_in_and_of_a_camera_walled_in():
    (message,) = warned(lights=[LAMP | {"position": [0, 0, 0]}])
    assert message.startswith("lights[0] is inside of spheres[0] (white) and the camera outside:")
    (message,) = warned(spheres=[ball([0, 0, 55], 5)])
    assert message.startswith("lights[0] is outside of spheres[0] (white) and the camera inside:")
    (message,) = warned(spheres=[ball([0, 0, 55], 5)], lights=[], environment={"radiance": [1, 1, 1]})
    assert message.startswith("the camera is inside of spheres[0]")
    # Together inside, or parted by glass only, they see each other
    assert warned(spheres=[ball([0, 0, 0], 100)]) == []
    assert warned(spheres=[ball([0, 0, 55], 5, "glass")]) == []


def test_warns_of_a_camera_inside_a_light():
    (message,) = warned(lights=[LAMP | {"position": [0, 0, 54]} | {"radius": 3}])
    assert message.startswith("the camera is inside of lights[0]")


def test_warns_of_a_point_light_with_glass():
    (message,) = warned(lights=[LAMP, POINT])
    assert message.startswith("lights[1] is a point light and the scene has glass: no path can connect them")
    assert "use a radius > 0" in message
    assert warned(lights=[POINT], spheres=[ball([0, 0, 0], 10)]) == []


def test_m3_warns_of_overlapping_glass_but_not_of_nested():
    spheres = [ball([0, 0, 0], 10), ball([30, 0, 0], 5, "glass"), ball([34, 0, 0], 3, "glass")]
    (message,) = warned(spheres=spheres)
    assert message.startswith("spheres[1] and spheres[2] are glass and overlap")
    assert warned(spheres=[ball([30, 0, 0], 5, "glass"), ball([30, 0, 0], 4, "glass")]) == []
    assert warned(spheres=[ball([30, 0, 0], 5, "glass"), ball([40, 0, 0], 4, "glass")]) == []


@pytest.mark.parametrize(("height", "count"), [(0.01, 1), (5.0, 0)])
def test_l3_warns_of_a_point_light_near_a_surface(height, count):
    on_ball = {"position": [0, 10 + height, 0], "intensity": 1}
    assert len(warned(spheres=[ball([0, 0, 0], 10)], lights=[on_ball])) == count
    floor = {"vertices": [[-9, 0, 9], [9, 0, 9], [0, 0, -9]], "material": "white"}
    above = {"position": [0, height, 0], "intensity": 1}
    assert len(warned(spheres=[], triangles=[floor], lights=[above])) == count
    beside = {"position": [9 + height, 0, 9], "intensity": 1}
    assert len(warned(spheres=[], triangles=[floor], lights=[beside])) == count


def test_i12_an_image_larger_than_memory_is_refused():
    with pytest.raises(SceneError) as caught:
        check_memory(100_000, 100_000, "room.toml")
    text = str(caught.value)
    assert text.startswith("room.toml: camera: image 100000x100000 needs ")
    assert " GiB, this machine has " in text and text.endswith(": lower width or height")
    check_memory(1024, 1024)


def test_memory_is_not_judged_where_the_system_does_not_tell(monkeypatch):
    monkeypatch.setattr("jaxrt.scene.memory.limits", lambda: iter(()))
    check_memory(10**9, 10**9)
