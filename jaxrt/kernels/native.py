"""Run a function of (operands, packet index) for many packets as ONE native CPU kernel.

XLA's CPU backend dispatches each operation as a kernel of its own and streams every intermediate through memory. A
call tagged as small is compiled whole instead: the loop over packets, and all loops inside, become one LLVM function
whose intermediates stay in the first-level cache. Other backends ignore the tag.

This file knows nothing of rendering.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager
from contextvars import ContextVar
from functools import cache, partial
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.extend.core import ClosedJaxpr
from jax.sharding import Mesh, NamedSharding, PartitionSpec, get_abstract_mesh, use_abstract_mesh

from jaxrt.kernels.stages import stage, stages, tagged

LARGE = 100_000  # numbers: a leaf of more is not worth copying to join it with others

Operands = TypeVar("Operands")
Result = TypeVar("Result")


@jax.custom_jvp
def as_operand(tree: Operands) -> Operands:
    """Return the tree as if it were an argument of the program, though it is a constant of it.

    XLA computes whatever depends on constants alone while it compiles, with an interpreter: for the tables of a mesh
    that takes longer than to compile everything else.
    """
    kept: Operands = lax.optimization_barrier(tree)
    return kept


@partial(as_operand.defjvp, symbolic_zeros=True)
def _as_operand_jvp(primals: tuple[Any], tangents: tuple[Any]) -> tuple[Any, Any]:
    return as_operand(*primals), tangents[0]


def map_packets(
    f: Callable[[Operands, Array], Result], operands: Operands, packets: Array, native: bool = True
) -> Result:
    """Return `f(operands, packet)` for each of `packets`, stacked along a new leading axis, from one native loop.

    packets: (n,) int32. `f` may loop, branch and gather; scatter, sort and custom calls have no native form on a CPU
    and make compilation fail. Must be called under `jax.jit`, where the tag is kept. native: False leaves the tags out,
    for packets of many lanes: a CPU would split their operations over threads, which a native kernel cannot.
    """
    return _call(lambda operands, packets: lax.map(partial(f, operands), packets), operands, packets, native)


def map_together(f: Callable[[Operands, Array], Result], operands: Operands, packets: Array, together: int) -> Result:
    """Return what `map_packets` does, of at most so many packets at the same time: for accelerators.

    All turns are of one size, the last filled up: f would be compiled once more for what is left to it.
    """
    n = packets.shape[0]
    turns = -(-n // together)
    size = -(-n // turns)
    filled = jnp.pad(packets, (0, turns * size - n), mode="edge")
    results = _call(
        lambda operands, packets: lax.map(partial(f, operands), packets, batch_size=size), operands, filled, False
    )
    return jax.tree.map(lambda x: x[:n], results)


def fold_packets(
    f: Callable[[Operands, Array, Result], Result],
    operands: Operands,
    start: Result,
    packets: Array,
    native: bool = True,
) -> Result:
    """Return what `start` has become after total = f(operands, packet, total) for each of `packets` in turn.

    One native loop, as for `map_packets`.
    """

    def fold(operands: tuple[Operands, Result], packets: Array) -> Result:
        rest, start = operands
        return lax.scan(lambda total, packet: (f(rest, packet, total), None), start, packets)[0]

    return _call(fold, (operands, start), packets, native)


def _call(loop: Callable[[Operands, Array], Result], operands: Operands, packets: Array, native: bool) -> Result:
    """Return loop(operands, packets), compiled as one native kernel."""
    parcels, unpack = _pack(operands)

    def unpacked(parcels: dict[str, Array], packets: Array) -> tuple[Result, Array]:
        inside = _kernel.set(native)
        try:
            with one_mesh():
                result = loop(unpack(parcels), packets)
        finally:
            _kernel.reset(inside)
        return result, jnp.stack([a[0].astype(jnp.float32) for a in (*parcels.values(), packets)])

    # A tagged call with an operand that turns out unused aborts the process (jaxlib 0.10.1: "All or none of the slices
    # should have an explicit index"). So all go in as a few arrays, behind a barrier that keeps constants out of the
    # call, and a number of each comes out again.
    call = tagged(unpacked) if native else unpacked
    return lax.optimization_barrier(call(lax.optimization_barrier(parcels), packets))[0]


def on_devices(
    f: Callable[[Operands, Array], Result], operands: Operands, count: int, devices: tuple[jax.Device, ...]
) -> Result:
    """Return f(operands, packets (1, share)) of each device, whose results have a leading axis of 1, side by side.

    Packets 0 … count − 1 are dealt like cards: neighbours cost alike, so every device gets its share of the dear ones.
    Their number is rounded up to the same for each device.
    """
    n = len(devices)
    share = -(-count // n)
    packets = jnp.arange(share * n, dtype=jnp.int32).reshape(share, n).T
    return f(operands, packets) if n == 1 else _spread(f, devices)(operands, packets)


def want_wide(devices: tuple[jax.Device, ...]) -> bool:
    """Return whether devices want many lanes at once, as all but CPUs do."""
    return devices[0].platform != "cpu"


@cache
def program_on(devices: tuple[jax.Device, ...]) -> ClosedJaxpr:
    """Return a program that does nothing on these devices; one alone is where the arguments are."""
    nothing = (lambda _, packets: packets) if len(devices) == 1 else _spread(lambda _, packets: packets, devices)
    return jax.make_jaxpr(nothing)(0, jnp.zeros(len(devices)))


def default_devices() -> tuple[jax.Device, ...]:
    """Return all devices of JAX's default backend, or the one that `jax.default_device` names.

    Inside of `shard_map` and `pmap`, which have spread the work already, one: it stands for each.
    """
    chosen = jax.config.values["jax_default_device"]
    if get_abstract_mesh().manual_axes:
        return tuple(jax.devices()[:1])
    if isinstance(chosen, jax.Device):
        return (chosen,)
    return tuple(jax.devices(chosen))


def everywhere(tree: Operands, devices: tuple[jax.Device, ...]) -> Operands:
    """Return the tree with its arrays on each of the devices.

    The results of a program on several are on each of them: going in again, they need no other program.
    """
    where = devices[0] if len(devices) == 1 else NamedSharding(_mesh(devices), PartitionSpec())
    return jax.device_put(jax.tree.map(_own_copy, tree), where)


def _own_copy(x: Any) -> Any:
    """Return this host's copy of an array that lies on the devices of several."""
    shared = isinstance(x, jax.Array) and not isinstance(x, jax.core.Tracer) and not x.is_fully_addressable
    return x.addressable_data(0) if shared and x.is_fully_replicated else x


