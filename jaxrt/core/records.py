"""The records that flow along a path. Vectors are (3,): one ray, one point; `transport/film.py` makes many of them."""

from jax import Array

from jaxrt.core.maths import face_forward
from jaxrt.core.pytree import pytree


@pytree
class Ray:
    """A half line."""

    origin: Array  # (3,) scene units
    direction: Array  # (3,) unit vector


@pytree
class Hit:
    """What a ray hits first: discrete facts only, never differentiated."""

    index: Array  # () int32, primitive number: spheres, then sphere lights, then triangles; 0 where nothing is hit
    valid: Array  # () bool, False where nothing is hit


@pytree
class Smooth:
    """What a smooth mesh adds to a surface point, whose `position` is then lifted off the flat face."""

    normal: Array  # (3,) unit shading normal, outward; it sees where the ray came from, as the geometric one does
    facet: Array  # (3,) place on the face, from which rays through the surface leave
    side: Array  # () 1 where the ray came from outside, −1 from inside


@pytree
class Chart:
    """Where a point is on its surface, for textures; parts that the scene's textures do not ask for are None."""

    uv: Array | None = None  # (2,)
    vertices: Array | None = None  # (3,) int32 rows of `meshes.vertices` of the face
    shares: Array | None = None  # (3,) barycentric coordinates


@pytree
class SurfacePoint:
    """A point on a surface, with all that shading needs."""

    position: Array  # (3,)
    normal: Array  # (3,) unit geometric normal; outward for spheres, by winding for triangles
    error: Array  # () bound on the distance from `position` to the true surface, in scene units
    material: Array  # () int32 row of the scene's materials; rows past the last one are sphere lights
    smooth: Smooth | None = None  # None in scenes without smooth meshes
    chart: Chart | None = None  # None in scenes without textures
    travelled: Array | None = None  # () length of the ray that found it; None in scenes without absorption

    @property
    def shading(self) -> Array:
        """Unit normal (3,) by which light is scattered."""
        return self.normal if self.smooth is None else self.smooth.normal

    def facing(self, wo: Array) -> Array:
        """Return the normal (3,) by which light is scattered, on the side that `wo` points to."""
        return face_forward(self.shading, wo)


@pytree
class LightSample:
    """One light, seen from a point."""

    direction: Array  # (3,) unit, from the point to the light
    distance: Array  # () to the light's surface, less the rounding bound of its far end
    irradiance: Array  # (3,) perpendicular irradiance W·m⁻² that the sample stands for, divided by its probability
    light: Array  # () int32 number of the light
