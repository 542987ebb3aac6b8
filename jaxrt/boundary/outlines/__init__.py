"""The outlines that the camera sees, and those that surfaces see by the rays they scatter.

A sample is a look past an outline, and what a change of the light across it does to the picture. How much changes is
followed from there on in one kernel for both kinds: the code that follows paths is dear to compile.
"""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
from jax import Array

from jaxrt.boundary.clearance import EdgeSamples
from jaxrt.boundary.guiding import Draw, Part, sample_together
from jaxrt.boundary.lookouts import Lookouts
from jaxrt.boundary.outlines.across import Glance, both_sides, change_across
from jaxrt.boundary.outlines.bounced import TILES, events_seen, lookouts_of, seen_by_surfaces
from jaxrt.boundary.outlines.camera import seen_by_camera, seen_weights
from jaxrt.boundary.shadows import Plan
from jaxrt.boundary.silhouettes import Silhouettes, bins_for, edge_table
from jaxrt.cameras import edges_known
from jaxrt.core.pytree import pytree
from jaxrt.scene import Scene
from jaxrt.transport.outputs import what_is_met
from jaxrt.transport.path import Tables, tables_of

__all__ = ["bounced_edges", "both_sides", "camera_edges", "outline_edges"]

LIGHTS_ONLY = 16  # the outlines of lights alone get this part of the samples: they are few and smooth
SHARE = 3  # surfaces get one of so many boundary samples: each costs as much as several others


@pytree
class OutlineTables:
    """What samples of outlines are drawn from."""

    tables: Tables
    outlines: Silhouettes
    lookouts: Lookouts | None


def camera_edges(scene: Scene, seed: Array, plan: Plan) -> tuple[EdgeSamples, ...]:
    """Return samples of the outlines that the camera sees move: all of them, or those of sphere lights alone."""
    return outline_edges(scene, seed, plan, surfaces=False)


def bounced_edges(scene: Scene, seed: Array, plan: Plan) -> tuple[EdgeSamples, ...]:
    """Return samples of moving outlines that surfaces see: all of them, or those of sphere lights alone."""
    return outline_edges(scene, seed, plan, camera=False)


def outline_edges(
    scene: Scene, seed: Array, plan: Plan, camera: bool = True, surfaces: bool = True
) -> tuple[EdgeSamples, ...]:
    """Return the samples of `camera_edges`, then those of `bounced_edges`.

    None where they are not known of the camera: an outline is that of an eye, however far away.
    """
    lights = scene.lights is not None and scene.lights.have_size
    events = events_seen(scene, plan) if surfaces and not plan.outputs else 0
    if not edges_known(scene.camera) or not (lights or plan.geometry_moves) or not (camera or events):
        return ()
    tables = tables_of(scene)
    edges = edge_table(scene.triangles) if scene.triangles is not None and plan.geometry_moves else None
    outlines = Silhouettes(tables.geometry.spheres, edges)
    if outlines.rows == 0:
        return ()
    parts, lookouts = [], None
    crossed = partial(_crossed, tables.camera.width * tables.camera.height)
    if camera:
        bins = bins_for(outlines.rows)

        def by_camera(operands: OutlineTables, draw: Draw) -> tuple[Glance, EdgeSamples]:
            return seen_by_camera(plan, operands.tables, operands.outlines, bins, draw)

        weights = seen_weights(tables, outlines, bins, plan.geometry_moves)
        parts.append(Part(by_camera, crossed, weights, plan.part(1, LIGHTS_ONLY), seed ^ jnp.uint32(1)))
    if events:
        lookouts = lookouts_of(plan, tables, outlines, seed, events)

        def by_surfaces(operands: OutlineTables, draw: Draw) -> tuple[Glance, EdgeSamples]:
            assert operands.lookouts is not None
            return seen_by_surfaces(plan, events, operands.tables, operands.outlines, operands.lookouts, draw)

        weights = jnp.ones(events * TILES * TILES, tables.dtype)
        parts.append(Part(by_surfaces, crossed, weights, plan.part(SHARE, LIGHTS_ONLY), seed ^ jnp.uint32(2)))
    operands = OutlineTables(tables, outlines, lookouts)
    return tuple(sample_together(parts, operands, partial(_changed, plan), plan.devices))


def _changed(plan: Plan, operands: OutlineTables, glance: Glance) -> tuple[Array, Array]:
    """Return how much more radiance, or of the outputs, there is just outside an outline, and whether it shows."""
    tables, outlines = operands.tables, operands.outlines
    if not plan.outputs:
        return change_across(tables, outlines, glance, plan.max_depth)
    starts, clear = both_sides(tables, outlines, glance.row, glance.rim, glance.eye)
    both = jax.vmap(partial(what_is_met, plan.outputs, tables))(*starts)
    return both[0] - both[1], clear


def _crossed(nowhere: int, samples: EdgeSamples, found: tuple[Array, Array]) -> tuple[EdgeSamples, Array]:
    """Return samples of a change by 1 with what has changed, and how much that is. nowhere: pixel of what is hidden."""
    change, clear = found
    weight = jnp.where(clear & (samples.weight != 0), samples.weight * change[None], 0)
    pixel = jnp.where(clear, samples.pixel, nowhere)
    return replace(samples, pixel=pixel, weight=weight), jnp.sum(jnp.abs(weight))
