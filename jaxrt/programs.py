"""Compiled programs, kept in a folder between runs of the command line.

JAX's own cache of compiled programs spares compilation only; tracing and lowering a render take another second and a
half each time. Here the finished program is found by what determines it, without tracing.
"""

import hashlib
import os
import platform
import tempfile
from collections.abc import Callable
from pathlib import Path

import jax
import jaxlib
from jax import Array
from jax.experimental.serialize_executable import deserialize_and_load, serialize

from jaxrt.film import Plan, Run
from jaxrt.render import draw_sum
from jaxrt.scene import Scene


def load_or_compile(folder: Path, scene: Scene, run: Run, plan: Plan) -> Callable[[Scene, Run], Array]:
    """Return the program of `draw_sum` for arguments of this structure, from the folder if it is there.

    Files in the folder are loaded as code: it must belong to the user.
    """
    file = folder / f"{_fingerprint(scene, run, plan)}.program"
    inputs, output = jax.tree.structure(((scene, run), {})), jax.tree.structure(0)
    if file.exists():
        try:
            return deserialize_and_load(file.read_bytes(), inputs, output, execution_devices=plan.devices)
        except Exception:  # whatever is wrong with the file, compiling mends it
            file.unlink(missing_ok=True)
    program = draw_sum.lower(scene, run, plan).compile()
    _write(file, serialize(program)[0])
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


def _write(file: Path, program: bytes) -> None:
    """Write the file whole or not at all."""
    with tempfile.NamedTemporaryFile(dir=file.parent, delete=False) as part:
        part.write(program)
    os.replace(part.name, file)
