"""Cameras: one file a kind, behind the `View` that the path and the edges read."""

from jaxrt.cameras.interface import Projection, View, projection, view_of
from jaxrt.cameras.pinhole import Pinhole

__all__ = ["Pinhole", "Projection", "View", "projection", "view_of"]
