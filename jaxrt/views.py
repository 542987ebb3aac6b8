"""What is drawn of a scene: the outputs that go by a name, a window of the picture, a list of its pixels."""

import re
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.typing import ArrayLike

from jaxrt.core.counts import whole_number
from jaxrt.core.messages import nearest, show
from jaxrt.description import SceneError
from jaxrt.scene import Scene
from jaxrt.transport.film import Plan, Run
from jaxrt.transport.outputs import KINDS, SKY, Mask, Output, parts_of

LIGHT, NUMBERS = ("radiance", "foreground"), ("shape", "material")
NAMES = (*LIGHT, *KINDS, SKY, *NUMBERS)
MASK = re.compile(r"mask\[(?P<name>.+)\]")
Window = tuple[Any, Any, int, int]  # column and row of its corner, columns, rows


class Asked(NamedTuple):
    """What has to be drawn for the outputs of some names."""

    names: tuple[str, ...]
    light: bool  # the radiance
    outputs: dict[str, Output]  # by name
    numbers: bool  # those of shapes and materials


def asked_for(scene: Scene, outputs: Sequence[str]) -> Asked:
    """Return what has to be drawn. Raises ValueError for names that no output has, SceneError for masks of nothing."""
    if isinstance(outputs, str) or not all(isinstance(name, str) for name in outputs):
        raise ValueError(f'render: outputs is {show(outputs)}: pass names, as in ("radiance", "depth")')
    names, means = tuple(dict.fromkeys(outputs)), dict[str, Output]()
    if not names:
        raise ValueError('render: outputs is empty: pass names, as in ("radiance", "depth")')
    for name in names:
        mask = MASK.fullmatch(name)
        if mask is not None:
            means[name] = _mask_of(scene, mask["name"])
        elif name not in NAMES:
            raise ValueError(f"render: unknown output {show(name)}{nearest(name, (*NAMES, 'mask[NAME]'))}")
        elif name in KINDS or name == SKY:
            means[name] = name
    if "foreground" in names:
        means[SKY] = SKY
    if "position" in names and scene.origin is not None:
        means["alpha"] = "alpha"
    return Asked(names, any(name in LIGHT for name in names), means, any(name in NUMBERS for name in names))


def _mask_of(scene: Scene, name: str) -> Mask:
    """Return the mask of what is called so: spheres, lights and meshes, or else a material."""
    things, (spheres, first_face) = scene.names.things, _starts(scene)
    ranges = []
    if name in things.spheres:
        ranges.append((things.spheres[name], things.spheres[name] + 1))
    if name in things.lights and first_face > spheres:
        ranges.append((spheres + things.lights[name], spheres + things.lights[name] + 1))
    if name in things.meshes:
        first, end = things.meshes[name]
        ranges.append((first_face + first, first_face + end))
    if ranges:
        return Mask(tuple(ranges))
    if name in things.materials:
        return Mask((), (things.materials[name].row,))
    known = [*things.spheres, *things.lights, *things.meshes, *things.materials]
    raise SceneError(f"mask[{name}]: nothing that can be seen goes by that name{nearest(name, known)}")


def _starts(scene: Scene) -> tuple[int, int]:
    """Return the numbers of the first primitive that is a sphere light, and of the first triangle."""
    spheres = 0 if scene.spheres is None else scene.spheres.radius.shape[0]
    lights = None if scene.lights is None else scene.lights.radius
    return spheres, spheres + (0 if lights is None else lights.shape[0])


def answers(
    scene: Scene, asked: Asked, light: Array | None, drawn: Array | None, numbers: Array | None
) -> dict[str, Array]:
    """Return the outputs by name. light: the picture; drawn: that of all `asked.outputs`; numbers: of what is met."""
    found = {}
    if drawn is not None:
        found = dict(zip(asked.outputs, parts_of(drawn, tuple(asked.outputs.values())), strict=True))
    if "position" in found and scene.origin is not None:
        found["position"] += found["alpha"][..., None] * lax.stop_gradient(_like(scene.origin, found["position"]))
    if light is not None:
        found["radiance"] = light
        if SKY in found:
            found["foreground"] = light - found[SKY]
    if numbers is not None:
        found["shape"] = _shapes(scene, numbers[..., 0])
        found["material"] = _materials(scene, numbers)
    return {name: found[name] for name in asked.names}


