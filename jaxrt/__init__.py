"""jaxrt: a differentiable Monte-Carlo path tracer in JAX."""

import importlib
import importlib.metadata
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jaxrt.core.maths import rigid
    from jaxrt.core.messages import SceneError, SceneWarning
    from jaxrt.description.kinds import camera, light, material
    from jaxrt.fit import fit
    from jaxrt.gradcheck import gradcheck
    from jaxrt.io import example, load_image, load_mesh, load_scene, load_texture, load_views, save_image
    from jaxrt.io.image import show, tonemap
    from jaxrt.kernels.jacobian import jacobian_once
    from jaxrt.programs.keep import keep_programs
    from jaxrt.render import render, use_cpu_cores
    from jaxrt.scene import Scene, build
    from jaxrt.scene.opencv import camera_from_opencv, camera_to_opencv
    from jaxrt.scene.parameters import names, parameters, with_parameters

__all__ = [
    "Scene",
    "SceneError",
    "SceneWarning",
    "build",
    "camera",
    "camera_from_opencv",
    "camera_to_opencv",
    "example",
    "fit",
    "gradcheck",
    "jacobian_once",
    "keep_programs",
    "light",
    "load_image",
    "load_mesh",
    "load_scene",
    "load_texture",
    "load_views",
    "material",
    "names",
    "parameters",
    "render",
    "rigid",
    "save_image",
    "show",
    "tonemap",
    "use_cpu_cores",
    "with_parameters",
]

# Where the names are, imported when one is asked for: the command line's help needs neither JAX nor NumPy
_HOMES = {
    "fit": ("fit",),
    "gradcheck": ("gradcheck",),
    "io": ("example", "load_image", "load_mesh", "load_scene", "load_texture", "load_views", "save_image"),
    "io.image": ("show", "tonemap"),
    "kernels.jacobian": ("jacobian_once",),
    "core.maths": ("rigid",),
    "core.messages": ("SceneError", "SceneWarning"),
    "description.kinds": ("camera", "light", "material"),
    "scene.parameters": ("names", "parameters", "with_parameters"),
    "programs.keep": ("keep_programs",),
    "render": ("render", "use_cpu_cores"),
    "scene": ("Scene", "build"),
    "scene.opencv": ("camera_from_opencv", "camera_to_opencv"),
}


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return importlib.metadata.version("jaxrt")
    home = next((home for home, names in _HOMES.items() if name in names), None)
    if home is None:
        raise AttributeError(f"module 'jaxrt' has no attribute {name!r}")
    value = getattr(importlib.import_module(f"jaxrt.{home}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]


class _Face(ModuleType):
    """The package, in which a submodule does not hide the function of its name."""

    def __setattr__(self, name: str, value: object) -> None:
        if not (isinstance(value, ModuleType) and name in __all__):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Face
