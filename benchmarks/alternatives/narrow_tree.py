"""A tree with fewer children a node and faces a leaf than the walk tests at once: the other places stay empty."""

from dataclasses import replace
from unittest.mock import patch

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxrt.shapes.search import bvh


def narrow_topology(vertices: np.ndarray, faces: np.ndarray, width: int) -> bvh.Topology:
    """Return the tree of `width` <= 8 children a node and faces a leaf, as `bvh.exact_topology` would build it."""
    with patch.object(bvh, "WIDTH", width):
        tree = bvh.exact_topology(vertices, faces, least=1)
    assert tree is not None

    def filled(rows: Array, value: int) -> Array:
        return jnp.pad(rows, ((0, 0), (0, bvh.WIDTH - width)), constant_values=value)

    return replace(
        tree,
        children=filled(tree.children, -1),
        first=filled(tree.first, 0),
        last=filled(tree.last, 0),
        faces=filled(tree.faces, -1),
    )
