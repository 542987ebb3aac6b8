"""Files in and out: scene files and pictures. Makes no `jax.Array` itself."""

from os import PathLike
from typing import TYPE_CHECKING, Any

from jaxrt.io.image import load_image, save_image
from jaxrt.io.scene_file import read_description

if TYPE_CHECKING:
    from jaxrt.scene import Scene

__all__ = ["load_image", "load_scene", "read_description", "save_image"]


def load_scene(path: str | PathLike[str], dtype: Any = "float32") -> "Scene":
    """Return the scene in the TOML file at `path`. Errors, warnings, `dtype`: as for `jaxrt.build`."""
    # Import late: reading descriptions and pictures needs no JAX, whose import takes most of a second
    from jaxrt.scene import build

    return build(read_description(path), dtype)
