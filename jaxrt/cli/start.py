"""What every command begins with: the scene with its warnings, JAX with its cores, a place for the results."""

import argparse
import gc
import os
import sys
import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import jax

from jaxrt.cli.errors import UsageError, refusing
from jaxrt.cli.places import check_file
from jaxrt.core.messages import one_line
from jaxrt.core.system import usable_cores
from jaxrt.description import SceneDescription, SceneWarning, show
from jaxrt.io.image import check_suffix
from jaxrt.io.scene_file import read_description
from jaxrt.programs import NotPrivate, cache_folder, lend_jax_files, private_folder
from jaxrt.render import use_cpu_cores
from jaxrt.scene import Scene, build
from jaxrt.scene.checks import check_memory


def check_output(path: Path, name: str = "picture.png") -> None:
    """Refuse, before any work, a picture that could not be written; `name` is one to choose in a folder."""
    if not os.path.isdir(path):
        with refusing():
            check_suffix(path)
    check_file(path, name)


def described(args: argparse.Namespace) -> SceneDescription:
    """Return the scene's description, with what the arguments override."""
    description = read_description(args.scene, args.allow_folder)
    size = {k: v for k in ("width", "height") if (v := getattr(args, k)) is not None}
    drawn = {k: v for k in ("spp", "max_depth") if (v := getattr(args, k)) is not None}
    camera = _camera(args, description).model_copy(update=size)
    check_memory(camera.width, camera.height, str(args.scene))
    render = description.render.model_copy(update=drawn)
    return description.model_copy(update={"camera": camera, "render": render})


def _camera(args: argparse.Namespace, description: SceneDescription) -> Any:
    """Return the camera that the arguments name, by default the first. Raises UsageError where there is none."""
    number, views = getattr(args, "camera", 0), description.views
    if number >= len(views):
        last = f"0 to {len(views) - 1}" if len(views) > 1 else "0, the only one"
        raise UsageError(f"argument --camera: {args.scene} has no camera {number}: use {last}")
    return views[number]


def present(cores: int | None) -> int:
    """Return at most the cores that there are, and all of them for None."""
    most = usable_cores()
    if cores is None:
        return most
    if cores > most:
        warn(f"--cores {cores}: this machine has {most}, taking these")
    return min(cores, most)


def start_jax(cores: int) -> Path | None:
    """Give JAX the cores, and return the private folder that keeps programs between runs, if there is one."""
    with suppress(RuntimeError):  # JAX runs already, in a program that calls this one: with the devices that it has
        use_cpu_cores(cores)
    # Tracing makes many objects that live as long as this short process: collecting them costs a tenth of the start
    gc.disable()
    folder = None
    try:
        folder = private_folder(cache_folder())
        # The small programs around the large one
        if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
            lend_jax_files(folder)
    except NotPrivate as error:
        warn(f"compiled programs are not kept: {error}")
        return None
    except OSError as error:
        warn(f"compiled programs are not kept: {folder}: {error.strerror}: make room, or set XDG_CACHE_HOME")
        return None
    return folder


def check_devices() -> None:
    """Refuse to go on where JAX has no device, as where JAX_PLATFORMS names one that is not there."""
    try:
        jax.devices()
    except Exception as error:  # RuntimeError for some platforms, AssertionError for others
        reason = show(str(error)) if str(error) else type(error).__name__
        raise UsageError(
            f"JAX finds no device ({reason}): unset JAX_PLATFORMS, or install JAX for that device"
        ) from None


def warn(message: object) -> None:
    """Print a warning in one line on stderr."""
    print(f"jaxrt: warning: {one_line(str(message))}", file=sys.stderr)


def built(description: SceneDescription, warn: Callable[[object], None] = warn) -> Scene:
    """Return the scene, handing its warnings to `warn`."""
    check_devices()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", SceneWarning)
        scene = build(description)
    for warning in caught:
        warn(warning.message)
    return scene
