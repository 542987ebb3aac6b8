"""The tree of a mesh, as it is built."""

from itertools import combinations

import numpy as np
import pytest

from jaxrt.shapes.search import bvh


def children_of(tree, node, kept):
    """Return how many children a node has, where nodes other than those kept are dissolved in their parents."""
    count, left = 0, tree.left[node]
    for child in (left, left + 1):
        count += 1 if tree.left[child] < 0 or child in kept else children_of(tree, child, kept)
    return count


def least_visits(tree):
    """Return the least sum of the areas of nodes with at most eight children, over that of the root: all are tried."""
    inner = np.flatnonzero(tree.left[1:] >= 0) + 1
    sums = [
        sum(tree.area[list(kept)]) / tree.area[0]
        for size in range(len(inner) + 1)
        for kept in map(set, combinations(inner, size))
        if all(children_of(tree, node, kept) <= bvh.WIDTH for node in (0, *kept))
    ]
    return 1 + min(sums)


@pytest.mark.parametrize("seed", range(6))
def test_nodes_have_the_least_area_there_is(seed):
    rng = np.random.default_rng(seed)
    # Clusters of several sizes, so that the binary tree is not balanced
    middles = rng.normal(size=(100, 1, 3)) * rng.choice([0.1, 1, 5], (100, 1, 1))
    vertices, faces = (middles + 0.1 * rng.normal(size=(100, 3, 3))).reshape(-1, 3), np.arange(300).reshape(-1, 3)
    tree = bvh._grow(*bvh._boxes_of(vertices, faces))
    assert 10 <= np.sum(tree.left >= 0) <= 18
    # Each node costs a millionth besides its area, and there are at most 18
    assert bvh.survey(vertices, faces).node_visits == pytest.approx(least_visits(tree), abs=2e-5)
