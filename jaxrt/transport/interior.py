"""The sum of a picture's samples, with its derivative inside of visibility edges.

The derivative of each packet is taken inside the packet loop, forwards (a tangent kernel) or backwards (a cotangent
kernel), so that memory depends neither on the samples nor on the size of the picture. `linear` tells JAX that one is
the transpose of the other.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax
from jax.custom_batching import sequential_vmap as in_turn
from jax.custom_derivatives import SymbolicZero

from jaxrt.core.maths import Parts, add_exactly, kahan_add, rounded
from jaxrt.description.kinds import LIGHTS, MATERIALS
from jaxrt.kernels.linear import Leaves, Shapes, apply_linear
from jaxrt.kernels.native import one_mesh, program_on
from jaxrt.materials import marks_of
from jaxrt.textures.recording import WIDTH, add_marks
from jaxrt.transport.film import (
    BLOCK,
    Plan,
    Run,
    draw_packets,
    draw_share,
    is_native,
    kahan_add_all,
    packets_of,
    sample_packet,
    size_of,
    sum_packets,
)
from jaxrt.transport.path import Tables
from jaxrt.transport.regeneration import MOST, draw_paths, regenerates
from jaxrt.transport.shine import pull_light

# Derivatives of a batch that share one pass over the paths, forwards and backwards. Backwards the paths are the lesser
# part, and packets of a batch too wide for a native kernel
TOGETHER = (32, 1)
WIDE_TOGETHER = (4, 1)  # of packets of many lanes, whose numbers are in memory
LARGE = 100_000  # moved numbers from which on wide packets are the faster ones backwards: a mesh of 11,000 faces
LARGEST_TILE = (32, 32)  # pixels, as many as a native kernel takes


@partial(jax.custom_jvp, nondiff_argnums=(3,))
def draw(tables: Tables, run: Run, gradient_run: Run, plan: Plan) -> Array:
    """Return the sum (height, width, 3) of the samples of `run`; derivatives are drawn with those of `gradient_run`.

    Of a plan's outputs, if it has some, (height, width, channels). Derivatives hold the pixel's position, each light
    sample's place on its light and all discrete choices fixed; what moving visibility edges add is not in them.
    """
    with one_mesh():
        parts = _draw(tables, run, plan)
    return rounded((parts[..., 0], parts[..., 1], parts[..., 2]))


@partial(jax.jit, static_argnames="plan")
def sum_share(tables: Tables, run: Run, share: Array, plan: Plan) -> Array:
    """Return the sums of the samples of `run` in one share of the packets, without derivative.

    (turns, lanes, channels, 3): parts along the last axis. Sums of runs that part between blocks, joined, added
    exactly and rounded once, are `draw` of all their samples.
    """
    return draw_share(partial(_packet_sum, plan), (tables, run), share, size_of(tables, plan), plan)


@partial(jax.jit, static_argnums=2)
def _draw(tables: Tables, run: Run, plan: Plan) -> Array:
    def picture(tables: Tables, run: Run) -> Array:
        return draw_packets(partial(_packet_sum, plan), (tables, run), size_of(tables, plan), plan)

    # A batch of scenes one after the other: side by side they would make too wide a native kernel
    return (in_turn(picture) if is_native(plan) else picture)(tables, run)


@partial(draw.defjvp, symbolic_zeros=True)
def _draw_jvp(plan: Plan, primals: tuple[Tables, Run, Run], tangents: tuple[Any, Any, Any]) -> tuple[Array, Array]:
    tables, run, gradient_run = primals
    changes = jax.tree.leaves(tangents[0], is_leaf=lambda x: isinstance(x, SymbolicZero))
    moved = [i for i, change in enumerate(changes) if not isinstance(change, SymbolicZero)]
    constants, structure = jax.tree.flatten((tables, gradient_run))
    total = draw(tables, run, gradient_run, plan)
    parts = []
    own = _own(tables, plan)
    for numbers, attached in _parted(moved, own):
        shapes = tuple(jax.ShapeDtypeStruct(constants[i].shape, constants[i].dtype) for i in numbers)
        pair = _Derivative(plan, structure, size_of(tables, plan), shapes, tuple(numbers), own, attached)
        parts += apply_linear(pair, constants, [changes[i] for i in numbers], program_on(plan.devices))
    share = (run.end - run.first) / (gradient_run.end - gradient_run.first)
    return total, sum(parts[1:], parts[0]) * share.astype(total.dtype)


def _own(tables: Tables, plan: Plan) -> frozenset[int]:
    """Return the numbers of the leaves whose derivatives keep the picture's own light samples.

    Theirs is the derivative of the very picture that is drawn. All are such where every light is a point, and where
    what is drawn is no light.
    """
    points = plan.outputs or tables.lights is None or not tables.lights.lights.have_size
    paths = [[key.name for key in path if hasattr(key, "name")] for path, _ in jax.tree.leaves_with_path(tables)]
    return frozenset(i for i, path in enumerate(paths) if points or not _turns_light(path))


def _parted(moved: Sequence[int], own: frozenset[int]) -> Iterator[tuple[list[int], bool]]:
    """Yield the leaves that move by how light is sampled for their derivatives, and whether that is attached.

    What is asked beside a parameter so does not change its derivative.
    """
    for attached in (False, True):
        numbers = [i for i in moved if (i not in own) == attached]
        if numbers:
            yield numbers, attached


def _turns_light(path: list[str]) -> bool:
    """Return whether light paths or light samples depend on a leaf; others keep the picture's own light samples."""
    if path[0] == "materials":
        if path[1] == "textures":
            return False
        kind = MATERIALS.kinds[path[1]]
        return kind.cls.is_delta and not kind.measures[path[2]].tints
    known = LIGHTS.parameters.get(".".join([path[0], path[-1]]))
    return path[0] != "environment" and (known is None or not known.tints)


