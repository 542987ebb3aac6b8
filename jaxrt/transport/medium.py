"""What light goes through, air or tinted glass: where a path comes to a surface, and where a light stands."""

import jax.numpy as jnp
from jax import Array, lax

from jaxrt.core.maths import dot, normalize
from jaxrt.core.pytree import pytree
from jaxrt.core.records import Ray, SurfacePoint
from jaxrt.lights import Lights, casters_of
from jaxrt.materials import Materials, absorption_of
from jaxrt.shapes import Geometry, find, leave, surface_point

WALLS = 8  # surfaces on one way, the lamp's own among them, behind which that of what it is in may be


@pytree
class Medium:
    """What light goes through on both sides of a surface that a path comes to."""

    absorption: Array  # (3,) per unit of length, of what the ray went through so far as is known
    point: SurfacePoint
    wo: Array  # (3,)
    inside: Array  # (3,) the surface's own
    clear: Array  # () bool, light passes through the surface

    def passed(self) -> Array:
        """Return the share of light (3,) left where the ray arrives, but for what `scatter` leaves of it."""
        assert self.point.travelled is not None
        return jnp.exp(-self.absorption * jnp.where(self._is_from_inside, 0, self.point.travelled))

    def beyond(self, direction: Array) -> Array:
        """Return the absorption (3,) of what a ray goes through that leaves the surface: none outside of glass."""
        side = dot(self.point.shading, direction)
        crosses = self.clear & (side * dot(self.point.shading, self.wo) < 0)
        return jnp.where(crosses, jnp.where(side < 0, self.inside, 0), self.here)

    @property
    def here(self) -> Array:
        """The absorption (3,) of what the ray went through."""
        return jnp.where(self._is_from_inside, self.inside, self.absorption)

    @property
    def _is_from_inside(self) -> Array:
        return self.clear & (dot(self.point.shading, self.wo) < 0)


def medium_at(materials: Materials, absorption: Array, point: SurfacePoint, wo: Array) -> Medium:
    """Return what is on both sides of a surface. absorption, wo: as of `Medium`."""
    return Medium(absorption, point, wo, *absorption_of(materials, point))


def around_lights(geometry: Geometry, materials: Materials, lights: Lights) -> Array | None:
    """Return the absorption (lights, 3) of what each light that has a place is in; None where nothing absorbs."""
    if not materials.absorb:
        return None

    def around(place: Array) -> Array:
        """Return that of the first clear surface on some way out, if it is met from inside."""

        def further(_: int, state: tuple[Ray, Array, Array]) -> tuple[Ray, Array, Array]:
            ray, found, absorption = state
            hit = find(geometry, ray)
            point = surface_point(geometry, ray, hit)
            inside, clear = absorption_of(materials, point)
            first = hit.valid & clear & ~found
            leaves = dot(point.shading, ray.direction) > 0
            onward, done = leave(point, ray.direction), found | first | ~hit.valid
            return onward, done, jnp.where(first & leaves, inside, absorption)

        up = normalize(jnp.asarray([0.3, 0.8, 0.5], place.dtype))
        nothing = jnp.zeros((), bool), jnp.zeros_like(place)
        return lax.fori_loop(0, WALLS, further, (Ray(place, up), *nothing))[2]

    return lax.map(around, casters_of(lights)[0])
