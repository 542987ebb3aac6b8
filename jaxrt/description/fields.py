"""What the fields of kinds may be: numbers with a range, which the scene file, `fit` and `gradcheck` keep to.

In a class, `albedo: Albedo = (1, 1, 1)` says what stands in the scene file. Where the class's methods run, the field is
an array: (3,) here, () for a single number. `Annotated[Positive, require(lambda x: x < 500, "is …: use …")]` narrows a
range; `Annotated[Vector, Measure("fixed", "xyz", "[0, 1, 0]")]` makes a field that is no parameter.
"""

from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import numpy as np
from pydantic import AfterValidator, BeforeValidator

from jaxrt.description import values
from jaxrt.description.values import (
    BRIGHTEST,
    LONGEST,
    TOO_BRIGHT,
    Measure,
    Number,
    Size,
    complaint,
    number,
    plain,
    require,
    show,
)


def _grey(value: Any) -> Any:
    """Return three values of a list, or one number for each channel."""
    value = plain(value)
    if isinstance(value, list | tuple):
        return value
    grey = number(value)
    if grey < 0:
        raise complaint(f"{show(value)} is negative: light cannot be, use 0 or more")
    if grey > BRIGHTEST:
        raise complaint(f"{show(value)} {TOO_BRIGHT}")
    return (grey, grey, grey)


def _not_opaque(value: tuple[float, ...]) -> tuple[float, ...]:
    if max(value) > LONGEST:
        raise complaint(f"{show(value)} leaves nothing of any light: use 1e15 or less, or the type conductor")
    return value


def _flag(value: Any) -> Any:
    if not isinstance(value, bool):
        raise complaint(f"{show(plain(value))} is neither true nor false: write one of these, without quotes")
    return value


def _not_zero(value: tuple[float, ...]) -> tuple[float, ...]:
    if not np.any(np.asarray(value, np.float32)):
        raise complaint(f"{show(value)} is zero: use a direction such as [0, 1, 0]")
    return value


if TYPE_CHECKING:  # arrays to those who compute with them, numbers and tuples to those who write defaults
    Albedo: TypeAlias = Any
    Absorption: TypeAlias = Any
    Angle: TypeAlias = Any
    Coefficient: TypeAlias = Any
    Direction: TypeAlias = Any
    Fraction: TypeAlias = Any
    Flag: TypeAlias = Any
    FullAngle: TypeAlias = Any
    Ior: TypeAlias = Any
    LightRadius: TypeAlias = Any
    Place: TypeAlias = Any
    Positive: TypeAlias = Any
    Radius: TypeAlias = Any
    Real: TypeAlias = Any
    Rgb: TypeAlias = Any
    Turn: TypeAlias = Any
    Turns: TypeAlias = Any
    Up: TypeAlias = Any
else:
    # Colours: share of each channel that is reflected; light of each channel, one number for grey
    Albedo = Annotated[values.Albedo, Measure("fraction", "rgb", "[0.8, 0.8, 0.8]", tints=True)]
    Rgb = Annotated[values.Rgb, BeforeValidator(_grey), Measure("positive", "rgb", "[1, 1, 1]", tints=True)]
    # Of light that goes through, per unit of length: so much that nothing is left over the shortest
    Absorption = Annotated[
        values.Rgb,
        AfterValidator(_not_opaque),
        BeforeValidator(_grey),
        Measure("positive", "rgb", "[0.1, 0.5, 1]", tints=True),
    ]
    # Yes or no: a number that is no parameter
    Flag = Annotated[bool, BeforeValidator(_flag), Measure("fixed", "", "true")]
    # Single numbers
    Fraction = Annotated[
        Number,
        require(lambda x: 0 <= x <= 1, "is outside [0, 1]: choose a share within"),
        Measure("fraction", "", "0.5"),
    ]
    Positive = Annotated[
        Size, require(lambda x: x > 0, "is not > 0: use a positive number"), Measure("positive", "", "1")
    ]
    Real = Annotated[Number, Measure("free", "", "0")]
    Ior = Annotated[values.Ior, Measure("positive", "", "1.5", step=0.02)]
    Radius = Annotated[values.Radius, Measure("positive", "", "10")]
    LightRadius = Annotated[values.LightRadius, Measure("positive", "", "1")]  # 0 for a point
    Angle = Annotated[values.Fov, Measure("angle", "", "60")]  # degrees, between 0 and 180
    Turn = Annotated[Number, Measure("free", "", "0", step=0.5)]  # degrees, any number
    Coefficient = Annotated[Number, Measure("free", "", "0", step=0.01)]  # of a lens's distortion
    FullAngle = Annotated[
        Size,
        require(lambda x: 0 < x <= 360, "is not between 0 and 360: choose degrees, such as 180"),
        Measure("positive", "", "180"),
    ]
    # Three numbers
    Place = Annotated[values.Vector, Measure("place", "xyz", "[0, 0, 0]")]  # moves with the scene's origin
    Direction = Annotated[values.Vector, AfterValidator(_not_zero), Measure("free", "xyz", "[0, 1, 0]")]
    Up = Annotated[values.Vector, Measure("fixed", "xyz", "[0, 1, 0]")]  # a direction that is no parameter
    Turns = Annotated[values.Vector, Measure("free", "xyz", "[0, 0, 0]", step=0.5)]  # axis times degrees
