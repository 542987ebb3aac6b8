"""Path tracing without light sampling: paths that find a spherical light only by chance.

Unbiased like `jaxrt.render`, at a far greater variance, and blind to point lights. The light that direct sampling finds
at event D is found here by the ray that leaves event D, so that pictures of one `max_depth` agree.
"""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxrt.core.maths import kahan_add
from jaxrt.core.records import Hit, Ray
from jaxrt.core.samplers import SAMPLERS, Stream
from jaxrt.kernels.native import once
from jaxrt.lights import emitted_radiance
from jaxrt.scene import Scene
from jaxrt.shapes import find, surface_point
from jaxrt.transport.film import Plan, Run, draw_packets
from jaxrt.transport.path import Numbers, Tables, Walk, event_at, tables_of


def _see(tables: Tables, walk: Walk, hit: Hit) -> Walk:
    """Return the walk with the light of a sphere light that its ray has met, whatever it comes from."""
    assert tables.lights is not None
    lights, light = tables.lights.lights, hit.index - tables.first_light
    n = lights.position.shape[0]
    shining = once(emitted_radiance)(lights, jnp.clip(light, 0, n - 1), walk.ray.origin)
    met = hit.valid & (light >= 0) & (light < n)
    return replace(walk, radiance=walk.radiance + jnp.where(met, walk.throughput * shining, 0))


def radiance_by_chance(tables: Tables, ray: Ray, numbers: Numbers, max_depth: int) -> Array:
    """Return the radiance (3,) along a camera ray; arguments as for `jaxrt.transport.path.radiance`."""
    unlit = replace(tables, lights=None)
    ones = jnp.ones_like(ray.origin)

    def event(walk: Walk, k: Array) -> tuple[Walk, None]:
        hit = once(find)(tables.geometry, walk.ray)
        walk = _see(tables, walk, hit)
        return event_at(unlit, walk, hit, once(surface_point)(tables.geometry, walk.ray, hit), numbers(k)), None

    walk = Walk(ray, ones, jnp.zeros_like(ones), jnp.ones((), bool))
    walk, _ = lax.scan(event, walk, jnp.arange(1, max_depth + 1))
    return _see(tables, walk, once(find)(tables.geometry, walk.ray)).radiance


def _sample(plan: Plan, tables: Tables, run: Run, sample: Array, x: Array, y: Array) -> Array:
    """Return the radiance (3,) of one sample of pixel (x, y)."""
    pixel = y.astype(jnp.uint32) * jnp.uint32(tables.camera.width) + x.astype(jnp.uint32)
    numbers = partial(SAMPLERS[plan.sampler], Stream(pixel, sample.astype(jnp.uint32), run.seed, run.spp.astype("u4")))
    jitter = numbers(0)
    ray = tables.camera.ray((x.astype(jnp.float32) + jitter[0], y.astype(jnp.float32) + jitter[1]), jitter[2:])
    return radiance_by_chance(tables, ray, numbers, plan.max_depth)


@partial(jax.jit, static_argnames="plan")
def draw_sum_by_chance(scene: Scene, run: Run, plan: Plan) -> Array:
    """Return the sum (H, W, 3) of the samples of `run`, as `jaxrt.render.draw_sum` does; float32 scenes only."""
    width, height = plan.tile
    columns = -(-scene.camera.width // width)

    def packet_sum(operands: tuple[Tables, Run], packet: Array) -> Array:
        tables, run = operands
        lane = jnp.arange(width * height, dtype=jnp.int32)
        x, y = packet % columns * width + lane % width, packet // columns * height + lane // width

        def add_sample(sample: Array, sums: tuple[Array, Array]) -> tuple[Array, Array]:
            return kahan_add(*sums, jax.vmap(partial(_sample, plan, tables, run, sample))(x, y))

        nothing = jnp.zeros((plan.lanes, 3))
        return lax.fori_loop(run.first, run.end, add_sample, (nothing, nothing))[0]

    return draw_packets(packet_sum, (tables_of(scene), run), (scene.camera.width, scene.camera.height), plan)
