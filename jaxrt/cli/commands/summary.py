"""What is in a scene, as tables for `jaxrt info`."""

import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from jaxrt.cli.streams import spelt
from jaxrt.core.messages import one_line
from jaxrt.description import SceneDescription, Solid
from jaxrt.description.kinds import CAMERAS, LIGHTS, MATERIALS, Family
from jaxrt.description.textures import texture_of, textures_used
from jaxrt.scene import Scene, placed
from jaxrt.scene.parameters import names, parameters
from jaxrt.shapes import Triangles
from jaxrt.shapes.search.bvh import survey

ROWS = 20  # of materials and lights, before the table is cut


def print_summary(
    source: str,
    description: SceneDescription,
    scene: Scene,
    messages: Sequence[str],
    console: Console | None = None,
) -> None:
    """Print counts, materials, lights, parameters with shapes, warnings, and what will be compiled."""
    console = console or Console()
    present, absent = features(description)
    facts = [
        ("objects", _counts(description)),
        ("camera", _camera(description) + (f", the first of {n}" if (n := len(description.views)) > 1 else "")),
        ("render", f"{description.render.spp} spp, max_depth {description.render.max_depth}"),
        ("environment", _numbers(description.environment.radiance) if description.environment else "black"),
        ("compiled", ", ".join(present)),
        ("left out", ", ".join(absent) or "nothing"),
    ]
    console.print(_table(source, ("", ""), facts))
    if description.textures:
        console.print(_table("textures", ("name", "type", "texels", "file"), _textures(description)))
    console.print(_table("materials", ("name", "type", "value", "objects"), _materials(description)))
    if description.meshes:
        heads = ("", "file", "faces", "vertices", "without area, dropped", "material")
        console.print(_table("meshes", heads, _meshes(description)))
    if (triangles := placed(scene).triangles) is not None:
        console.print(_table("ray search among triangles", ("", ""), _search(triangles)))
    console.print(_table("lights", ("", "position", "intensity W/sr", "radius"), _lights(description)))
    if any(light.type != LIGHTS.default for light in description.lights):
        console.print(_table("other lights", ("", "type", "value"), _other_lights(description)))
    called = names(scene)
    shapes = [(name, str(value.shape), ", ".join(called.get(name, ()))) for name, value in parameters(scene).items()]
    console.print(_table("parameters", ("name", "shape", "rows with names"), shapes))
    for message in messages:
        console.print(f"warning: {_plain(message)}", soft_wrap=True)


def features(description: SceneDescription) -> tuple[list[str], list[str]]:
    """Return the features that are compiled for this scene, and those that it lacks and that are left out."""
    types = {MATERIALS.kind_of(description.materials[name]).name for name in description.used}
    lights = sorted({light.type for light in description.lights} - {LIGHTS.default})
    radii = [light.radius for light in description.lights if light.type == LIGHTS.default]
    camera = {description.camera.type} - {CAMERAS.default}
    there = {
        "spheres": bool(description.spheres),
        "triangles": bool(description.triangles or description.meshes),
        **{name: name in types for name in MATERIALS.kinds},
        "point lights": 0 in radii,
        "sphere lights": any(radii),
        **{f"{name} lights": True for name in lights},
        "environment": description.environment is not None,
        "textures": bool(textures_used(description)),
        **{f"{name} camera": True for name in camera},
    }
    return [name for name, is_there in there.items() if is_there], [n for n, is_there in there.items() if not is_there]