class _Sums(NamedTuple):
    """What packets add up to."""

    dense: list[Leaves]  # totals and compensations of whole leaves
    texels: Any  # (n, 6) those of texels, as `add_marks` has them, None where these do not move


class _Derivative(NamedTuple):
    """The derivative of the sum of samples in some leaves of (tables, run): a `linear.Pair`."""

    plan: Plan
    structure: Any  # of (tables, run)
    size: tuple[int, int]
    x: Shapes  # of the moved leaves
    moved: tuple[int, ...]  # their numbers
    own: frozenset[int]
    attached: bool

    @property
    def together(self) -> tuple[int, int]:
        return TOGETHER if is_native(self.plan) else WIDE_TOGETHER

    @property
    def y(self) -> Shapes:
        return (jax.ShapeDtypeStruct((self.size[1], self.size[0], self.plan.channels), self.x[0].dtype),)

    def parted(self, moved: Sequence[int]) -> "list[tuple[_Derivative, list[int]]]":
        if self.attached:
            return [(self, list(moved))]
        return [(self._replace(attached=attached), numbers) for numbers, attached in _parted(moved, self.own)]

    def forward(self, constants: Leaves, changes: Leaves) -> Leaves:
        return [draw_packets(self._tangent, (constants, changes), self.size, self.plan)]

    def transpose(self, constants: Leaves, picture: Leaves) -> Leaves:
        plan = _backwards(self.plan, self.x)
        shapes = dict(zip(self.moved, self.x, strict=True))
        nothing = [jnp.zeros(shapes[i].shape, shapes[i].dtype) for i in self._dense]
        texels = None if self.texels is None else shapes.get(self.texels)
        table = None if texels is None else jnp.zeros((texels.shape[0], 6), texels.dtype)
        operands, sums = (constants, packets_of(picture[0], plan)), _Sums([nothing, nothing], table)
        return sum_packets(partial(self._cotangent, plan), operands, sums, self._totals, self.size, plan)

    @property
    def texels(self) -> int | None:
        """The number of the leaf that holds all texels, None where there is none."""
        textures = self._numbered.materials.textures
        return None if textures is None else textures.texels

    def _lanes(
        self,
        plan: Plan,
        constants: Leaves,
        sample: Array,
        packet: Array,
        values: dict[int, Array],
        marks: Array | None = None,
    ) -> Array:
        """Return the packet's radiance, with new values of some leaves."""
        tables, run = self._with(constants, values)
        return sample_packet(plan, tables, run, sample, packet, self.attached, marks)

    def _with(self, constants: Leaves, values: dict[int, Array]) -> tuple[Tables, Run]:
        """Return (tables, run), with new values of some leaves."""
        leaves = list(constants)
        for i, value in values.items():
            leaves[i] = value
        tables, run = jax.tree.unflatten(self.structure, leaves)
        return tables, run

    def _tangent(self, operands: tuple[Leaves, Leaves], packet: Array) -> Array:
        constants, changes = operands
        values = {i: constants[i] for i in self.moved}
        moves = dict(zip(self.moved, changes, strict=True))
        run: Run = jax.tree.unflatten(self.structure, constants)[1]

        def add_sample(sample: Array, sums: tuple[Array, Array]) -> tuple[Array, Array]:
            one = partial(self._lanes, self.plan, constants, sample, packet)
            return kahan_add(*sums, jax.jvp(one, [values], [moves])[1])

        nothing = jnp.zeros((self.plan.lanes, self.plan.channels), changes[0].dtype)
        return lax.fori_loop(run.first, run.end, add_sample, (nothing, nothing))[0]

    def _cotangent(self, plan: Plan, operands: tuple[Leaves, Array], packet: Array, sums: _Sums) -> _Sums:
        """Return the sums with what a packet adds."""
        constants, weights = operands
        tables, run = jax.tree.unflatten(self.structure, constants)
        values, marks = {i: constants[i] for i in self._dense}, None
        if sums.texels is not None:
            lookups = 1 if plan.outputs else plan.max_depth
            marks = jnp.zeros((plan.lanes, *marks_of(tables.materials, lookups)), weights.dtype)

        def pull(sample: Array) -> tuple[dict[int, Array], Array | None]:
            if self._shine_alone:
                scene_with = partial(self._with, constants)
                return pull_light(plan, scene_with, values, sample, packet, weights[packet], self.attached), None
            return jax.vjp(partial(self._lanes, plan, constants, sample, packet), values, marks)[1](weights[packet])

        def add_sample(sample: Array, sums: _Sums) -> _Sums:
            changes, read = pull(sample)
            dense = kahan_add_all(sums.dense, [changes[i] for i in self._dense])
            return _Sums(dense, sums.texels if read is None else add_marks(sums.texels, read.reshape(-1, WIDTH)))

        nothing = [jnp.zeros_like(value) for value in values.values()]
        own = lax.fori_loop(run.first, run.end, add_sample, _Sums([nothing, nothing], sums.texels))
        return _Sums(kahan_add_all(sums.dense, own.dense[0]), own.texels)

    @property
    def _numbered(self) -> Any:
        """The tables with each leaf's number in its place."""
        return jax.tree.unflatten(self.structure, list(range(self.structure.num_leaves)))[0]

    @property
    def _shine_alone(self) -> bool:
        """Whether what moves changes the light of paths, and not where they go."""
        tables = self._numbered
        lit = jax.tree.leaves((tables.lights, tables.environment))
        walks = (tables.geometry.spheres, tables.geometry.triangles) != (None, None)
        return walks and not (self.plan.outputs or self.plan.unroll) and set(self.moved) <= set(lit)

    @property
    def _dense(self) -> list[int]:
        """The leaves of which each sample gives a derivative as a whole: all but texels, of which it reads few."""
        texels = self.texels
        return [i for i in self.moved if i != texels]

    def _totals(self, sums: _Sums) -> Leaves:
        totals = dict(zip(self._dense, sums.dense[0], strict=True))
        return [totals[i] if i in totals else sums.texels[:, :3] for i in self.moved]


