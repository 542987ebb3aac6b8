"""What every command begins with: the scene with its warnings, JAX with its cores, a place for the results."""

import argparse
import gc
import os
import sys
import warnings
from collections.abc import Callable
from pathlib import Path

import jax

from jaxrt.checks import check_memory
from jaxrt.cli.errors import UsageError, refusing
from jaxrt.description import SceneDescription, SceneWarning, show
from jaxrt.io.image import check_suffix
from jaxrt.io.scene_file import read_description
from jaxrt.render import use_cpu_cores
from jaxrt.scene import Scene, build


def check_output(path: Path) -> None:
    """Refuse an output that could not be written, before any work."""
    with refusing():
        check_suffix(path)
    check_folder(path)


def check_folder(path: Path) -> None:
    """Refuse an output of any kind whose folder could not take it."""
    if path.is_dir():
        raise UsageError(f"{path}: is a folder: name a file in it")
    if not path.parent.is_dir():
        raise UsageError(f"{path}: the folder {show(str(path.parent))} does not exist: make it first")
    if not os.access(path.parent, os.W_OK):
        raise UsageError(f"{path}: the folder {show(str(path.parent))} is not writable: choose another")


def described(args: argparse.Namespace) -> SceneDescription:
    """Return the scene's description, with what the arguments override."""
    description = read_description(args.scene)
    size = {k: v for k in ("width", "height") if (v := getattr(args, k)) is not None}
    drawn = {k: v for k in ("spp", "max_depth") if (v := getattr(args, k)) is not None}
    camera = description.camera.model_copy(update=size)
    check_memory(camera.width, camera.height, str(args.scene))
    render = description.render.model_copy(update=drawn)
    return description.model_copy(update={"camera": camera, "render": render})


def usable_cores() -> int:
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1


def start_jax(cores: int) -> Path | None:
    """Give JAX the cores, and return the folder that keeps compiled programs between runs, if it can be written."""
    use_cpu_cores(cores)
    # Tracing makes many objects that live as long as this short process: collecting them costs a tenth of the start
    gc.disable()
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "jaxrt"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    if not os.access(folder, os.W_OK):
        return None
    # The small programs around the large one
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        jax.config.update("jax_compilation_cache_dir", str(folder))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    return folder


def warn(message: object) -> None:
    print(f"jaxrt: warning: {message}", file=sys.stderr)


def built(description: SceneDescription, warn: Callable[[object], None] = warn) -> Scene:
    """Return the scene, handing its warnings to `warn`."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", SceneWarning)
        scene = build(description)
    for warning in caught:
        warn(warning.message)
    return scene
