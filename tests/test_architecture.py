"""The house: imports point down, floors are where docs say, rooms and files stay small."""

import ast
from pathlib import Path

import pytest

# From the ground up. A room is a folder of jaxrt/, or a file there; it imports from lower floors and from itself
FLOORS = [
    {"core"},
    {"kernels", "hosts", "filters"},
    {"description"},
    {"textures"},
    {"shapes", "materials", "lights", "cameras", "kinds"},
    {"scene"},
    {"transport", "io"},
    {"boundary", "views"},
    {"render"},
    {"programs", "chunks"},
    {"hands"},
    {"gradcheck"},
    {"fit"},
    {"cli"},
    {"__init__", "__main__"},
]
ROOMS = {room: floor for floor, rooms in enumerate(FLOORS) for room in rooms}
PACKAGE = Path("jaxrt")
MODULES = sorted(PACKAGE.rglob("*.py"))
FULL = 12  # files that a folder holds at most
FORMATS = PACKAGE / "io" / "meshes"  # one file a format, and what they share
LONGEST = 60  # lines of a function, its docstring apart


def room_of(module: Path) -> str:
    return module.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imports_of(module: Path) -> set[str]:
    """Return the modules of jaxrt that a module imports from, lazy imports included, type-only ones not."""
    found = set()
    tree = ast.parse(module.read_text())
    typing_only = [n for n in ast.walk(tree) if isinstance(n, ast.If) and "TYPE_CHECKING" in ast.dump(n.test)]
    skipped = {id(n) for block in typing_only for n in ast.walk(block)}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and id(node) not in skipped:
            assert node.level == 0, f"{module}:{node.lineno}: relative import; write jaxrt.…"
            if node.module and f"{node.module}.".startswith("jaxrt."):
                home = node.module.removeprefix("jaxrt").removeprefix(".")
                found |= {_module_of(home, alias.name) for alias in node.names}
    return found


def _module_of(home: str, name: str) -> str:
    """Return the module that `from jaxrt.HOME import NAME` needs: NAME itself where that is one."""
    inner = f"{home}.{name}".removeprefix(".")
    path = PACKAGE / inner.replace(".", "/")
    return inner if path.is_dir() or path.with_suffix(".py").exists() else home


@pytest.mark.parametrize("module", MODULES, ids=str)
def test_imports_point_down(module: Path) -> None:
    room = room_of(module)
    assert room in ROOMS, f"{module}: name its floor in FLOORS"
    for other in {name.split(".")[0] for name in imports_of(module)} - {room}:
        assert other in ROOMS, f"{module}: imports jaxrt.{other}, which is no room"
        assert ROOMS[other] < ROOMS[room], f"{module}: imports jaxrt.{other}, which is not on a lower floor"


def test_modules_have_no_cycle() -> None:
    names = {".".join(m.relative_to(PACKAGE).with_suffix("").parts).removesuffix(".__init__"): m for m in MODULES}
    edges = {name: imports_of(module) & names.keys() for name, module in names.items()}
    done: set[str] = set()

    def reach(name: str, above: tuple[str, ...]) -> None:
        assert name not in above, f"import cycle: {' -> '.join((*above, name))}"
        if name not in done:
            for other in edges[name]:
                reach(other, (*above, name))
            done.add(name)

    for name in names:
        reach(name, ())


@pytest.mark.parametrize("folder", sorted({module.parent for module in MODULES} - {FORMATS}), ids=str)
def test_no_folder_is_crowded(folder: Path) -> None:
    assert len(list(folder.glob("*.py"))) <= FULL, f"{folder}: part it"


# A probe, lanes of pixels, of paths and of edge samples, few of a packet, its rays, few shapes, arguments of a
# linear function
MANY = {"internals.py", "film.py", "regeneration.py", "shine.py", "boundary", "few.py", "linear.py"}
MANY |= {"traverse.py", "walk.py", "lockstep.py", "few_shapes.py"}


@pytest.mark.parametrize("module", MODULES, ids=str)
def test_code_is_written_for_one_ray(module: Path) -> None:
    if not MANY & set(module.parts):
        assert "vmap(" not in module.read_text(), f"{module}: written for one ray; film.py maps over lanes"


@pytest.mark.parametrize("module", MODULES, ids=str)
def test_files_stay_small(module: Path) -> None:
    assert len(module.read_text().splitlines()) <= 400, f"{module}: split it"


@pytest.mark.parametrize("module", MODULES, ids=str)
def test_functions_stay_short(module: Path) -> None:
    for node in ast.walk(ast.parse(module.read_text())):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            first = node.body[1] if ast.get_docstring(node) and len(node.body) > 1 else node.body[0]
            length = (node.end_lineno or 0) - first.lineno + 1
            assert length <= LONGEST, f"{module}: {node.name} has {length} lines: part it"
