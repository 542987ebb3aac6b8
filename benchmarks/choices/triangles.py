"""The watertight test of ray and triangle against Möller and Trumbore's."""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import numpy as np

import jaxrt
from benchmarks.alternatives import moller_trumbore
from benchmarks.choices.figures import Choice, Figure, Table, cost, error
from benchmarks.interleave import Swap, compiled, picture
from benchmarks.mesh_jaxrt import geometry, searcher
from benchmarks.mesh_rays import bumpy_sphere, camera_rays, incoherent_rays, room, unit
from jaxrt.shapes import topology_of, triangle
from jaxrt.shapes.search import walk

NAME, OURS, OTHER = "triangles", "watertight", "Möller–Trumbore"
RAYS = 1 << 17
SWAPS: dict[str, list[Swap]] = {
    OURS: [],
    OTHER: [(module, "hit_distance", moller_trumbore.hit_distance_undivided) for module in (walk, triangle)],
}
CAMERA, RANDOM, LOOP = "camera rays, tree", "random rays, tree", "random rays, loop"
PICTURE = "picture, mesh in a room"
LEAKS = {"tree": "leaks per 1e5, tree", "loop": "leaks per 1e5, loop"}


def edge_rays(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rays (n, 3) from the inside of a closed mesh, each aimed at a point on an edge."""
    rng = np.random.default_rng(3)
    o = (0.1 * unit(rng.normal(size=(RAYS, 3)))).astype(np.float32)
    face, corner = rng.integers(0, len(faces), RAYS), rng.integers(0, 3, RAYS)
    a, b = vertices[faces[face, corner]], vertices[faces[face, (corner + 1) % 3]]
    return o, unit(a + rng.uniform(size=(RAYS, 1)) * (b - a) - o)


def search(program: Callable[..., Any], *operands: Any) -> object:
    """Return what a program finds, when it has."""
    return jax.block_until_ready(program(*operands))


def searches(kind: str, subdivisions: int, rounds: int) -> list[Figure]:
    """Return cost and leaks of searches of one mesh, through its tree or face by face."""
    vertices, faces = bumpy_sphere(subdivisions)
    vertices = vertices.astype(np.float32)
    table = geometry(vertices, faces, topology_of(vertices, faces) if kind == "tree" else None)
    far = jax.device_put(np.full(RAYS, 1e30, np.float32))
    given = {"edges": edge_rays(vertices, faces), RANDOM if kind == "tree" else LOOP: incoherent_rays(RAYS)}
    if kind == "tree":
        given[CAMERA] = camera_rays(RAYS)
    rays = {name: [jax.device_put(np.resize(x, (RAYS, 3))) for x in pair] for name, pair in given.items()}
    programs = {v: compiled(searcher(False), table, *rays["edges"], far, swaps=SWAPS[v]).call for v in SWAPS}
    figures = []
    for variant, program in programs.items():
        missed = ~np.asarray(program(table, *rays["edges"], far).valid)
        figures.append(error(NAME, variant, LEAKS[kind], 1e5 * float(missed.mean()), ".1f"))
    for name in [n for n in rays if n != "edges"]:
        actions = {v: partial(search, program, table, *rays[name], far) for v, program in programs.items()}
        figures += cost(NAME, name, actions, OURS, rounds)
    return figures


def measure(rounds: int) -> list[Figure]:
    """Return all figures."""
    figures = searches("tree", 5, rounds) + searches("loop", 1, rounds)
    description = room(*bumpy_sphere(5))
    description["camera"] |= {"width": 128, "height": 128}
    scene = jaxrt.build(description)
    pictures = {v: picture(scene, 8, 4, swaps) for v, swaps in SWAPS.items()}
    return figures + cost(NAME, PICTURE, {v: p.again for v, p in pictures.items()}, OURS, rounds)


def argument(t: Table) -> str:
    """Return what the figures say."""
    return (
        f"Möller and Trumbore's test lets {t(OTHER, LEAKS['tree']):.0f} of 100,000 rays through the closed mesh of the "
        f"tree and {t(OTHER, LEAKS['loop']):.0f} through the mesh searched face by face; ours "
        f"{t(OURS, LEAKS['tree']):.0f} and {t(OURS, LEAKS['loop']):.0f}. It takes {t(OTHER, PICTURE):.2f} times our "
        f"time for a whole picture, {t(OTHER, RANDOM):.2f} for single rays through a tree, {t(OTHER, CAMERA):.2f} for "
        f"packets and {t(OTHER, LOOP):.2f} for a bare loop of tests. A leak is a bright or dark pixel at a seam, which "
        "no number of samples removes: that is what the difference buys."
    )


CHOICE = Choice(
    NAME,
    "Ray and triangle: watertight, or Möller–Trumbore",
    OURS,
    "Searches of a closed mesh of 20,480 faces through its tree, and of 80 faces one by one, 131,072 rays each; the "
    "mesh in a room, 128×128, 8 spp, max_depth 4. Leaks: rays from inside at points on edges that hit nothing. The "
    "other test works on the same sheared corners and divides last.",
    measure,
    argument,
)
