"""The radiance along one camera ray: a walk of `max_depth` scattering events, with light samples.

Mirrors and glass, which reflect in single directions, get none. At surfaces that are neither that nor lambertian, light
samples and scattered rays share in finding sphere lights (Veach 1997, §9.2); code for these is there if they are.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array, lax
from jax.ad_checkpoint import checkpoint_name

from jaxrt.cameras import View, view_of
from jaxrt.core.maths import FAR, dot, face_forward, safe_divide
from jaxrt.core.pytree import dtype_of, pytree, static
from jaxrt.core.records import Hit, LightSample, Ray, SurfacePoint
from jaxrt.kernels.few import where_needed
from jaxrt.kernels.native import in_stages, once
from jaxrt.lights import (
    LightTable,
    emitted_radiance,
    light_table,
    sample_light,
    sample_light_attached,
    shines_from_afar,
    sky_radiance,
)
from jaxrt.lights.density import light_density
from jaxrt.materials import Materials, Scattering, evaluate, scatter, with_marks
from jaxrt.scene import Scene
from jaxrt.shapes import (
    Geometry,
    Spheres,
    find,
    geometry_of,
    leave,
    occluded,
    surface_point,
    with_more,
    without_more,
)
from jaxrt.transport.medium import Medium, medium_at

_KEPT = "kept"  # name of what derivatives backwards keep of an event
Numbers = Callable[[int | Array], tuple[Array, Array, Array, Array]]  # decision block -> four numbers in [0, 1)


@pytree
class Tables:
    """The scene as the kernel reads it: derived once per render, differentiable in the scene."""

    camera: View
    geometry: Geometry  # spheres, then sphere lights, then triangles
    occluders: Geometry  # what blocks shadow rays: a scene's only light cannot block its own
    materials: Materials
    lights: LightTable | None
    environment: Array | None  # (3,)
    first_light: int = static()  # sphere row of the first sphere light
    sparse: bool = static(default=False)  # glossy surfaces cost nothing where there are none; no derivative backwards

    @property
    def dtype(self) -> Any:
        """The dtype of all numbers along the path."""
        return dtype_of(self)


@pytree
class Walk:
    """A path under way."""

    ray: Ray
    throughput: Array  # (3,)
    radiance: Array  # (3,) gathered so far
    specular: Array  # () bool: the ray comes from the camera, a mirror or glass, so that it may see sphere lights
    pdf: Array | None = None  # () of its direction where light samples have a share, else 0; None without glossy
    alive: Array | None = None  # () bool, whether it has not ended; None where that spares no search
    absorption: Array | None = None  # (3,) per unit of length, of what its ray goes through; None where nothing absorbs


def tables_of(scene: Scene, lights_move: bool = False) -> Tables:
    """Return the tables of a scene. lights_move: with derivatives of where rays meet sphere lights."""
    lights = scene.lights
    alone = lights is not None and lights.count == 1
    geometry = geometry_of(_with_light_spheres(scene, lights_move), scene.triangles, scene.materials.absorb)
    first_light = 0 if scene.spheres is None else scene.spheres.radius.shape[0]
    return Tables(
        camera=view_of(scene.camera),
        geometry=geometry,
        occluders=lax.stop_gradient(_first_spheres(geometry, first_light) if alone else geometry),
        materials=scene.materials,
        lights=None if lights is None else light_table(lights),
        environment=scene.environment,
        first_light=first_light,
    )


def _first_spheres(geometry: Geometry, n: int) -> Geometry:
    """Return the geometry with the first n of its spheres, and all else."""
    spheres = without_more(geometry.spheres, n) if n and geometry.spheres is not None else None
    return Geometry(spheres, geometry.triangles)


def _with_light_spheres(scene: Scene, lights_move: bool) -> Spheres | None:
    """Return the spheres followed by the sphere lights, whose material rows follow those of the materials.

    The lights carry no derivative for light: where a ray meets one does not matter, for it shines alike everywhere.
    """
    lights, spheres = scene.lights if lights_move else lax.stop_gradient(scene.lights), scene.spheres
    if lights is None or lights.radius is None:
        return spheres
    rows = sum(scene.materials.counts) + jnp.arange(lights.radius.shape[0], dtype=jnp.int32)
    if spheres is None:
        return Spheres(lights.position, lights.radius, jnp.zeros_like(lights.radius), rows)
    return with_more(spheres, lights.position, lights.radius, rows)


def radiance(
    tables: Tables,
    ray: Ray,
    numbers: Numbers,
    max_depth: int,
    unroll: bool,
    attached: bool = False,
    marks: Array | None = None,
) -> Array:
    """Return the radiance (3,) that comes in along a camera ray, in W·sr⁻¹·m⁻².

    numbers: block k gives the four numbers of event k (light pair, direction pair); block 0 belongs to the camera.
    unroll: all events in a row, or one event in a scan: the same numbers, another program.
    attached: draw light samples whose derivatives in light, shapes and camera are right and of bounded variance.
    marks: (max_depth, slots, 15), by which textures record what each event reads of them.
    """
    walk = walk_along(tables, ray, True)
    if tables.geometry.spheres is None and tables.geometry.triangles is None:
        sky = walk.throughput * 0 if tables.environment is None else tables.environment
        return sky + sky_radiance(tables.lights, ray.direction) if shines_from_afar(tables.lights) else sky
    if unroll:
        for k in range(1, max_depth + 1):
            walk = next_event(marked(tables, None if marks is None else marks[k - 1]), walk, numbers(k), attached)
    else:
        # Of each event, derivatives backwards keep the walk, what was hit and two numbers, and compute the rest again
        @partial(jax.checkpoint, policy=jax.checkpoint_policies.save_only_these_names(_KEPT), prevent_cse=False)
        def event(walk: Walk, one: tuple[Array, Array | None]) -> tuple[Walk, None]:
            k, mark = one
            return next_event(marked(tables, mark), walk, numbers(k), attached), None

        walk, _ = lax.scan(event, walk, (jnp.arange(1, max_depth + 1), marks))
    return last_look(tables, walk)


def marked(tables: Tables, marks: Array | None) -> Tables:
    """Return the tables whose textures record what is read of them, where there are marks."""
    return tables if marks is None else replace(tables, materials=with_marks(tables.materials, marks))


def walk_along(tables: Tables, ray: Ray, specular: bool | Array) -> Walk:
    """Return a path that begins with a ray. specular: whether that may see sphere lights, as the camera's rays may."""
    ones = jnp.ones_like(ray.origin)
    pdf = jnp.zeros_like(ones[0]) if tables.materials.are_glossy else None
    alive = jnp.ones((), bool) if tables.geometry.has_tree or tables.sparse else None
    absorption = jnp.zeros_like(ones) if tables.materials.absorb else None
    return Walk(ray, ones, jnp.zeros_like(ones), jnp.full((), specular), pdf, alive, absorption)


