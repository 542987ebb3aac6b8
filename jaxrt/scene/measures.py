"""What each parameter of a scene measures: from its range follow bounds, steps and what moves with the origin."""

from jaxrt.description import SceneError, nearest
from jaxrt.description.kinds import CAMERAS, LIGHTS, MATERIALS
from jaxrt.description.values import Measure
from jaxrt.materials import Materials

_PLACE = Measure("place", "xyz", "[0, 0, 0]")
_TURN = Measure("turn", "xyz", "[0, 0, 0]")
_SCALE = Measure("positive", "", "1")
TEXTURES = "textures."  # how the names of their parameters begin
_TEXELS = Measure("fraction", "rgb", "[0.8, 0.8, 0.8]", tints=True)
_OTHERS = {
    "spheres.center": _PLACE,
    "spheres.radius": Measure("positive", "", "10"),
    "meshes.vertices": _PLACE,
    "meshes.translate": _PLACE,
    "groups.translate": Measure("shift", "xyz", "[0, 0, 0]"),
    "meshes.rotate": _TURN,
    "groups.rotate": _TURN,
    "meshes.scale": _SCALE,
    "groups.scale": _SCALE,
    "environment.radiance": Measure("positive", "rgb", "[1, 1, 1]", tints=True),
}
ALONE = ("camera", "environment", "textures")  # owners of parameters without rows
SHAPES = ("spheres", "meshes", "groups", "camera")  # owners of parameters by which the camera sees shapes elsewhere


def measure(name: str) -> Measure:
    """Return what a parameter measures. Raises SceneError for a name that nothing has."""
    if name.startswith(TEXTURES):
        return _TEXELS
    known = _OTHERS | MATERIALS.parameters | LIGHTS.parameters | CAMERAS.parameters
    if name not in known:
        raise SceneError(f"{name}: no scene has such a parameter{nearest(name, known)}")
    return known[name]


def has_rows(name: str) -> bool:
    """Return whether there is a row for each thing of its sort."""
    return name.split(".")[0] not in ALONE


def moves_lamps(name: str) -> bool:
    """Return whether lights that cast shadows of known edges move with a parameter."""
    return name in ("lights.position", "lights.radius")


def moves_shapes(name: str) -> bool:
    """Return whether shapes move with a parameter, as the camera sees them."""
    return name.split(".")[0] in SHAPES and not measure(name).tints


def bends_light(materials: Materials, name: str) -> bool:
    """Return whether light that goes on in single directions, as by mirrors and glass, turns with a parameter."""
    owner, field = name.split(".")
    return owner == "materials" and any(field == own for _, own in materials.bends)
