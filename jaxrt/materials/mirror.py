"""Perfect mirror, two-sided."""

from jax import Array

from jaxrt.core.maths import reflect
from jaxrt.core.records import SurfacePoint
from jaxrt.description.fields import Albedo
from jaxrt.description.kinds import material


@material
class Mirror:
    """A perfect mirror."""

    albedo: Albedo = (1.0, 1.0, 1.0)  # share of each channel that is reflected

    is_delta = True

    def sample(self, surface: SurfacePoint, wo: Array, u: tuple[Array, Array]) -> tuple[Array, Array]:
        """Return (direction, weight) of the one direction a mirror has."""
        return reflect(wo, surface.shading), self.albedo