def next_event(tables: Tables, walk: Walk, u: tuple[Array, Array, Array, Array], attached: bool) -> Walk:
    """Return the path one scattering event on; where it goes, lights have no part in. u: as of `event_at`."""
    hit = checkpoint_name(once(find)(tables.geometry, walk.ray, walk.alive), _KEPT)
    return event_at(tables, walk, hit, once(surface_point)(tables.geometry, walk.ray, hit), u, attached)


def event_at(
    tables: Tables, walk: Walk, hit: Hit, point: SurfacePoint, u: tuple[Array, ...], attached: bool = False
) -> Walk:
    """Return the path after its event at the point where its ray meets what it hits. u: four numbers in [0, 1)."""
    return depart(tables, arrive(tables, walk, hit, point), hit, point, u, attached)


def arrive(tables: Tables, walk: Walk, hit: Hit, point: SurfacePoint | None = None) -> Walk:
    """Return the walk with the light that its ray sees where it hits what it hits, and with what is left of its own.

    point: where that is; None: to be found where it matters.
    """
    if walk.absorption is not None:
        point = once(surface_point)(tables.geometry, walk.ray, hit) if point is None else point
        passed = _medium(tables, walk, point).passed()
        walk = replace(walk, throughput=walk.throughput * jnp.where(hit.valid, passed, 1))
    return _see(tables, walk, hit)


