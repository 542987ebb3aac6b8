"""Measured metals by name: complex indices of refraction in linear sRGB.

The spectra are those of Palik's Handbook of Optical Constants of Solids (1985) and of the collection at luxpop.com, as
Mitsuba 3 (Jakob et al. 2022) comes with them; the numbers are their projections by the CIE's 1931 colour matching.
"""

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel, model_validator

from jaxrt.core.messages import nearest, show
from jaxrt.description.values import Name, Table, complaint

METALS = {
    "aluminium": ([1.6575, 0.8804, 0.5212], [9.2238, 6.2695, 4.8370]),
    "beryllium": ([4.1850, 3.1850, 2.7841], [3.8355, 3.0101, 2.8690]),
    "chromium": ([4.3697, 2.9165, 1.6549], [5.2065, 4.2313, 3.7547]),
    "copper": ([0.2010, 0.9237, 1.1022], [3.9133, 2.4530, 2.1421]),
    "gold": ([0.1430, 0.3753, 1.4420], [3.9830, 2.3856, 1.6034]),
    "iridium": ([3.0863, 2.0822, 1.6179], [5.5922, 4.0671, 3.2673]),
    "mercury": ([2.3989, 1.4400, 0.9096], [6.3276, 4.3719, 3.4218]),
    "molybdenum": ([4.4840, 3.5251, 2.7763], [4.1114, 3.4208, 3.1506]),
    "nickel": ([2.3673, 1.6634, 1.4671], [4.4988, 3.0502, 2.3454]),
    "niobium": ([3.4201, 2.7901, 2.3956], [3.4414, 2.7377, 2.5797]),
    "rhodium": ([2.5858, 1.8602, 1.5543], [6.7823, 4.7030, 3.9761]),
    "silver": ([0.1553, 0.1167, 0.1384], [4.8284, 3.1222, 2.1469]),
    "tantalum": ([2.0627, 2.3929, 2.6279], [2.4084, 1.7415, 1.9470]),
    "titanium_nitride": ([1.6484, 1.1505, 1.3798], [3.3683, 1.9435, 1.1021]),
    "tungsten": ([4.3708, 3.3002, 2.9984], [3.5006, 2.6049, 2.2732]),
}


class Named(Table):
    """The table of a metal that is told by its colour, by its indices, or by a name that stands for these."""

    metal: Name | None = None

    @model_validator(mode="before")
    @classmethod
    def _look_up(cls, value: Any) -> Any:
        if isinstance(value, BaseModel) or not isinstance(value, Mapping):
            return value
        name = value.get("metal")
        if name is None:
            if ("eta" in value) != ("k" in value):
                missing = "k" if "eta" in value else "eta"
                raise complaint(f"{show(missing)} is missing: a metal's index has both, eta and k")
            if "eta" not in value and "albedo" not in value:
                raise complaint('"albedo" is missing: add albedo = [0.8, 0.8, 0.8], or metal = "gold"')
            return value
        if not isinstance(name, str) or name not in METALS:
            hint = nearest(name if isinstance(name, str) else show(name), METALS)
            raise complaint(f"unknown metal {show(name)}{hint}", "metal")
        eta, k = METALS[name]
        return {"eta": eta, "k": k} | dict(value)
