"""Cameras: one file a kind, behind the `View` that the path and the edges read."""

from jaxrt.cameras.interface import Projection, View, edges_known, projection, view_of
from jaxrt.cameras.padded import Padded
from jaxrt.description.kinds import CAMERAS

__all__ = ["Padded", "Projection", "View", "edges_known", "projection", "view_of"]

CAMERAS.load("pinhole", "calibrated", "orthographic", "fisheye", "equirectangular", "thin_lens")