def _medium(tables: Tables, walk: Walk, point: SurfacePoint) -> Medium:
    assert walk.absorption is not None
    return medium_at(tables.materials, walk.absorption, point, -walk.ray.direction)


def depart(
    tables: Tables, walk: Walk, hit: Hit, point: SurfacePoint, u: tuple[Array, ...], attached: bool = False
) -> Walk:
    """Return the path gone on from the point where it has arrived, with the direct light there. u: as of `event_at`."""
    wo = -walk.ray.direction
    medium = None if walk.absorption is None else _medium(tables, walk, point)
    choice = checkpoint_name((u[2], u[3]), _KEPT)
    live = None if walk.alive is None or not tables.sparse else hit.valid & walk.alive
    scattering = in_stages(scatter)(tables.materials, point, wo, choice, live)
    gathered = walk.radiance
    # Sample direct light
    if tables.lights is not None and tables.materials.are_lit:
        lit = hit.valid & scattering.lit
        direct = _direct(tables, point, wo, scattering, walk.throughput, u[:2], attached, lit, medium)
        gathered = gathered + jnp.where(lit, direct, 0)
    # Go on
    throughput = jnp.where(hit.valid, walk.throughput * scattering.weight, 0)
    # Derivatives want light samples alone: where a scattered ray hits a light, its edges would move
    pdf = jnp.zeros_like(walk.throughput[0]) if scattering.pdf is not None and attached else scattering.pdf
    # A sphere light, whose material comes last, ends it as well as nothing does
    alive = None if walk.alive is None else hit.valid & (point.material < tables.materials.ends[2])
    absorption = None if medium is None else medium.beyond(scattering.direction)
    if tables.sparse and alive is not None:
        alive &= jnp.any(throughput != 0)
    ray = once(leave)(point, scattering.direction)
    return Walk(ray, throughput, gathered, scattering.specular, pdf, alive, absorption)


def _direct(
    tables: Tables,
    point: SurfacePoint,
    wo: Array,
    scattering: Scattering,
    throughput: Array,
    u: tuple[Array, ...],
    attached: bool,
    wanted: Array,
    medium: Medium | None,
) -> Array:
    """Return the light (3,) that one light sample brings to a point, and from there along the path.

    wanted: () bool; where not, nothing is looked for.
    """
    assert tables.lights is not None
    sample_one = sample_light_attached if attached else sample_light
    sample = in_stages(sample_one)(tables.lights, point.position, (u[0], u[1]))
    cosine = dot(face_forward(point.shading, wo), sample.direction)
    faced, glossy = cosine > 0, cosine
    if scattering.glossy is not None:
        glossy = in_stages(partial(_glossy, attached))(tables, point, wo, sample, wanted if tables.sparse else None)
        faced = jnp.where(scattering.glossy, jnp.any(glossy > 0), faced)
    crowd = tables.lights.pick is not None and tables.lights.lights.have_size
    skip = tables.first_light + sample.light if crowd else None
    # The ray starts up to `error` nearer to the light than the point
    reach = jnp.where(wanted & faced, sample.distance - point.error, 0)
    blocked = occluded(tables.occluders, once(leave)(point, sample.direction), reach, skip)
    direct: Any = None
    if scattering.albedo is not None:
        incoming = jnp.where(blocked | (cosine <= 0), 0, sample.irradiance * (cosine / jnp.pi))
        direct = throughput * scattering.albedo * incoming
    if scattering.glossy is not None:
        shiny = throughput * jnp.where(blocked, 0, sample.irradiance * glossy)
        direct = shiny if direct is None else jnp.where(scattering.glossy, shiny, direct)
    if medium is not None:
        direct = direct * jnp.exp(-medium.beyond(sample.direction) * jnp.minimum(sample.distance, FAR))
    return direct


