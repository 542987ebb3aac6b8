"""The numbers, names and tables that descriptions are made of, and how they are refused."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    ValidationError,
    ValidationInfo,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic_core import PydanticCustomError

from jaxrt.core.messages import nearest, show

FLOAT32_MAX = float(np.finfo(np.float32).max)
FLOAT32_TINY = float(np.finfo(np.float32).tiny)
LONGEST = 1e15  # lengths are squared in float32, which ends at 3.4e38
SHORTEST = 1e-15  # and begins at 1.2e-38
BRIGHTEST = 1e30  # light is summed over lights, events and samples in float32, which ends at 3.4e38
BRIGHTEST_SURFACE = 1e35  # of a sphere light: so small a one is seen by few samples, if by any
TOO_BRIGHT = "is so bright that sums of light overflow float32: use 1e30 or less"
COUNT_MAX = 2**31 - 1  # sample numbers and pixels are int32

EXAMPLES = {
    "camera": "a table [camera] with position = [0, 0, 55]",
    "position": "position = [0, 0, 55]",
    "center": "center = [0, 0, 0]",
    "radius": "radius = 10",
    "material": 'material = "white"',
    "vertices": "vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]",
    "intensity": "intensity = 3000",
    "radiance": "radiance = [1, 1, 1]",
}


def complaint(text: str, *place: str | int) -> PydanticCustomError:
    """Return the error `text` at `place`, relative to the value being validated."""
    return PydanticCustomError("scene", "{text}", {"text": text, "place": place})


def told(error: ValidationError) -> tuple[str, tuple[str | int, ...]]:
    """Return the first of pydantic's errors in words, and its place."""
    first = error.errors(include_url=False)[0]
    context = first.get("ctx", {})
    text = context.get("text") or f"{show(first['input'])}: {first['msg']}"
    return text, (*first["loc"], *context.get("place", ()))


def plain(value: Any) -> Any:
    """Return arrays and array scalars as lists and numbers."""
    return value.tolist() if hasattr(value, "tolist") else value


def number(value: Any) -> float:
    """Return `value` as a number that float32 can hold; complain of anything else."""
    value = plain(value)
    if isinstance(value, bool) or not isinstance(value, int | float):
        hint = "write it without quotes" if isinstance(value, str) else "write a number"
        raise complaint(f"{show(value)} is not a number: {hint}")
    if not (math.isfinite(value) if isinstance(value, float) else True):
        raise complaint(f"{show(value)} is not finite: write a finite number")
    if abs(value) > FLOAT32_MAX:
        raise complaint(f"{show(value)} is too large for float32: stay within ±3.4e38")
    return float(value)


def count(value: Any) -> int:
    """Return `value` as a whole number from 1 to COUNT_MAX; complain of anything else."""
    value = plain(value)
    if isinstance(value, bool) or not isinstance(value, int):
        raise complaint(f"{show(value)} is not a whole number: write an integer >= 1")
    if not 1 <= value <= COUNT_MAX:
        raise complaint(f"{show(value)} is out of range: write an integer from 1 to {COUNT_MAX}")
    return value


def string(value: Any) -> str:
    """Return `value` as a name; complain of anything else."""
    if not isinstance(value, str):
        raise complaint(f"{show(value)} is not a name: write a string in quotes")
    return value


def three(value: Any) -> tuple[Any, ...]:
    """Return `value` as three values; complain of anything else."""
    value = plain(value)
    if not isinstance(value, list | tuple):
        raise complaint(f"{show(value)} is not a list: write three values in brackets")
    if len(value) != 3:
        raise complaint(f"{show(value)} has {len(value)} values: write 3")
    return tuple(value)


def two(value: Any) -> tuple[Any, ...]:
    """Return `value` as two values; complain of anything else."""
    value = plain(value)
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise complaint(f"{show(value)} is not a pair: write two values in brackets")
    return tuple(value)


def tables(value: Any, info: ValidationInfo) -> tuple[Any, ...]:
    """Return `value` as a tuple of tables; complain of a single one."""
    if isinstance(value, Mapping):
        raise complaint(f"a single table where many can be: write [[{info.field_name}]] with two brackets")
    if not isinstance(value, list | tuple):
        raise complaint(f"{show(value)} is not a list of tables: write [[{info.field_name}]]")
    return tuple(value)


