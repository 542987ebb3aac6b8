"""Levenberg-Marquardt on the difference of two pictures, one step at a time.

One compiled program serves all: the steps, whatever their samples per pixel and seed, and the evaluation of the answer.
It draws the picture and its Jacobian once a step and hands optimistix the linear model of them.
"""

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from numpy.typing import ArrayLike, NDArray

from jaxrt import boundary
from jaxrt.boundary.tangent import moving_edges
from jaxrt.cameras import edges_known
from jaxrt.fit.targets import RADIANCE, FitError, joined, scale_of
from jaxrt.fit.unknowns import Unknowns
from jaxrt.fit.verdict import promised_gain
from jaxrt.fit.views import draw_views
from jaxrt.kernels.jacobian import value_and_jacobian
from jaxrt.render import draw_sum, prepare
from jaxrt.scene import Scene
from jaxrt.scene.measures import bends_light, moves_lamps, moves_shapes
from jaxrt.transport.outputs import Output
from jaxrt.views import Asked, answers

Floats = NDArray[np.float64]
Vector = NDArray[np.floating]
Arguments = tuple[Any, Any, Any, Any, Any, Any]  # of a problem, seed, spp, rounds, filters, what is held

EDGES_PER_PIXEL = 4  # in one round
MOST_ROUNDS = 16  # of edge samples, where noise hides what moving edges change
GAIN = 30.0  # the solver's unit of residuals, for its first damping, 1, to be 1/900 of the target's sum of squares


SHORTER = 1 / 16  # step size after a rejected step, of the one before
TINY = 1e-30  # loss that is none
ROUND = np.uint32(0x9E3779B9)  # between the seeds of rounds


class Look(NamedTuple):
    """What a step of the solver has shown."""

    vector: Vector  # (k,) the best so far
    loss: float  # there
    accepted: bool  # whether the step led there
    promise: float  # share of the loss that the next step should gain; after an accepted step, one without damping
    step_size: float  # of the next step


@dataclass(frozen=True)
class Problem:
    """A scene with unknowns, and the picture that it should give."""

    scene: Scene
    unknowns: Unknowns
    target: Array  # (height, width, channels) linear radiance, or all outputs
    weight: Array  # of its shape: 1, or 0 where the target is not to be trusted
    max_depth: int | None = None
    sampler: str = "sobol"
    boundary_samples: int | None = None  # of each view; None: 4 a pixel where edges move that are known
    cameras: tuple[Any, ...] = ()  # of several views, the scene's own first; their targets stand one below the other
    outputs: Asked = RADIANCE  # that the target shows
    smooth: Floats | None = None  # (n, k) from the vector to what is to be small besides, in the units of `scale`

    @property
    def views(self) -> tuple[Any, ...]:
        """The cameras whose pictures stand one below the other."""
        return self.cameras or (self.scene.camera,)

    @property
    def edges(self) -> int:
        """Return the number of edge samples of all views."""
        return sum(self.edges_of(camera) for camera in self.views)

    def edges_of(self, camera: Any) -> int:
        """Return the number of edge samples of a camera's picture."""
        if self.boundary_samples is not None:
            return self.boundary_samples
        names = [row.selector.name for row in self.unknowns.rows]
        materials = self.scene.materials
        moving = any(moves_lamps(name) or moves_shapes(name) or bends_light(materials, name) for name in names)
        known = moving and edges_known(camera)
        return EDGES_PER_PIXEL * camera.width * camera.height if known else 0

    @property
    def blurs(self) -> bool:
        """Return whether outlines move, which overlap in blurred pictures long before they do in sharp ones."""
        return any(moves_shapes(row.selector.name) for row in self.unknowns.rows)

    @property
    def scale(self) -> Floats:
        """Return the units (1, 1, channels) of residuals, in which the target's own size is 1."""
        return scale_of(self.target, self.weight, self.outputs)

    def with_smooth(self, residual: Floats, jacobian: Floats, vector: Vector) -> tuple[Floats, Floats]:
        """Return a picture's residual (n,) and Jacobian (n, k) at a vector, followed by what is to be small besides."""
        residual, jacobian = residual.ravel(), jacobian.reshape(-1, jacobian.shape[-1])
        if self.smooth is None:
            return residual, jacobian
        return np.concatenate([residual, np.dot(self.smooth, vector)]), np.concatenate([jacobian, self.smooth])

    def roughness(self, vector: Vector) -> float:
        """Return the sum of squares at a vector of what is to be small besides the picture's residual."""
        return 0.0 if self.smooth is None else float(np.sum(np.dot(self.smooth, vector) ** 2))


class Drawing(NamedTuple):
    """How the pictures of a step are drawn."""

    spp: int
    blur: float = 0.0  # where the problem `blurs`: standard deviation, as a share of the picture's shorter side
    rounds: int = 1  # of edge samples
    turning: bool = True  # whether things turn whose places are sought too