def _glossy(
    attached: bool, tables: Tables, point: SurfacePoint, wo: Array, sample: LightSample, live: Array | None
) -> Array:
    """Return f cosθ (3,) of a light sample at a glossy surface, times its share in finding the light.

    live: as of `scatter`.

    Scattered rays find sphere lights and skies too. Both ways are weighed by their densities (Veach 1997, §9.2.2).
    """
    value, pdf = evaluate(tables.materials, point, wo, sample.direction, live)
    assert tables.lights is not None
    if attached or not (tables.lights.lights.have_size or shines_from_afar(tables.lights)):
        return value
    if live is not None:
        share = where_needed(_light_share, pdf > 0, tables.lights, sample.light, point.position, sample.direction, pdf)
        return value * share
    return value * _light_share(tables.lights, sample.light, point.position, sample.direction, pdf)


def _light_share(lights: LightTable, light: Array, point: Array, direction: Array, pdf: Array) -> Array:
    """Return the share () of light samples in finding a light. pdf: density of scattered rays in its direction."""
    density = light_density(lights, light, point, direction)
    return jnp.where(density > 0, safe_divide(density, density + pdf), 1)


def _ray_share(lights: LightTable, light: Array, point: Array, direction: Array, pdf: Array) -> Array:
    """Return the share () of scattered rays, of which one has found it."""
    return safe_divide(pdf, pdf + light_density(lights, light, point, direction))


def _see(tables: Tables, walk: Walk, hit: Hit) -> Walk:
    """Return the walk with the light added that its ray runs into: a sky, or a sphere light's outside."""
    seen = jnp.zeros_like(walk.radiance)
    if tables.environment is not None:
        seen = jnp.where(hit.valid, seen, tables.environment)
    if shines_from_afar(tables.lights):
        # After a diffuse event, light samples have counted it
        sky = in_stages(sky_radiance)(tables.lights, walk.ray.direction)
        seen = seen + jnp.where(~hit.valid & walk.specular, sky, 0)
        if walk.pdf is not None:
            sky = in_stages(sky_radiance)(tables.lights, walk.ray.direction, walk.pdf)
            seen = seen + jnp.where(~hit.valid & (walk.pdf > 0), sky, 0)
    if tables.lights is not None and tables.lights.lights.have_size:
        lights, light = tables.lights.lights, hit.index - tables.first_light
        hit_light = meets_light(tables, hit)
        shining = once(emitted_radiance)(lights, jnp.clip(light, 0, lights.position.shape[0] - 1), walk.ray.origin)
        seen = jnp.where(hit_light & walk.specular, shining, seen)
        if walk.pdf is not None:
            met, way = hit_light & (walk.pdf > 0), (walk.ray.origin, walk.ray.direction, walk.pdf)
            if tables.sparse:
                share = where_needed(_ray_share, met, tables.lights, light, *way)
            else:
                share = in_stages(_ray_share)(tables.lights, light, *way)
            seen = jnp.where(met, shining * share, seen)
    return replace(walk, radiance=walk.radiance + walk.throughput * seen)


def meets_light(tables: Tables, hit: Hit) -> Array:
    """Return whether a ray hits a sphere light, () bool."""
    if tables.lights is None or not tables.lights.lights.have_size:
        return jnp.zeros((), bool)
    light = hit.index - tables.first_light
    return hit.valid & (light >= 0) & (light < tables.lights.lights.position.shape[0])


def looks_at_last(tables: Tables) -> bool:
    """Return whether a path's last ray can see anything at all that shines."""
    spheres = tables.lights is not None and tables.lights.lights.have_size
    can_shine = spheres or shines_from_afar(tables.lights)
    sees = tables.materials.are_delta or tables.materials.are_glossy
    return tables.environment is not None or (can_shine and sees)


def may_look(tables: Tables, walk: Walk) -> Array:
    """Return whether the walk's last ray may see something that shines, () bool."""
    if tables.environment is not None or not looks_at_last(tables):
        return jnp.full((), tables.environment is not None)
    return walk.specular if walk.pdf is None else walk.specular | (walk.pdf > 0)


def last_look(tables: Tables, walk: Walk) -> Array:
    """Return the walk's radiance with what its last ray sees, where it can see anything at all."""
    if not looks_at_last(tables):
        return walk.radiance
    return arrive(tables, walk, once(find)(tables.geometry, walk.ray, walk.alive)).radiance
