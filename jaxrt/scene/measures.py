"""What each parameter of a scene measures: from its range follow bounds, steps and what moves with the origin."""

from jaxrt.description import SceneError, nearest
from jaxrt.description.kinds import CAMERAS, LIGHTS, MATERIALS
from jaxrt.description.values import Measure

_PLACE = Measure("place", "xyz", "[0, 0, 0]")
_LIGHT = Measure("positive", "rgb", "[1, 1, 1]", tints=True)
_OTHERS = {
    "spheres.center": _PLACE,
    "spheres.radius": Measure("positive", "", "10"),
    "meshes.vertices": _PLACE,
    "environment.radiance": _LIGHT,
    "lights.position": _PLACE,
    "lights.intensity": _LIGHT,
    "lights.radius": Measure("positive", "", "1"),
    "camera.position": _PLACE,
    "camera.target": _PLACE,
    "camera.fov": Measure("angle", "", "60"),
}
ALONE = ("camera", "environment")  # owners of parameters without rows


def measure(name: str) -> Measure:
    """Return what a parameter measures. Raises SceneError for a name that nothing has."""
    known = _OTHERS | MATERIALS.parameters | LIGHTS.parameters | CAMERAS.parameters
    if name not in known:
        raise SceneError(f"{name}: no scene has such a parameter{nearest(name, known)}")
    return known[name]


def has_rows(name: str) -> bool:
    """Return whether there is a row for each thing of its sort."""
    return name.split(".")[0] not in ALONE
