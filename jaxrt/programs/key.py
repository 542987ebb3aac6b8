"""What determines a compiled program: it is found by this, without tracing."""

import hashlib
import json
import os
import platform
import subprocess
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import jaxlib

from jaxrt.scene import Scene
from jaxrt.transport.film import Plan, Run
from jaxrt.transport.interior import sum_share
from jaxrt.transport.path import tables_of

# Settings of JAX that change no code, or that the structure tells
BESIDE = ("jax_compilation_cache", "jax_enable_compilation_cache", "jax_log", "jax_num_cpu_devices", "jax_persistent")
FLAGS = ("XLA_FLAGS", "TF_XLA_FLAGS", "LIBTPU_INIT_ARGS")
# Lines of /proc/cpuinfo, by which LLVM chooses instructions
CPU = ("vendor_id", "cpu family", "model", "model name", "stepping", "flags", "Features", "CPU implementer", "CPU part")


def key_of(scene: Scene, run: Run, plan: Plan) -> bytes:
    """Return one line that holds all that determines the program of `sum_share`, long values by their SHA-256.

    That is the scene's structure and shapes, the plan, this code, versions, settings, and the machine. Kinds that users
    wrote may call what they like: a scene that has any is told apart by the program that it is traced to.
    """
    leaves, structure = jax.tree.flatten((scene, run))
    shapes = [(leaf.shape, str(leaf.dtype), leaf.weak_type) for leaf in map(jax.typeof, leaves)]
    settings = {name: getattr(jax.config, name, None) for name in sorted(jax.config.values)}
    device = plan.devices[0]
    key = {
        "versions": [jax.__version__, jaxlib.__version__, platform.python_version()],
        "machine": [platform.system(), platform.machine(), *platform.libc_ver(), device.device_kind],
        "platform": device.client.platform_version,
        "cpu": _digest(cpu_features()),
        "flags": {name: os.environ[name] for name in FLAGS if name in os.environ},
        "settings": _digest(repr({k: v for k, v in settings.items() if not k.startswith(BESIDE)})),
        "code": code_of(scene, plan),
        "structure": _digest(repr((structure, shapes, plan))),
    }
    return json.dumps(key, sort_keys=True).encode()


@cache
def cpu_features() -> str:
    """Return what the system tells of the kinds of cores that the machine has."""
    with suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(errors="replace").splitlines()
        return "\n".join(sorted({line for line in lines if line.split("\t")[0].strip(" :") in CPU}))
    with suppress(OSError, subprocess.SubprocessError):
        asked = ["sysctl", "-n", "machdep.cpu.brand_string", "hw.optional"]
        return subprocess.run(asked, capture_output=True, text=True, timeout=10).stdout
    return platform.processor()


@cache
def code() -> str:
    """Return the SHA-256 of jaxrt's own sources."""
    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parents[1].rglob("*.py")):
        content = source.read_bytes()
        digest.update(f"{source.name} {len(content)}\n".encode() + content)
    return digest.hexdigest()


def code_of(scene: Scene, plan: Plan) -> str:
    """Return what tells the code that draws a scene: jaxrt's own, and that of users' kinds if any are in it."""
    return code() + code_of_kinds(scene, plan)


def code_of_kinds(scene: Scene, plan: Plan) -> str:
    """Return the SHA-256 of the program as it is traced, where kinds of users' own are in it, else nothing."""
    things = jax.tree.leaves(scene, is_leaf=lambda thing: hasattr(thing, "kind"))
    if all(type(thing).__module__.startswith("jaxrt.") for thing in things if hasattr(thing, "kind")):
        return ""
    leaves, structure = jax.tree.flatten(jax.eval_shape(tables_of, scene))
    return _traced(tuple(leaves), structure, plan)


@cache
def _traced(leaves: tuple[jax.ShapeDtypeStruct, ...], structure: Any, plan: Plan) -> str:
    """Return the SHA-256 of the program of such tables; lowering takes seconds, and a render asks twice."""
    number: Any = jax.ShapeDtypeStruct((), jnp.int32)
    run = Run(number.update(dtype=jnp.uint32), number, number, number)
    tables = jax.tree.unflatten(structure, leaves)
    return _digest(sum_share.lower(tables, run, number, plan).as_text())


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