class Machine:
    """The compiled program of a problem."""

    def __init__(self, problem: Problem) -> None:
        """Trace the solver once; the program itself is compiled by the first step."""
        import equinox
        import optimistix

        self.problem = problem
        self.start = problem.unknowns.vector(problem.scene)
        self._constants = _constants(problem)
        residual = partial(_linear_model, problem)
        solver: Any = optimistix.LevenbergMarquardt(rtol=0.0, atol=0.0)
        search: Any = optimistix.ClassicalTrustRegion(low_constant=SHORTER)
        solver = equinox.tree_at(lambda solver: solver.search, solver, search)
        arguments, nothing = self._arguments(0, Drawing(1)), frozenset[object]()
        outputs = jax.eval_shape(residual, self.start, arguments)
        fresh = solver.init(residual, self.start, arguments, {}, *outputs, nothing)
        arrays, program = equinox.partition(fresh, equinox.is_array)
        # Arrays of the host have neither device nor weak type, so that all steps share one compiled program
        self._fresh = jax.tree.map(np.asarray, arrays)

        @jax.jit
        def step(y: Array, arguments: Any, arrays: Any) -> Any:
            y, state, _ = solver.step(residual, y, arguments, {}, equinox.combine(arrays, program), nothing)
            return y, equinox.filter(state, equinox.is_array)

        self._step = step

    def again(self, scene: Scene | None = None, target: ArrayLike | None = None) -> "Machine":
        """Return a machine of the same program for another scene of the same structure, another target, or both."""
        other, old = copy(self), self.problem
        picture = old.target if target is None else jnp.asarray(target)
        other.problem = problem = replace(old, scene=old.scene if scene is None else scene, target=picture)
        other.start = problem.unknowns.vector(problem.scene)
        other._constants = _constants(problem)
        return other

    def _arguments(self, seed: int, how: Drawing) -> Arguments:
        blurs = _filters(self.problem, how.blur, self.start.dtype) if self.problem.blurs else None
        turns = self.problem.unknowns.turns_of_placed
        held = turns & (not how.turning) if turns.any() else None
        return self._constants, np.uint32(seed), np.int32(how.spp), np.int32(how.rounds), blurs, held

    def _from(self, vector: Vector, seed: int, how: Drawing, step_size: float | None) -> Iterator[tuple[Vector, Any]]:
        """Yield the best vector and the solver's state after each step, the first of which only looks at `vector`."""
        y, fresh = np.asarray(vector, self.start.dtype), self._fresh
        size = fresh.search_state.step_size if step_size is None else np.asarray(step_size, self.start.dtype)
        search = fresh.search_state.__class__(step_size=size)
        state = fresh.__class__(**(vars(fresh) | {"y_eval": y, "search_state": search}))
        while True:
            y, state = jax.tree.map(np.asarray, self._step(y, self._arguments(seed, how), state))
            yield y, state

    def steps(self, vector: Vector, seed: int, how: Drawing, step_size: float | None = None) -> Iterator[Look]:
        """Yield what each step shows, from `vector` on, for ever; the first only looks at `vector`.

        step_size: None is the solver's own. Raises FitError where a picture is not finite: comparisons with NaN would
        reject every step, and look converged.
        """
        count = 0
        for y, state in self._from(vector, seed, how, step_size):
            if not np.isfinite(state.y_eval).all():
                raise FitError(f"fit: no finite step from {self.problem.unknowns.values(y)}: check scene and target")
            accepted, count = int(state.num_accepted_steps) > count, int(state.num_accepted_steps)
            residual, jacobian = (x.astype(float) / GAIN for x in state.aux)
            residual, jacobian = self.problem.with_smooth(residual, jacobian, y)
            loss = float(np.sum(residual**2))
            promise = promised_gain(residual, jacobian, None if accepted else state.y_eval - y) / max(loss, TINY)
            yield Look(y, loss, accepted, promise, float(state.search_state.step_size))

    def rounds_at(self, vector: Vector, seed: int, how: Drawing) -> int:
        """Return how many rounds of edge samples make the Jacobian's noise no larger than what it tells.

        Where it is larger, its square is mostly noise: steps are too short, and standard errors too small.
        """
        if self.problem.edges == 0:
            return 1
        pair = [self.evaluate(vector, (seed + k) % 2**32, how)[1].reshape(-1, self.start.size) for k in (0, 5)]
        told = np.sum(pair[0] * pair[1], axis=0)
        size = np.sum(pair[0] ** 2 + pair[1] ** 2, axis=0) / 2
        noise = (size - told)[size > 0] / np.maximum(told, size / (1 + MOST_ROUNDS))[size > 0]
        return int(np.ceil(np.clip(noise.max(initial=1), 1, MOST_ROUNDS)))

    def evaluate(self, vector: Vector, seed: int, how: Drawing) -> tuple[Floats, Floats]:
        """Return residual (height, width, channels) and Jacobian (…, channels, k) at `vector`, drawn anew.

        Raises FitError where they are not finite.
        """
        _, state = next(self._from(vector, seed, how, None))
        residual, jacobian = (x.astype(float) / GAIN for x in state.aux)
        if not (np.isfinite(residual).all() and np.isfinite(jacobian).all()):
            where = self.problem.unknowns.values(vector)
            raise FitError(f"fit: picture or derivative is not finite at {where}: check scene and target")
        shape = self.problem.target.shape
        return residual.reshape(shape), jacobian.reshape(*shape, -1)

    def evaluate_all(self, vector: Vector, seed: int, how: Drawing) -> tuple[Floats, Floats]:
        """Return residual (n,) and Jacobian (n, k) as `evaluate` does, followed by what is to be small besides."""
        return self.problem.with_smooth(*self.evaluate(vector, seed, how), vector)


