"""Compiled programs, kept in a folder between runs of the command line.

JAX's own cache of compiled programs spares compilation only; tracing and lowering a render take another second and a
half each time. Here the finished program is found by what determines it, without tracing.
"""

import hashlib
import platform
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

import jax
import jaxlib
from jax import Array
from jax.experimental.compilation_cache.compilation_cache import reset_cache
from jax.experimental.serialize_executable import deserialize_and_load, serialize

from jaxrt.film import Plan, Run
from jaxrt.render import sum_parts
from jaxrt.scene import Scene
from jaxrt.writing import write_whole

KEPT = 64  # programs in a folder, of about a megabyte each


def load_or_compile(folder: Path | None, scene: Scene, run: Run, plan: Plan) -> Callable[[Scene, Run], Array]:
    """Return the program of `sum_parts` for arguments of this structure, from the folder if it is there.

    It has run once, with `run`, which should draw no sample: only then XLA tells what it cannot find in a loaded one.
    Files in the folder are loaded as code: it must belong to the user.
    """
    program: Callable[[Scene, Run], Array] = partial(sum_parts, plan=plan)
    if folder is not None:
        file = folder / f"{_fingerprint(scene, run, plan)}.program"
        loaded = _load(file, scene, run, plan)
        if loaded is not None:
            return loaded
        program = _compile(file, scene, run, plan)
        _forget_oldest(folder)
    jax.block_until_ready(program(scene, run))
    return program


def _load(file: Path, scene: Scene, run: Run, plan: Plan) -> Callable[[Scene, Run], Array] | None:
    """Return the program in the file after a run, or None where there is none that runs."""
    if not file.exists():
        return None
    inputs, output = jax.tree.structure(((scene, run), {})), jax.tree.structure(0)
    try:
        program = deserialize_and_load(file.read_bytes(), inputs, output, execution_devices=plan.devices)
        jax.block_until_ready(program(scene, run))
        file.touch()
        return program
    except Exception:  # whatever is wrong with the file, compiling mends it
        file.unlink(missing_ok=True)
        return None


def _compile(file: Path, scene: Scene, run: Run, plan: Plan) -> Callable[[Scene, Run], Array]:
    """Return the program, which from now on is in the file too, if the disk has room."""
    with _cache_of_jax_off():
        program = sum_parts.lower(scene, run, plan).compile()
    with suppress(OSError):
        write_whole(file, partial(_write, serialize(program)[0]))
    return program


def _fingerprint(scene: Scene, run: Run, plan: Plan) -> str:
    """Return a hash of all that determines the program: structure and shapes, plan, code, versions, machine."""
    leaves, structure = jax.tree.flatten((scene, run))
    shapes = [(leaf.shape, str(leaf.dtype)) for leaf in map(jax.typeof, leaves)]
    machine = platform.node(), platform.platform(), platform.machine(), plan.devices[0].device_kind
    parts = (structure, shapes, plan, machine, jax.__version__, jaxlib.__version__)
    digest = hashlib.sha256(repr(parts).encode())
    for source in sorted(Path(__file__).parent.rglob("*.py")):
        digest.update(source.read_bytes())
    return digest.hexdigest()


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
    for file in sorted(folder.glob("[!.]*.program"), key=lambda file: file.stat().st_mtime)[:-KEPT]:
        file.unlink(missing_ok=True)


def _write(program: bytes, file: Path) -> None:
    file.touch(mode=0o600)  # what is loaded as code is nobody else's
    file.write_bytes(program)
