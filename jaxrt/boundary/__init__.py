"""The derivative that moving visibility edges carry.

Pixels are integrals over what is visible, and the derivative of an integral over a moving region has a part that comes
from its boundary: automatic differentiation of the samples inside misses it. Here it is the sum over sampled edge
points of a weight times the derivative of the clearance (`clearance.py`); the value of a picture is not touched.
"""

from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from jaxrt.boundary.caustics import caustic_edges
from jaxrt.boundary.clearance import EdgeSamples, clearance_of, splat
from jaxrt.boundary.lines import line_edges
from jaxrt.boundary.outlines import outline_edges
from jaxrt.boundary.shadows import Plan, shadow_edges
from jaxrt.boundary.trail import with_trails
from jaxrt.cameras import Padded
from jaxrt.filters import Filter
from jaxrt.kernels.native import as_operand
from jaxrt.kernels.sealed import sealed
from jaxrt.scene import Scene
from jaxrt.transport.outputs import channels
from jaxrt.transport.path import tables_of

__all__ = ["EdgeSamples", "Plan", "clearance_of", "edge_tangent", "sample_edges", "splat"]


@partial(jax.jit, static_argnames="plan")
def sample_edges(scene: Scene, seed: Array, plan: Plan) -> tuple[EdgeSamples, ...]:
    """Return samples of all edges that move. seed: () uint32."""
    scene = _one_by_one(_with_margin(as_operand(scene), plan.filter))
    samplers = [shadow_edges, outline_edges, line_edges, caustic_edges]
    if plan.outputs:
        samplers = [outline_edges, line_edges]
    groups = [samples for sampler in samplers for samples in sampler(scene, seed, plan)]
    return tuple(with_trails(tables_of(scene), groups, plan.geometry_moves, plan.devices))


def _one_by_one(scene: Scene) -> Scene:
    """Return the scene whose trees have no packets: rays at edges go all ways, and this compiles faster."""

    def alone(shapes: Any) -> Any:
        if shapes is None or shapes.bvh is None:
            return shapes
        return replace(shapes, bvh=replace(shapes.bvh, packets=False))

    return replace(scene, spheres=alone(scene.spheres), triangles=alone(scene.triangles))


def edge_tangent(scene: Scene, tangent: Any, seed: Array, plan: Plan) -> Array:
    """Return the change (height, width, channels) of the picture by moving edges, linear in the scene's tangent.

    tangent: as `jax.jvp` wants it, float0 for integers. Works under jit, vmap over tangents (which share the samples)
    and transposition; there is no second derivative.
    """
    samples = sealed(partial(sample_edges, plan=plan), scene, seed)
    return _picture_change(scene, tangent, samples, channels(plan.outputs), plan.filter)


@partial(jax.jit, static_argnums=(3, 4))
def _picture_change(
    scene: Scene, tangent: Any, groups: tuple[EdgeSamples, ...], numbers: int, filter: Filter | None
) -> Array:
    """Return what the samples' clearances change in the picture, of so many numbers a pixel."""
    scene, size = as_operand(scene), (scene.camera.width, scene.camera.height)
    total = jnp.zeros((size[1], size[0], numbers), scene.dtype)
    for samples in groups:

        def clearance(scene: Scene, samples: EdgeSamples = samples) -> Array:
            return clearance_of(_with_margin(scene, filter), samples)

        _, change = jax.jvp(clearance, (scene,), (tangent,))
        total += splat(samples, change, size, filter)
    return total


def _with_margin(scene: Scene, filter: Filter | None) -> Scene:
    """Return the scene whose camera sees beyond its borders what a filter sees there."""
    return scene if filter is None else replace(scene, camera=Padded(scene.camera, filter.margin))