def _constants(problem: Problem) -> tuple[Any, ...]:
    """Return what a problem's program is given of it; all else of the problem is part of the program."""
    weight = problem.weight * jnp.asarray(GAIN / problem.scale, problem.weight.dtype)
    smooth = None if problem.smooth is None else jnp.asarray(GAIN * problem.smooth, weight.dtype)
    return problem.scene, problem.cameras, problem.target, weight, smooth


def _linear_model(problem: Problem, vector: Array, arguments: Arguments) -> tuple[Array, tuple[Array, Array]]:
    """Return the residual (n,) as a function of `vector`, linear around it, and (residual, Jacobian)."""
    (scene, cameras, target, weight, smooth), seed, spp, rounds, filters, held = arguments
    here = lax.stop_gradient(vector)

    def residual(vector: Array) -> Array:
        free = vector if held is None else jnp.where(held, here, vector)

        def draw(view: Scene, seed: Array) -> Array:
            moved, edges = problem.unknowns.apply(view, free), problem.edges_of(view.camera)

            def shown(outputs: tuple[Output, ...]) -> Array:
                return picture_of(moved, seed, spp, problem.max_depth, problem.sampler, edges, rounds, outputs)

            wanted = problem.outputs
            light = shown(()) if wanted.light else None
            others = shown(tuple(wanted.outputs.values())) if wanted.outputs else None
            return joined(answers(moved, wanted, light, others, None))

        picture = draw_views(draw, scene, cameras, seed) if cameras else draw(scene, seed)
        return _blurred((picture - target) * weight, filters).ravel()

    value, jacobian = value_and_jacobian(residual, here)
    model = value + jnp.matmul(jacobian, vector - here, precision=lax.Precision.HIGHEST)
    if smooth is not None:
        model = jnp.concatenate([model, jnp.matmul(smooth, vector, precision=lax.Precision.HIGHEST)])
    return model, (value, jacobian)


def _filters(problem: Problem, blur: float, dtype: Any) -> tuple[Vector, Vector]:
    """Return the matrices that blur the picture along columns, each view by itself, and along rows."""
    height, width, _ = problem.target.shape
    down, first = np.zeros((height, height), dtype), 0
    pixels = [blur * min(camera.height, camera.width) for camera in problem.views]
    for camera, spread in zip(problem.views, pixels, strict=True):
        own = slice(first, first + camera.height)
        down[own, own] = _gaussian(camera.height, spread, dtype)
        first += camera.height
    return down, _gaussian(width, max(pixels), dtype)


def _gaussian(size: int, width: float, dtype: Any) -> Vector:
    """Return the matrix (size, size) that blurs along one axis; its rows add up to 1."""
    if width <= 0:
        return np.eye(size, dtype=dtype)
    steps = np.arange(size)[:, None] - np.arange(size)
    weights = np.exp(-0.5 * (steps / width) ** 2)
    return (weights / weights.sum(axis=1, keepdims=True)).astype(dtype)


def _blurred(picture: Array, filters: tuple[Array, Array] | None) -> Array:
    """Return the picture (height, width, c), blurred by matrices for both axes, or as it is."""
    if filters is None:
        return picture
    rows, columns = filters
    down = jnp.einsum("ij,jkc->ikc", rows, picture, precision=lax.Precision.HIGHEST)
    return jnp.einsum("ij,kjc->kic", columns, down, precision=lax.Precision.HIGHEST)


def picture_of(
    scene: Scene,
    seed: Array,
    spp: Array,
    max_depth: int | None,
    sampler: str,
    edges: int,
    rounds: Array,
    outputs: tuple[Output, ...] = (),
) -> Array:
    """Return what `jaxrt.render` returns, with a seed and counts that may change without compiling again."""
    plain, run, plan = prepare(scene, seed, 0, spp, spp, max_depth=max_depth, sampler=sampler, outputs=outputs)
    total = draw_sum(plain, run, plan)
    picture = total / spp.astype(total.dtype)
    if edges == 0:
        return picture
    budget = boundary.Plan(edges, plan.max_depth, False, False, plan.devices, outputs, filter=plan.filter)

    def more(number: Array, sum_of: Array) -> Array:
        # Far from the seeds that a fit takes one by one
        return sum_of + moving_edges(plain, run.seed + number.astype(jnp.uint32) * ROUND, budget)

    return picture + lax.fori_loop(0, rounds, more, jnp.zeros_like(picture)) / rounds.astype(picture.dtype)