def _like(row: Array, picture: Array) -> Array:
    return jnp.broadcast_to(row, picture.shape)


def _shapes(scene: Scene, primitive: Array) -> Array:
    """Return the number of the thing that a primitive is of: meshes are one each, those before them by themselves."""
    faces, (_, first) = scene.names.things.faces, _starts(scene)
    if not faces:
        return primitive
    ends = jnp.asarray(np.cumsum(faces), jnp.int32)
    mesh = jnp.searchsorted(ends, primitive - first, side="right").astype(jnp.int32)
    beyond = jnp.maximum(primitive - first - ends[-1], 0)
    return jnp.where(primitive < first, primitive, first + mesh + beyond)


def _materials(scene: Scene, numbers: Array) -> Array:
    """Return the number of each material in the file, −1 for lights and where nothing is met."""
    rows = sum(scene.materials.counts)
    table = np.arange(rows, dtype=np.int32)
    for material in scene.names.things.materials.values():
        table[material.row] = material.number
    row = numbers[..., 1]
    own = (numbers[..., 0] >= 0) & (row < rows)
    return jnp.where(own, jnp.asarray(table)[jnp.clip(row, 0, rows - 1)], -1) if rows else jnp.full_like(row, -1)


def viewed(scene: Scene, run: Run, plan: Plan, window: Window | None, pixels: ArrayLike | None) -> tuple[Run, Plan]:
    """Return run and plan of a window or a list of pixels, or as they are. Raises ValueError for what is neither."""
    if window is not None and pixels is not None:
        raise ValueError("render: window and pixels are both given: pass one of them")
    if window is not None:
        corner, size = _window(scene, window)
        return run._replace(corner=corner), plan._replace(size=size)
    if pixels is None:
        return run, plan
    chosen = _pixels(scene, pixels)
    n = chosen.shape[0]
    return run._replace(pixels=chosen), plan._replace(size=(n, 1), tile=(min(plan.lanes, n), 1))


def _window(scene: Scene, window: Window) -> tuple[Array, tuple[int, int]]:
    """Return corner (2,) and size of a window, of which all but a traced corner is checked."""
    width, height = scene.camera.width, scene.camera.height
    if not hasattr(window, "__len__") or len(window) != 4:
        raise ValueError(f"render: window is {show(window)}, want (x0, y0, width, height)")
    size = whole_number("render: width of window", window[2]), whole_number("render: height of window", window[3])
    for name, first, own, whole in zip(("x0", "y0"), window, size, (width, height), strict=False):
        if isinstance(first, jax.core.Tracer):
            continue
        whole_number(f"render: {name} of window", first, 0)
        if first + own > whole:
            raise ValueError(f"render: window {show(window)} goes past the picture's {width}x{height}: make it smaller")
    return jnp.stack([jnp.int32(window[0]), jnp.int32(window[1])]), size


def _pixels(scene: Scene, pixels: ArrayLike) -> Array:
    """Return a list of pixels (n, 2) in int32, checked unless it is traced."""
    width, height = scene.camera.width, scene.camera.height
    given = pixels if isinstance(pixels, jax.Array) else np.asarray(pixels)
    if given.ndim != 2 or given.shape[1] != 2 or not given.size or not jnp.issubdtype(given.dtype, jnp.integer):
        raise ValueError(
            f"render: pixels is {given.dtype} {given.shape}, want whole numbers (n, 2): column and row of each"
        )
    if not isinstance(given, jax.core.Tracer):
        found = np.asarray(given)
        outside = (found < 0) | (found >= np.asarray([[width, height]]))
        if outside.any():
            i = int(np.argmax(outside.any(-1)))
            raise ValueError(f"render: pixels[{i}] is {show(found[i].tolist())}, outside of {width}x{height}")
    return jnp.asarray(given, jnp.int32)


def cut(picture: Array, run: Run, plan: Plan) -> Array:
    """Return what of a whole picture (height, width, c) a run and a plan draw."""
    if run.pixels is not None:
        return picture[run.pixels[:, 1], run.pixels[:, 0]][None]
    if run.corner is None or plan.size is None:
        return picture
    size = plan.size[1], plan.size[0], picture.shape[2]
    return lax.dynamic_slice(picture, (run.corner[1], run.corner[0], jnp.int32(0)), size)