def local(tree: Operands) -> Operands:
    """Return the tree as one device sees it inside of `shard_map` and `pmap`, where what lies on many is no operand."""
    if not get_abstract_mesh().manual_axes:
        return tree
    if any(jax.typeof(leaf).manual_axis_type.varying for leaf in jax.tree.leaves(tree)):
        raise ValueError("render: loops start from constants, which shard_map takes for an error: pass check_vma=False")
    spread = jax.tree.map(lambda x: isinstance(x, jax.Array) and not isinstance(x, jax.core.Tracer), tree)
    return jax.tree.map(lambda x, is_spread: jnp.asarray(np.asarray(x)) if is_spread else x, tree, spread)


def _mesh(devices: tuple[jax.Device, ...]) -> Mesh:
    return Mesh(devices, ("packets",))


def _spread(
    f: Callable[[Operands, Array], Result], devices: tuple[jax.Device, ...]
) -> Callable[[Operands, Array], Result]:
    """Return f for each device's row of its second argument."""
    spread, everywhere = PartitionSpec("packets"), PartitionSpec()
    # Unchecked: the check wants every loop's start value marked as differing between devices
    return jax.shard_map(f, mesh=_mesh(devices), in_specs=(everywhere, spread), out_specs=spread, check_vma=False)


def one_mesh() -> AbstractContextManager[None]:
    """Return the context in which what has been traced once is found again.

    JAX keeps traces by mesh, and takes no mesh and an empty one for two: derivatives are traced with the latter.
    """
    return use_abstract_mesh(get_abstract_mesh())


def once(f: Callable[..., Result]) -> Callable[..., Result]:
    """Return f as a stage of a native kernel: its results are computed once and kept, however many uses they have.

    Outside `map_packets` it does nothing.
    """
    return lambda *operands: (stage(f) if in_native() else f)(*operands)


def in_stages(f: Callable[..., Result]) -> Callable[..., Result]:
    """Return f as `once` does, in as many stages as its length asks for: kinds are as long as their authors like."""
    return lambda *operands: (stages(f) if in_native() else f)(*operands)


def kernel() -> bool | None:
    """Return whether the kernel that is being traced is native; None where none is."""
    return _kernel.get()


def in_native() -> bool:
    """Return whether a native kernel is being traced."""
    return kernel() is True


def in_wide() -> bool:
    """Return whether a kernel for packets of many lanes is being traced, one operation of all lanes after another."""
    return kernel() is False


_kernel: ContextVar[bool | None] = ContextVar("_kernel", default=None)  # whether what is being traced is native


def _pack(tree: Operands) -> tuple[dict[str, Array], Callable[[dict[str, Array]], Operands]]:
    """Return the leaves in a few flat arrays, and the function that takes them apart again.

    One for each part of the tree and each dtype: a batch over one part, as of tangents, leaves the others as they are.
    A large leaf has one of its own, an empty one none.
    """
    paths, structure = jax.tree.flatten_with_path(tree)
    leaves = [leaf for _, leaf in paths]
    kinds = [f"{path if leaf.size > LARGE else path[:1]} {leaf.dtype}" for path, leaf in paths]
    groups: dict[str, list[Any]] = {}
    for kind, leaf in zip(kinds, leaves, strict=True):
        if leaf.size:
            groups.setdefault(kind, []).append(leaf)
    parcels = {kind: jnp.concatenate([leaf.ravel() for leaf in group]) for kind, group in groups.items()}
    shapes = [(kind, leaf.shape, leaf.size, leaf.dtype) for kind, leaf in zip(kinds, leaves, strict=True)]

    def unpack(parcels: dict[str, Array]) -> Operands:
        start = dict.fromkeys(parcels, 0)
        parts = []
        for kind, shape, size, dtype in shapes:
            if not size:
                parts.append(jnp.zeros(shape, dtype))
                continue
            parts.append(lax.slice(parcels[kind], (start[kind],), (start[kind] + size,)).reshape(shape))
            start[kind] += size
        return jax.tree.unflatten(structure, parts)

    return parcels, unpack
