"""Imports point down: a module imports only from lower layers, or from its own package."""

import ast
from pathlib import Path

import pytest

LAYERS = [
    {"messages", "internals", "pytree", "native", "batches", "linear", "sealed", "gather", "jacobian", "writing"},
    {"maths", "sampling", "samplers", "color", "description", "mesh_facts", "mesh_pairs", "box_tree", "memory"},
    {"records", "checks"},
    {"shapes"},
    {"materials", "lights", "camera"},
    {"scene"},
    {"parameters", "path"},
    {"film", "boundary"},
    {"interior", "edges"},
    {"render"},
    {"io", "summary", "programs", "partial", "selectors"},
    {"chunks"},
    {"gradcheck", "hands"},
    {"fit"},
    {"cli"},
    {"__init__", "__main__"},
]
ROOMS = {room: level for level, rooms in enumerate(LAYERS) for room in rooms}
PACKAGE = Path("jaxrt")
MODULES = sorted(PACKAGE.rglob("*.py"))


def room_of(module: Path) -> str:
    return module.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imports_of(module: Path) -> set[str]:
    """Return the rooms that a module imports from, lazy imports included, type-only ones not."""
    rooms = set()
    tree = ast.parse(module.read_text())
    typing_only = [n for n in ast.walk(tree) if isinstance(n, ast.If) and "TYPE_CHECKING" in ast.dump(n.test)]
    skipped = {id(n) for block in typing_only for n in ast.walk(block)}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and id(node) not in skipped:
            assert node.level == 0, f"{module}:{node.lineno}: relative import; write jaxrt.…"
            if node.module and node.module.startswith("jaxrt."):
                rooms.add(node.module.split(".")[1])
    return rooms


@pytest.mark.parametrize("module", MODULES, ids=str)
def test_imports_point_down(module: Path) -> None:
    room = room_of(module)
    assert room in ROOMS, f"{module}: name its layer in LAYERS"
    if room == "cli":  # the program sees everything
        return
    same_layer = LAYERS[0] | LAYERS[1]  # foundations may use each other
    for other in imports_of(module) - {room}:
        below = ROOMS[other] < ROOMS[room] or {room, other} <= same_layer
        assert below, f"{module}: imports jaxrt.{other}, which is not in a lower layer"


def test_foundations_have_no_cycle() -> None:
    edges = {room_of(m): imports_of(m) for m in MODULES if room_of(m) in LAYERS[0] | LAYERS[1]}

    def reach(room: str, seen: frozenset[str]) -> None:
        assert room not in seen, f"import cycle through jaxrt.{room}"
        for other in edges.get(room, set()):
            reach(other, seen | {room})

    for room in edges:
        reach(room, frozenset())


# A probe, lanes of pixels, lanes of edge samples, rays of one packet, arguments of a linear function
MANY = {"internals.py", "film.py", "boundary", "traverse.py", "linear.py"}


@pytest.mark.parametrize("module", MODULES, ids=str)
def test_code_is_written_for_one_ray(module: Path) -> None:
    if not MANY & set(module.parts):
        assert "vmap(" not in module.read_text(), f"{module}: written for one ray; film.py maps over lanes"


@pytest.mark.parametrize("module", MODULES, ids=str)
def test_files_stay_small(module: Path) -> None:
    assert len(module.read_text().splitlines()) <= 400, f"{module}: split it"