def require(test: Callable[[np.float32], object], text: str) -> AfterValidator:
    """Return a validator that refuses numbers which, once in float32, fail `test`."""

    def check(value: float) -> float:
        if not test(np.float32(value)):
            raise complaint(f"{show(value)} {text}")
        return value

    return AfterValidator(check)


_not_too_long = require(lambda x: abs(x) <= LONGEST, "is too far out for float32: stay within ±1e15")
_not_too_short = require(lambda x: x == 0 or x >= SHORTEST, "is too small for float32: use 1e-15 or more")


def _not_lost(value: float) -> float:
    """Refuse numbers that are there, but for float32 are not."""
    if 0 < abs(value) < FLOAT32_TINY:
        raise complaint(f"{show(value)} is too small for float32: use 1e-15 or more")
    return value


Count = Annotated[int, BeforeValidator(count)]
Name = Annotated[str, BeforeValidator(string)]
Number = Annotated[float, BeforeValidator(number)]
Size = Annotated[Number, AfterValidator(_not_lost)]
Coordinate = Annotated[Number, _not_too_long]
Reflectance = Annotated[Number, require(lambda x: 0 <= x <= 1, "is outside [0, 1]: choose an albedo within")]
Power = Annotated[
    Number,
    require(lambda x: x >= 0, "is negative: light cannot be, use 0 or more"),
    require(lambda x: x <= BRIGHTEST, TOO_BRIGHT),
]
Radius = Annotated[Size, require(lambda x: x > 0, "is not > 0: use a positive radius"), _not_too_long, _not_too_short]
LightRadius = Annotated[
    Size, require(lambda x: x >= 0, "is negative: use 0 for a point light"), _not_too_long, _not_too_short
]
Ior = Annotated[Size, require(lambda x: x > 0, "is not > 0: glass has about 1.5")]
Fov = Annotated[Size, require(lambda x: 0 < x < 180, "is not between 0 and 180: choose degrees, such as 60")]
Vector = Annotated[tuple[Coordinate, Coordinate, Coordinate], BeforeValidator(three)]
Pair = Annotated[tuple[Coordinate, Coordinate], BeforeValidator(two)]
Albedo = Annotated[tuple[Reflectance, Reflectance, Reflectance], BeforeValidator(three)]
Rgb = Annotated[tuple[Power, Power, Power], BeforeValidator(three)]


@dataclass(frozen=True)
class Measure:
    """What a field of a kind measures; it stands among a type's annotations."""

    # How `fit` bounds it: "fraction", "positive", "angle", "place" (moves with the scene's origin), "shift", "turn" (a
    # rotation vector, in degrees) or "free"; "fixed": it is no parameter
    range: str
    axes: str  # "rgb", "xyz", or "" for a single number
    example: str  # as in a scene file
    tints: bool = False  # scales light and turns none: which paths are drawn does not depend on it
    step: float | None = None  # of finite differences, where 2 % of the value is not the right one

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of one value."""
        return (len(self.axes),) if self.axes else ()


def measure_of(metadata: Sequence[Any]) -> Measure | None:
    """Return the measure among a type's annotations, the outermost of several."""
    return next((each for each in reversed(metadata) if isinstance(each, Measure)), None)


def _example(name: str, field: FieldInfo) -> str:
    """Return how a key that is missing would stand in a scene file."""
    measure = measure_of(field.metadata)
    return f"{name} = {measure.example}" if measure and name not in EXAMPLES else EXAMPLES[name]


class Table(BaseModel):
    """A table of the scene file: known keys only, each required one present."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    @model_validator(mode="before")
    @classmethod
    def _check_keys(cls, value: Any) -> Any:
        if isinstance(value, BaseModel):
            return value
        if not isinstance(value, Mapping):
            raise complaint(f"{show(value)} is not a table: write keys and values")
        for key in value:
            if key not in cls.model_fields:
                raise complaint(
                    f"unknown key {show(key)}{nearest(key if isinstance(key, str) else show(key), cls.model_fields)}"
                )
        for name, field in cls.model_fields.items():
            if field.is_required() and name not in value:
                raise complaint(f"{show(name)} is missing: add {_example(name, field)}")
        return dict(value)
