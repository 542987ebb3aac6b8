"""Bad scene files, refused in one line: cases I8 to I13. test_description.py has all kinds, with their words."""

import tomllib
import warnings

import numpy as np
import pytest

import jaxrt
from jaxrt.description import SceneError, parse_description
from jaxrt.scene.checks import check_memory

CAMERA = {"position": [0, 0, 5]}
WHITE = {"white": {"type": "diffuse", "albedo": [0.8, 0.8, 0.8]}}
BALL = {"center": [0, 0, 0], "radius": 1, "material": "white"}
LAMP = {"position": [0, 4, 5], "intensity": 9}
SOUND = {"camera": CAMERA, "materials": WHITE, "spheres": [BALL], "lights": [LAMP]}


def taken(*scenes):
    """Return how many of these scenes, each a change of a sound one, are not refused in one line."""
    assert parse_description(SOUND)
    count = 0
    for scene in scenes:
        with pytest.raises(SceneError) as told:
            parse_description(SOUND | scene)
        count += "\n" in str(told.value)
    return count


def test_i8_numbers_of_toml_that_are_not_finite(figures):
    bad = [tomllib.loads(f"radius = {text}")["radius"] for text in ("nan", "inf", "-inf", "1e999")]
    scenes = [{"spheres": [BALL | {"radius": x}]} for x in bad] + [{"lights": [LAMP | {"intensity": x}]} for x in bad]
    naive = 2 * sum(not np.isfinite(x) for x in bad)
    what = "numbers taken that are not finite, of 8 in TOML; naive: whatever parses"
    figures("I8", what, naive=naive, ours=taken(*scenes), at_most=0)


def test_i9_unknown_keys(figures):
    misspelt = BALL | {"raduis": 2}
    known = {key: value for key, value in misspelt.items() if key in BALL}
    scenes = [{"spheres": [misspelt]}, {"sphere": [BALL]}, {"camera": CAMERA | {"fow": 3}}]
    naive = int(known == BALL)
    figures("I9", "unknown keys taken, of 3; naive: those known are read", naive=naive, ours=taken(*scenes), at_most=0)


def test_i10_cameras_that_see_nothing(figures):
    """At 180 degrees the tangent of half the angle is −2.3e7 in float32: a mirrored picture."""
    changes = [{"fov": 0}, {"fov": 180}, {"width": 0}, {"height": -1}, {"up": [0, 0, 2]}, {"target": [0, 0, 5]}]
    scenes = [{"camera": CAMERA | change} for change in changes] + [
        {"render": {"spp": 0}},
        {"render": {"max_depth": 0}},
    ]
    naive = int(np.tan(np.float32(np.pi) / np.float32(2)) < 0)
    what = "impossible cameras and counts taken, of 8; naive: fov 180 gives a mirrored picture"
    figures("I10", what, naive=naive, ours=taken(*scenes), at_most=0)


def test_i11_values_out_of_range(figures):
    """An albedo of 1.2 in a closed room makes a series that grows for ever."""
    materials = [
        {"type": "diffuse", "albedo": [1.2, 0, 0]},
        {"type": "glass", "ior": 0},
        {"type": "mirror", "albedo": [-1] * 3},
    ]
    scenes = [{"materials": {"white": material}} for material in materials]
    scenes += [
        {"lights": [LAMP | {"intensity": -1}]},
        {"lights": [LAMP | {"radius": -1}]},
        {"spheres": [BALL | {"radius": -1}]},
    ]
    naive = int(1.2**500 > float(np.finfo(np.float32).max))
    what = "values out of range taken, of 6; naive: light grows without end at an albedo of 1.2"
    figures("I11", what, naive=naive, ours=taken(*scenes), at_most=0)


def test_i12_pictures_larger_than_memory(figures):
    with pytest.raises(SceneError, match="GiB"):
        check_memory(100_000, 100_000)
    figures("I12", "pictures of 1e5 × 1e5 pixels, 112 GiB, begun", ours=0, at_most=0)


def test_i13_scenes_that_must_be_black(figures):
    """Warned of: no light, a light without power, a lamp walled in, a camera walled in."""
    wall, inside = BALL | {"center": [0, 4, 5]}, BALL | {"center": [0, 0, 5]}
    dark = [{"lights": []}, {"lights": [LAMP | {"intensity": 0}]}, {"spheres": [wall]}, {"spheres": [inside]}]
    silent = 0
    for scene in dark:
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            jaxrt.build(SOUND | scene)
        silent += not any(issubclass(w.category, jaxrt.SceneWarning) for w in told)
    figures(
        "I13",
        "scenes that must be black, of 4, built without a warning; naive: silence",
        naive=len(dark),
        ours=silent,
        at_most=0,
    )
