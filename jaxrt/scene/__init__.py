"""Scenes: what one is, and how it is built from a description."""

from jaxrt.scene.build import build
from jaxrt.scene.record import NoSceneError, Scene, check_scene, drawn, placed

__all__ = ["NoSceneError", "Scene", "build", "check_scene", "drawn", "placed"]
