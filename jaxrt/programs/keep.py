"""Compiled programs kept between Python processes, those of the caller's own functions too."""

import gc
import os
from os import PathLike
from pathlib import Path

import jax
from jax.experimental.compilation_cache.compilation_cache import reset_cache

from jaxrt.core.messages import show
from jaxrt.programs.jax_files import lend_jax_files
from jaxrt.programs.private import CHOOSE, cache_folder, private_folder

SELDOM = 50_000  # new objects between two looks of the garbage collector
_kept: list[Path] = []  # the folder of this process, once there is one


def keep_programs(folder: str | PathLike[str] | None = None) -> Path:
    """Keep all that JAX compiles from now on for later processes, and return the folder where it is kept.

    A later process that calls this too finds programs again, by what they compute: renders, gradients, and functions of
    your own around them. They are traced anew, and not compiled. New ones are kept when the process ends well.

    folder: by default `$XDG_CACHE_HOME/jaxrt`, the command line's. Programs are code: the folder is made, or must be,
    the user's own, of mode 0700, on a path without links that nobody else can write in. What Python has loaded so far
    is taken out of the garbage collector's sight (`gc.freeze`), which looks less often from then on (`set_threshold`):
    tracing makes many objects that stay, and would have them looked through time and again.

    Raises ValueError, in one line, where the folder is not such, for what is no folder's name, and where JAX keeps its
    programs elsewhere already; OSError where there is no room.
    """
    if folder is not None and (not isinstance(folder, str | PathLike) or not os.fspath(folder)):
        raise ValueError(f"keep_programs: folder is {show(folder)}: pass a path, or none for the folder of your cache")
    wanted = cache_folder() if folder is None else Path(os.path.abspath(os.path.expanduser(folder)))
    if _kept == [wanted]:
        return wanted
    elsewhere = _kept[0] if _kept else jax.config.values["jax_compilation_cache_dir"]
    if elsewhere:
        raise ValueError(
            f"keep_programs: JAX keeps its programs in {show(str(elsewhere))} already: call it once, and without "
            "jax_compilation_cache_dir or JAX_COMPILATION_CACHE_DIR"
        )
    lend_jax_files(private_folder(wanted, CHOOSE if folder is None else "pass a folder of yours"))
    reset_cache()  # JAX looks for its folder once, before it compiles for the first time
    _kept.append(wanted)
    gc.freeze()
    young, *others = gc.get_threshold()
    if young:  # 0: the caller has none
        gc.set_threshold(max(young, SELDOM), *others)
    return wanted
