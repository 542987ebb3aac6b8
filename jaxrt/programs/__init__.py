"""Compiled programs, kept in a private folder between runs of the command line.

JAX's own cache of compiled programs spares compilation only; tracing and lowering a render take another second and a
half each time. Here the finished program is found by what determines it, without tracing.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jax import Array
from jax.experimental.compilation_cache.compilation_cache import reset_cache
from jax.experimental.serialize_executable import deserialize_and_load, serialize
from jax.stages import Compiled

from jaxrt.programs.jax_files import lend_jax_files
from jaxrt.programs.kept import SUFFIX, file_of, read_program, write_program
from jaxrt.programs.key import key_of
from jaxrt.programs.matching import matching
from jaxrt.programs.private import NotPrivate, cache_folder, private_folder
from jaxrt.programs.trial import on_trial
from jaxrt.scene import Scene
from jaxrt.transport.film import Plan, Run
from jaxrt.transport.interior import sum_share
from jaxrt.transport.path import Tables

__all__ = ["KEPT", "NotPrivate", "cache_folder", "is_kept", "lend_jax_files", "load_or_compile", "private_folder"]

KEPT = 64  # programs in a folder, of about a megabyte each

_FIRST = np.int32(0)  # share
Arguments = tuple[Tables, Run, Any]
Program = Callable[[Tables, Run, Any], Array]  # of (tables, run, share)


def load_or_compile(folder: Path | None, scene: Scene, tables: Tables, run: Run, plan: Plan) -> Program:
    """Return the program of `sum_share` for arguments of this structure, from the folder if it is there.

    tables: those of the scene, by whose structure the program is found. It has run once, with `run`, which should draw
    no sample: only then XLA tells what it cannot find in a loaded one.
    Files are loaded as code: none is looked at where the folder is not private (`private_folder`).
    """
    with suppress(NotPrivate):
        if folder is not None:
            return _kept_or_compiled(private_folder(folder), key_of(scene, run, plan), (tables, run, _FIRST), plan)
    program: Program = partial(sum_share, plan=plan)
    jax.block_until_ready(program(tables, run, _FIRST))
    return program


def is_kept(folder: Path | None, scene: Scene, run: Run, plan: Plan) -> bool:
    """Return whether `load_or_compile` would find the program; it is neither loaded nor compiled."""
    if folder is None:
        return False
    key = key_of(scene, run, plan)
    return read_program(file_of(folder, key), key) is not None


def _kept_or_compiled(folder: Path, key: bytes, arguments: Arguments, plan: Plan) -> Program:
    file = file_of(folder, key)
    loaded = _load(file, key, arguments, plan)
    if loaded is not None:
        return loaded
    program = _compile(arguments, plan)
    # Only what has run is kept
    jax.block_until_ready(program(*arguments))
    with suppress(OSError):
        write_program(file, key, matching(serialize(program)[0]))
        _forget_oldest(folder)
    return program


def _load(file: Path, key: bytes, arguments: Arguments, plan: Plan) -> Program | None:
    """Return the program in the file after a run, or None where there is none that runs."""
    if not os.path.lexists(file):
        return None
    with suppress(OSError), on_trial(file) as died:
        with suppress(Exception):  # whatever is wrong with the program, compiling mends it
            kept = None if died else read_program(file, key)
            if kept is not None:
                program = _try(kept, arguments, plan)
                file.touch()
                return program
        # While the mark is there: nobody else tries it
        file.unlink()
    return None


def _try(kept: bytes, arguments: Arguments, plan: Plan) -> Program:
    """Load the program and run it. Raises whatever JAX does."""
    inputs, output = jax.tree.structure((arguments, {})), jax.tree.structure(0)
    program = deserialize_and_load(kept, inputs, output, execution_devices=plan.devices)
    jax.block_until_ready(program(*arguments))
    return program


def _compile(arguments: Arguments, plan: Plan) -> Compiled:
    with _cache_of_jax_off():
        return sum_share.lower(*arguments, plan).compile()


@contextmanager
def _cache_of_jax_off() -> Iterator[None]:
    """Compile anew: a program that JAX had from its own cache loses its functions when it is serialized again."""
    before = jax.config.values["jax_enable_compilation_cache"]
    jax.config.update("jax_enable_compilation_cache", False)
    reset_cache()  # JAX looks at the setting once
    try:
        yield
    finally:
        jax.config.update("jax_enable_compilation_cache", before)
        reset_cache()


def _forget_oldest(folder: Path) -> None:
    """Keep the programs used last."""
    for file in sorted(folder.glob(f"*{SUFFIX}"), key=lambda file: file.stat().st_mtime)[:-KEPT]:
        file.unlink(missing_ok=True)
