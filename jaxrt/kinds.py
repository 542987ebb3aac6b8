"""What kinds of one's own are made of: decorators, fields, records, directions. See docs/own-kinds.md."""

from jaxrt.core.maths import dot, face_forward, normalize, reflect, safe_divide, safe_sqrt
from jaxrt.core.records import Ray, SurfacePoint
from jaxrt.core.sampling import (
    around,
    pdf_cosine_hemisphere,
    pdf_uniform_sphere,
    sample_cosine_hemisphere,
    sample_uniform_sphere,
)
from jaxrt.description.fields import (
    Absorption,
    Albedo,
    Angle,
    Direction,
    Flag,
    Fraction,
    Ior,
    LightRadius,
    Place,
    Positive,
    Radius,
    Real,
    Rgb,
    Turn,
    Turns,
    Up,
)
from jaxrt.description.kinds import camera, light, material
from jaxrt.description.values import Measure, require

__all__ = [
    "Absorption",
    "Albedo",
    "Angle",
    "Direction",
    "Flag",
    "Fraction",
    "Ior",
    "LightRadius",
    "Measure",
    "Place",
    "Positive",
    "Radius",
    "Ray",
    "Real",
    "Rgb",
    "SurfacePoint",
    "Turn",
    "Turns",
    "Up",
    "around",
    "camera",
    "dot",
    "face_forward",
    "light",
    "material",
    "normalize",
    "pdf_cosine_hemisphere",
    "pdf_uniform_sphere",
    "reflect",
    "require",
    "safe_divide",
    "safe_sqrt",
    "sample_cosine_hemisphere",
    "sample_uniform_sphere",
]
