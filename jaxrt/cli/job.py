"""What determines every sample of a picture, and where its sums are kept between two runs."""

import hashlib
import os
import platform
from importlib.metadata import version
from pathlib import Path

import jax
import numpy as np

from jaxrt.cli.errors import UsageError, refusing
from jaxrt.cli.start import warn
from jaxrt.io.partial import MACHINE, SUFFIX, Facts, Partial, difference, read_partial
from jaxrt.programs.key import code_of, cpu_features
from jaxrt.scene import Scene
from jaxrt.transport.film import BLOCK, Plan


def facts_of(scene: Scene, plan: Plan, seed: int, spp: int) -> Facts:
    """Return what determines every sample: two pictures with the same facts are the same picture."""
    return {
        "code": code_of(scene, plan),
        "jax": version("jax"),
        "jaxlib": version("jaxlib"),
        "width": scene.camera.width,
        "height": scene.camera.height,
        "seed": seed,
        "sampler": plan.sampler,
        "spp": spp,
        "max_depth": plan.max_depth,
        "filter": "box" if plan.filter is None else f"{plan.filter.name} {plan.filter.width:g}",
        "scene": _hash_of(scene),
        MACHINE: _processor(plan.devices[0]),
    }


def samples_of(asked: tuple[int, int] | None, spp: int) -> tuple[int, int]:
    """Return first and end of the samples to draw. Raises UsageError where they would tear a block."""
    if asked is None:
        return 0, spp
    first, end = asked
    if end > spp:
        raise UsageError(f"argument --samples: {first}:{end} goes past {spp} spp: give --spp, the number in all")
    near = [min(spp, (n + BLOCK // 2) // BLOCK * BLOCK) for n in asked]
    if first % BLOCK or end % BLOCK and end != spp:
        near[0] = min(near[0], (spp - 1) // BLOCK * BLOCK)
        near[1] = max(near[1], min(spp, near[0] + BLOCK))
        raise UsageError(f"argument --samples: {first}:{end} tears a block of {BLOCK} samples: use {near[0]}:{near[1]}")
    return first, end


def sums_beside(output: Path) -> Path:
    """Return where the sums of an output are kept: itself, if it is to hold sums, else beside it."""
    return output if output.suffix == SUFFIX else output.with_name(output.name + SUFFIX)


def begin(output: Path, resume: bool, facts: Facts, first: int, end: int) -> Partial:
    """Return the sums to go on from: those that are kept if they are to be resumed, else of no samples."""
    file, nothing = sums_beside(output), Partial.nothing(facts, first)
    if not resume:
        if file.exists() and file != output:
            warn(f"{file}: an interrupted render left it: this one begins anew, --resume would go on")
        return nothing
    if not file.exists():
        warn(f"--resume: there is no {file}: drawn from the start")
        return nothing
    with refusing():
        found = read_partial(file)
    again = "give what it was drawn with, or leave --resume out"
    differs = difference(found.facts, facts)
    if differs:
        raise UsageError(f"{file}: drawn with {differs}: {again}")
    if found.first != first or found.end > end:
        raise UsageError(f"{file}: holds samples {found.first}:{found.end}, not some of {first}:{end}: {again}")
    if found.facts.get(MACHINE) != facts[MACHINE]:
        warn(f"{file}: drawn on another processor: the picture is right to 1e-6, not to the bit")
    return found


def _hash_of(scene: Scene) -> str:
    leaves, structure = jax.tree.flatten(scene)
    digest = hashlib.sha256(str(structure).encode())
    for leaf in leaves:
        digest.update(f"{leaf.shape} {leaf.dtype}".encode())
        digest.update(np.ascontiguousarray(leaf).tobytes())
    return digest.hexdigest()


def _processor(device: jax.Device) -> str:
    """Return the kind of device; of a CPU also a hash of its features and XLA's flags, by which it compiles."""
    if device.platform != "cpu":
        return device.device_kind
    features = cpu_features() + os.environ.get("XLA_FLAGS", "")
    return f"{platform.machine()} {hashlib.sha256(features.encode()).hexdigest()[:16]}"
