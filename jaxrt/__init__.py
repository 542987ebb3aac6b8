"""jaxrt: a differentiable Monte-Carlo path tracer in JAX."""

from jaxrt.description import SceneError, SceneWarning
from jaxrt.gradcheck import gradcheck
from jaxrt.io import load_image, load_mesh, load_scene, save_image
from jaxrt.jacobian import jacobian_once
from jaxrt.parameters import parameters, with_parameters
from jaxrt.render import render, use_cpu_cores
from jaxrt.scene import Scene, build

__all__ = [
    "Scene",
    "SceneError",
    "SceneWarning",
    "build",
    "gradcheck",
    "jacobian_once",
    "load_image",
    "load_mesh",
    "load_scene",
    "parameters",
    "render",
    "save_image",
    "use_cpu_cores",
    "with_parameters",
]
