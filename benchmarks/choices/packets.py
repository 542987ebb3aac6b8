"""How many pixels a packet holds."""

from dataclasses import replace

import jaxrt
from benchmarks.choices.bounces import difference
from benchmarks.choices.figures import Choice, Figure, Table, cost, error
from benchmarks.interleave import picture
from benchmarks.mesh_rays import bumpy_sphere, room
from jaxrt.render import CPU_TILE

TILES = ((4, 4), (8, 4), (8, 8), (16, 8), (16, 16), (32, 16), (32, 32))
MESH_TILES = ((8, 8), (16, 8), (16, 16))  # of a scene that takes long to compile


def tile_name(tile: tuple[int, int]) -> str:
    """Return 'width×height'."""
    return f"{tile[0]}×{tile[1]}"


NAME, OURS, LANES = "packets", tile_name(CPU_TILE), CPU_TILE[0] * CPU_TILE[1]
ROOM, MESH = "room", "mesh in a room"


def measure(rounds: int) -> list[Figure]:
    """Return all figures."""
    mesh = jaxrt.build(room(*bumpy_sphere(5)))
    mesh = replace(mesh, camera=replace(mesh.camera, width=128, height=128))
    scenes = {ROOM: (jaxrt.load_scene("scenes/room.toml"), TILES), MESH: (mesh, MESH_TILES)}
    figures: list[Figure] = []
    for name, (scene, tiles) in scenes.items():
        pictures = {tile_name(tile): picture(scene, 4, 4, tile=tile) for tile in tiles}
        for v, p in pictures.items():
            figures.append(error(NAME, v, f"largest difference, {name}", difference(p, pictures[OURS])))
        figures += cost(NAME, f"time, {name}", {v: p.again for v, p in pictures.items()}, OURS, rounds)
    return figures


def argument(t: Table) -> str:
    """Return what the figures say."""
    times = {tile_name(tile): t(tile_name(tile), f"time, {ROOM}") for tile in TILES}
    meshes = ", ".join(f"{t(tile_name(tile), f'time, {MESH}'):.2f} ({tile_name(tile)})" for tile in MESH_TILES)
    smaller, larger = (
        ", ".join(f"{times[tile_name(x)]:.2f} ({tile_name(x)})" for x in TILES if few == (x[0] * x[1] < lanes))
        for few, lanes in ((True, LANES), (False, LANES + 1))
    )
    return (
        f"In times of {OURS}: smaller packets take {smaller} in the room, for their loop's overhead is shared by "
        f"fewer lanes, larger ones {larger}; with a mesh it is {meshes}. The picture does not depend on it."
    )


CHOICE = Choice(
    NAME,
    "Packet: how many pixels",
    OURS,
    "The room, 256×256, 4 spp, and a mesh of 20,480 faces in a room, 128×128, 4 spp; max_depth 4. Difference: the "
    "largest of any pixel, in the mean radiance.",
    measure,
    argument,
)
