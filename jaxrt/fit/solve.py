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
from jaxrt.description import SceneError
from jaxrt.fit.unknowns import Unknowns
from jaxrt.fit.verdict import promised_gain
from jaxrt.fit.views import draw_views
from jaxrt.kernels.jacobian import value_and_jacobian
from jaxrt.render import draw_sum, prepare
from jaxrt.scene import Scene
from jaxrt.scene.measures import bends_light, moves_lamps, moves_shapes

Floats = NDArray[np.float64]
Vector = NDArray[np.floating]

EDGES_PER_PIXEL = 4
GAIN = 30.0  # the solver's unit of residuals, for its first damping, 1, to be 1/900 of the target's sum of squares


SHORTER = 1 / 16  # step size after a rejected step, of the one before
TINY = 1e-30  # loss that is none


class FitError(SceneError):
    """A fit that cannot go on: culprit, what, remedy."""


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
    target: Array  # (height, width, 3) linear radiance
    weight: Array  # (height, width, 3) 1, or 0 where the target is not to be trusted
    max_depth: int | None = None
    sampler: str = "sobol"
    boundary_samples: int | None = None  # of each view; None: 4 a pixel where edges move that are known
    cameras: tuple[Any, ...] = ()  # of several views, the scene's own first; their targets stand one below the other

    @property
    def edges(self) -> int:
        """Return the number of edge samples of all views."""
        return sum(self.edges_of(camera) for camera in self.cameras or (self.scene.camera,))

    def edges_of(self, camera: Any) -> int:
        """Return the number of edge samples of a camera's picture."""
        if self.boundary_samples is not None:
            return self.boundary_samples
        names = [row.selector.name for row in self.unknowns.rows]
        materials = self.scene.materials
        moving = any(moves_lamps(name) or moves_shapes(name) or bends_light(materials, name) for name in names)
        return EDGES_PER_PIXEL * camera.width * camera.height if moving and camera.is_central else 0

    @property
    def scale(self) -> float:
        """Return the root of the target's sum of squares, in whose units residuals are."""
        total = float(jnp.sum((self.target * self.weight) ** 2))
        if not np.isfinite(total):
            raise FitError("target: has pixels that are not finite: mask them, check scene and target")
        if not total > 0:
            raise FitError("target: black, or masked everywhere: choose another picture")
        return total**0.5


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
        arguments, nothing = self._arguments(0, 1), frozenset[object]()
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

    def _arguments(self, seed: int, spp: int) -> tuple[Any, Any, Any]:
        return self._constants, np.uint32(seed), np.int32(spp)

    def _from(self, vector: Vector, seed: int, spp: int, step_size: float | None) -> Iterator[tuple[Vector, Any]]:
        """Yield the best vector and the solver's state after each step, the first of which only looks at `vector`."""
        y, fresh = np.asarray(vector, self.start.dtype), self._fresh
        size = fresh.search_state.step_size if step_size is None else np.asarray(step_size, self.start.dtype)
        search = fresh.search_state.__class__(step_size=size)
        state = fresh.__class__(**(vars(fresh) | {"y_eval": y, "search_state": search}))
        while True:
            y, state = jax.tree.map(np.asarray, self._step(y, self._arguments(seed, spp), state))
            yield y, state

    def steps(self, vector: Vector, seed: int, spp: int, step_size: float | None = None) -> Iterator[Look]:
        """Yield what each step shows, from `vector` on, for ever; the first only looks at `vector`.

        step_size: None is the solver's own. Raises FitError where a picture is not finite: comparisons with NaN would
        reject every step, and look converged.
        """
        count = 0
        for y, state in self._from(vector, seed, spp, step_size):
            if not np.isfinite(state.y_eval).all():
                raise FitError(f"fit: no finite step from {self.problem.unknowns.values(y)}: check scene and target")
            accepted, count = int(state.num_accepted_steps) > count, int(state.num_accepted_steps)
            residual, jacobian = (x.astype(float) for x in state.aux)
            loss = float(np.sum(residual**2))
            promise = promised_gain(residual, jacobian, None if accepted else state.y_eval - y) / max(loss, TINY)
            yield Look(y, loss / GAIN**2, accepted, promise, float(state.search_state.step_size))

    def evaluate(self, vector: Vector, seed: int, spp: int) -> tuple[Floats, Floats]:
        """Return residual (height, width, 3) and Jacobian (height, width, 3, k) at `vector`, drawn anew.

        Raises FitError where they are not finite.
        """
        _, state = next(self._from(vector, seed, spp, None))
        residual, jacobian = (x.astype(float) / GAIN for x in state.aux)
        if not (np.isfinite(residual).all() and np.isfinite(jacobian).all()):
            where = self.problem.unknowns.values(vector)
            raise FitError(f"fit: picture or derivative is not finite at {where}: check scene and target")
        shape = self.problem.target.shape
        return residual.reshape(shape), jacobian.reshape(*shape, -1)


def _constants(problem: Problem) -> tuple[Any, ...]:
    """Return what a problem's program is given of it; all else of the problem is part of the program."""
    return problem.scene, problem.cameras, problem.target, problem.weight * (GAIN / problem.scale)


def _linear_model(
    problem: Problem, vector: Array, arguments: tuple[Any, Array, Array]
) -> tuple[Array, tuple[Array, Array]]:
    """Return the residual (n,) as a function of `vector`, linear around it, and (residual, Jacobian)."""
    (scene, cameras, target, weight), seed, spp = arguments

    def residual(vector: Array) -> Array:
        def draw(view: Scene, seed: Array) -> Array:
            moved, edges = problem.unknowns.apply(view, vector), problem.edges_of(view.camera)
            return picture_of(moved, seed, spp, problem.max_depth, problem.sampler, edges)

        picture = draw_views(draw, scene, cameras, seed) if cameras else draw(scene, seed)
        return ((picture - target) * weight).ravel()

    here = lax.stop_gradient(vector)
    value, jacobian = value_and_jacobian(residual, here)
    return value + jnp.matmul(jacobian, vector - here, precision=lax.Precision.HIGHEST), (value, jacobian)


def picture_of(scene: Scene, seed: Array, spp: Array, max_depth: int | None, sampler: str, edges: int) -> Array:
    """Return what `jaxrt.render` returns, with a seed and samples per pixel that may change without compiling again."""
    plain, run, plan = prepare(scene, seed, 0, spp, spp, max_depth=max_depth, sampler=sampler)
    total = draw_sum(plain, run, plan)
    picture = total / spp.astype(total.dtype)
    if edges == 0:
        return picture
    return picture + moving_edges(plain, run.seed, boundary.Plan(edges, plan.max_depth, False, False, plan.devices))