def _table(title: str, heads: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    table = Table(title=_plain(title), title_justify="left", show_header=any(heads))
    for head in heads:
        table.add_column(head, overflow="fold")
    rows = list(rows)
    for row in rows[:ROWS]:
        table.add_row(*map(_plain, row))
    if len(rows) > ROWS:
        table.add_row(f"and {len(rows) - ROWS} more")
    return table


def _plain(text: str) -> str:
    """Return text that is neither markup nor a command to the terminal, whoever chose the names in it, as printed."""
    return escape(spelt(one_line(text), sys.stdout.encoding or "utf-8"))


def _numbers(values: Iterable[float]) -> str:
    return "(" + ", ".join(f"{value:g}" for value in values) + ")"


def _counts(scene: SceneDescription) -> str:
    groups = {
        "spheres": scene.spheres,
        "meshes": scene.meshes,
        "triangles": scene.triangles,
        "lights": scene.lights,
    }
    counted = [f"{len(members)} {name}" for name, members in groups.items()]
    return ", ".join([*counted, f"{len(scene.materials)} materials"])


def _camera(scene: SceneDescription) -> str:
    camera = scene.camera
    if camera.type != CAMERAS.default:
        return f"{camera.type}: {_values(camera, CAMERAS)}, {camera.width}x{camera.height}"
    view = f"{_numbers(camera.position)} to {_numbers(camera.target)}, up {_numbers(camera.up)}"
    turned = "".join(f", {name} {_value(x)}" for name in ("roll", "rotate") if (x := getattr(camera, name)) is not None)
    return f"{view}{turned}, fov {camera.fov:g}°, {camera.width}x{camera.height}"


def _values(table: Any, family: Family) -> str:
    """Return the fields of a kind's table in words."""
    values = {field: getattr(table, field) for field in family.kind_of(table).measures}
    return ", ".join(f"{field} {_value(value)}" for field, value in values.items() if value is not None)


def _value(value: Any) -> str:
    numbers = _numbers(value) if np.ndim(value) else f"{value:g}"
    return numbers if texture_of(value) is None else f"{texture_of(value)} times {numbers}"


def _materials(scene: SceneDescription) -> Iterable[tuple[str, str, str, str]]:
    solids: list[Solid] = [*scene.spheres, *scene.triangles]
    used = Counter(solid.material for solid in solids)
    used.update(name for mesh in scene.meshes for name in mesh.names)
    for name, material in scene.materials.items():
        yield name, MATERIALS.kind_of(material).name, _values(material, MATERIALS), str(used[name])


def _textures(scene: SceneDescription) -> Iterable[tuple[str, str, str, str]]:
    for name, texture in scene.textures.items():
        size = f"{texture.shape[1]}x{texture.shape[0]}" if texture.type == "image" else ""
        yield name, texture.type, size, getattr(texture, "file", None) or ""


def _meshes(scene: SceneDescription) -> Iterable[tuple[str, ...]]:
    for i, mesh in enumerate(scene.meshes):
        dropped = len(mesh.faces) - len(mesh.kept)
        counts = (str(n) for n in (len(mesh.kept), len(mesh.vertices), dropped))
        yield str(i), mesh.file or "arrays", *counts, ", ".join(mesh.names)


def _search(triangles: Triangles) -> Iterable[tuple[str, str]]:
    """Tell how the triangle that a ray hits is found, and what that costs."""
    faces = np.asarray(triangles.faces)
    tree = survey(np.asarray(triangles.vertices), faces)
    yield "faces", str(len(faces))
    if tree is None:
        yield "method", "brute force: every face is tested"
        return
    yield "method", "BVH: a tree of boxes"
    yield "depth", str(tree.depth)
    yield "nodes, leaves", f"{tree.nodes}, {tree.leaves}"
    yield "build time", f"{tree.seconds:.2f} s"
    yield (
        "expected visits",
        f"{tree.node_visits:.1f} nodes, {tree.leaf_visits:.1f} leaves a ray (surface-area heuristic)",
    )


def _lights(scene: SceneDescription) -> Iterable[tuple[str, str, str, str]]:
    for i, light in enumerate(scene.lights):
        if light.type != LIGHTS.default:
            continue
        radius = f"{light.radius:g}" if light.radius else "point"
        yield str(i), _numbers(light.position), _numbers(light.intensity), radius


def _other_lights(scene: SceneDescription) -> Iterable[tuple[str, str, str]]:
    for i, light in enumerate(scene.lights):
        if light.type != LIGHTS.default:
            yield str(i), light.type, _values(light, LIGHTS)