def _backwards(plan: Plan, shapes: Shapes) -> Plan:
    """Return the plan by which derivatives in leaves of these shapes are drawn backwards.

    Each sample of a packet runs over the leaves as a whole, and each packet over texels, so that large ones want few.
    """
    large = sum(math.prod(leaf.shape) for leaf in shapes) > LARGE
    lanes = math.prod(LARGEST_TILE)
    tile = LARGEST_TILE if plan.tile[1] > 1 else (lanes, 1)
    return plan._replace(tile=tile) if large and plan.lanes < lanes else plan


def _packet_sum(plan: Plan, operands: tuple[Tables, Run], packet: Array) -> Array:
    """Return the sums of the packet's samples in parts (lanes, channels, 3): within blocks rounded, of blocks exact."""
    tables, run = operands
    # No derivative passes here
    tables = replace(tables, sparse=tables.materials.are_glossy and is_native(plan))
    nothing = jnp.zeros((plan.lanes, plan.channels), tables.dtype)

    def add_blocks(first: Array, end: Array, sample_of: Callable[[Array], Array], parts: Parts) -> Parts:
        def add_sample(sample: Array, sums: tuple[Array, Array]) -> tuple[Array, Array]:
            return kahan_add(*sums, sample_of(sample))

        def add_block(block: Array, parts: Parts) -> Parts:
            inside = jnp.maximum(block * BLOCK, first), jnp.minimum((block + 1) * BLOCK, end)
            return add_exactly(parts, lax.fori_loop(*inside, add_sample, (nothing, nothing))[0])

        return lax.fori_loop(first // BLOCK, -(-end // BLOCK), add_block, parts)

    def add_many(many: Array, parts: Parts) -> Parts:
        first, end = jnp.maximum(many * MOST, run.first), jnp.minimum((many + 1) * MOST, run.end)
        drawn = draw_paths(plan, tables, run, first, end, packet)
        return add_blocks(first, end, lambda sample: drawn[sample - first], parts)

    parts = nothing, nothing, nothing
    if regenerates(plan, tables):
        parts = lax.fori_loop(run.first // MOST, -(-run.end // MOST), add_many, parts)
    else:
        parts = add_blocks(run.first, run.end, lambda sample: sample_packet(plan, tables, run, sample, packet), parts)
    return jnp.stack(parts, -1)
