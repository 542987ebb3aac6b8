"""The outlines that the camera sees: where the picture itself changes abruptly.

A unit of clearance of the camera's ray exchanges the radiance inside an outline for that outside.
"""

from dataclasses import replace
from functools import partial

import jax.numpy as jnp
from jax import Array

from jaxrt.boundary.anchors import occluder_anchors
from jaxrt.boundary.clearance import EdgeSamples, ViewRays, beside
from jaxrt.boundary.guiding import Draw, place
from jaxrt.boundary.outlines.across import Glance
from jaxrt.boundary.shadows import Plan
from jaxrt.boundary.silhouettes import Afar, Eye, Silhouettes, angular_lengths, rim_at
from jaxrt.boundary.trail import through_lens
from jaxrt.cameras import View, projection
from jaxrt.core.maths import dot, safe_divide, safe_sqrt
from jaxrt.kernels.native import once
from jaxrt.transport.path import Tables


def seen_weights(tables: Tables, outlines: Silhouettes, bins: int, geometry_moves: bool) -> Array:
    """Return the angles (rows · bins,) that the camera sees outlines span: all of them, or those of lights alone."""
    camera, nothing = tables.camera, jnp.zeros((), tables.dtype)
    reach = nothing if camera.lens is None else camera.radius
    weights = angular_lengths(outlines, _eye(camera), reach, True, bins)
    if geometry_moves:
        return weights
    return jnp.where(jnp.arange(weights.shape[0]) >= tables.first_light * bins, weights, 0)


def _eye(camera: View) -> Eye:
    if camera.heading is None:
        return camera.position
    nothing = jnp.zeros_like(camera.heading[0])
    across = camera.start((nothing + camera.width, nothing + camera.height)) - camera.start((nothing, nothing))
    return Afar(camera.heading, safe_sqrt(dot(across, across)))


def seen_by_camera(
    plan: Plan, tables: Tables, outlines: Silhouettes, bins: int, draw: Draw
) -> tuple[Glance, EdgeSamples]:
    """Return the camera's look past an outline, and the samples of a change by 1 across it."""
    tables = through_lens(tables, draw.stream)
    camera = tables.camera
    placed = once(place)(draw)
    row = placed.bin // bins
    t = ((placed.bin % bins).astype(placed.t.dtype) + placed.t) / bins
    rim = once(partial(rim_at, creases=True))(outlines, row, t, _eye(camera))
    view = once(projection)(camera, rim.point)
    eye = camera.eye(rim.point)
    if camera.heading is not None:
        rim = replace(rim, distance=dot(rim.point - eye, camera.heading))
    density = placed.density * bins * draw.total
    seen = rim.valid & view.inside & (density > 0)
    spread = safe_divide(rim.jacobian * view.density, rim.distance * rim.distance * density)
    pixel = jnp.where(seen, view.pixel, camera.width * camera.height)
    occluder = occluder_anchors(outlines, plan.geometry_moves, row, t, rim)
    facing = jnp.where(seen, rim.normal, 0)
    rays = None
    if plan.geometry_moves:
        rays = ViewRays(view.image, facing, jnp.where(seen, view.depth, 0) * facing, camera.lens)
    seen_at = beside(view.image[None], plan.filter)
    absorption = jnp.zeros_like(eye) if tables.materials.absorb else None
    # What is not seen has no first event
    first = jnp.where(seen, 1, plan.max_depth + 2)
    glance = Glance(eye, row, rim, jnp.ones((), bool), absorption, draw.stream, first)
    return glance, EdgeSamples(
        pixel[None], jnp.where(seen, spread, 0)[None, None], None, rays, (occluder,), place=seen_at
    )
