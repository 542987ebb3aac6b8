"""Strips and fans of triangles, as PLY and glTF have them, to triangles."""

import numpy as np

from jaxrt.description.mesh_facts import Ints
from jaxrt.io.meshes.polygons import Polygons


def strip_triangles(strips: Polygons) -> Ints:
    """Return the triangles (n, 3) of strips; a negative vertex begins a new strip.

    Every second one is turned, so that all show the same side. Those of a repeated vertex, which join two strips into
    one, are left out.
    """
    firsts = np.zeros(len(strips.corners) + 1, bool)
    firsts[strips.starts] = True
    firsts[1:] |= strips.corners < 0
    firsts = firsts[:-1]
    # Place of each corner in its strip
    places = np.arange(len(firsts))
    place = places - np.maximum.accumulate(np.where(firsts, places, 0))
    trios = np.stack([strips.corners[:-2], strips.corners[1:-1], strips.corners[2:]], -1)
    # A strip that begins at the second or the third corner parts the trio
    whole = ~(firsts[1:-1] | firsts[2:]) & (trios >= 0).all(axis=-1)
    odd = place[:-2] % 2 == 1
    trios[odd] = trios[odd][:, [1, 0, 2]]
    a, b, c = trios.T
    return trios[whole & (a != b) & (b != c) & (c != a)]


def fan_triangles(corners: Ints) -> Ints:
    """Return the triangles (n, 3) of one fan around its first corner."""
    first = np.full(max(len(corners) - 2, 0), corners[0] if len(corners) else 0)
    return np.stack([first, corners[1:-1], corners[2:]], -1)
