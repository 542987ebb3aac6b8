"""How many children a node of a mesh's tree has, and faces a leaf."""

from collections.abc import Callable
from functools import partial

import jax
import numpy as np

from benchmarks.alternatives.narrow_tree import narrow_topology
from benchmarks.choices.figures import Choice, Figure, Table, cost, error
from benchmarks.choices.triangles import search
from benchmarks.interleave import Spread, compiled
from benchmarks.mesh_jaxrt import geometry, searcher
from benchmarks.mesh_rays import bumpy_sphere, camera_rays, incoherent_rays
from jaxrt.shapes.search.bvh import WIDTH

NAME, OURS = "tree", f"{WIDTH}"
WIDTHS = (WIDTH, 4, 2)
RAYS = 1 << 17
CAMERA, RANDOM, ANY = "camera rays", "random rays", "random rays, any hit"


def measure(rounds: int) -> list[Figure]:
    """Return all figures."""
    vertices, faces = bumpy_sphere(5)
    far = jax.device_put(np.full(RAYS, 1e30, np.float32))
    rays = {
        name: [jax.device_put(np.resize(x, (RAYS, 3))) for x in pair]
        for name, pair in ((CAMERA, camera_rays(RAYS)), (RANDOM, incoherent_rays(RAYS)))
    }
    rays[ANY] = rays[RANDOM]
    searches: dict[str, dict[str, Callable[[], object]]] = {name: {} for name in rays}
    found, figures = {}, []
    for width in WIDTHS:
        topology = narrow_topology(vertices, faces, width)
        table = geometry(vertices, faces, topology)
        programs = [compiled(searcher(any_hit), table, *rays[RANDOM], far).call for any_hit in (False, True)]
        for name, pair in rays.items():
            program = programs[name == ANY]
            searches[name][f"{width}"] = partial(search, program, table, *pair, far)
        found[f"{width}"] = np.asarray(programs[0](table, *rays[RANDOM], far).index)
        for what, rows in (("nodes", topology.children), ("leaves", topology.faces)):
            figures.append(Figure(NAME, f"{width}", what, "note", Spread(*[float(len(rows))] * 3), ".0f"))
    for variant, index in found.items():
        other = 1e5 * float((index != found[OURS]).mean())
        figures.append(error(NAME, variant, "other face hit, per 1e5", other, ".0f"))
    for name, actions in searches.items():
        figures += cost(NAME, name, actions, OURS, rounds)
    return figures


def argument(t: Table) -> str:
    """Return what the figures say."""
    parts = "; ".join(
        f"{w} wide: {t(f'{w}', CAMERA):.2f} for camera rays, {t(f'{w}', RANDOM):.2f} for random ones"
        for w in WIDTHS
        if w != WIDTH
    )
    return (
        f"In times of the tree of {WIDTH}: {parts}. This compares what can be compared without another walk. "
        f"{WIDTH} is fixed in the layout of a node (boxes and children in one row of words), in the three low bits of "
        f"a key that hold a child's place, and in the vector instruction that tests {WIDTH} boxes or faces at once; "
        "so narrower trees are walked with the other places empty, which counts their steps but gives them no cheaper "
        "ones. Where vectors have eight lanes a step of four boxes takes as many instructions as one of eight, so "
        "little is withheld from them; a machine of four lanes could tell otherwise. Wider trees need another layout, "
        "and are not measured."
    )


CHOICE = Choice(
    NAME,
    "The tree of a mesh: children a node",
    OURS,
    "Searches of a closed mesh of 20,480 faces, 131,072 rays each: from a camera, and random ones. A tree of width w "
    "has w children a node and w faces a leaf, built with the same heuristic.",
    measure,
    argument,
)
