"""Mutated mesh files: each is refused in one line, or read as a second reader reads it, or as before.

`python -m benchmarks.fuzz.meshes --seed 1 -n 5000` prints the counts, and lists what is read in another way than both.
"""

import argparse
import json
import logging
import re
import struct
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import jaxrt
from benchmarks.fuzz.mesh_readers import area_of, second_readers

BASES = Path(__file__).parents[2] / "tests" / "files"
KINDS = (".obj", ".off", ".ply", ".stl", ".glb")
SLOW = 5.0  # seconds
NASTY = (
    "nan inf -inf 1e999 1e39 -1 0 9 2147483648 99999999999999999999999999999999 0x10 1,5 1d0 1_0 . - é \0 3.5".split(
        " "
    )
)

Random = np.random.Generator


class Mutant(NamedTuple):
    """A mesh file that was changed, or the library that it names."""

    base: str  # file of BASES
    change: str
    files: dict[str, bytes]  # by name, the mesh file first


class Verdict(NamedTuple):
    """What became of a mutant."""

    outcome: str  # refused, as before, as the second reader, told, read by nobody else; not to be: differs, crash, slow
    detail: str


def mutations(seed: int, count: int) -> Iterator[Mutant]:
    """Yield mutants of the files in BASES, each kind of file and of change as often as the others."""
    rng = np.random.default_rng(seed)
    names = {kind: sorted(p.name for p in BASES.iterdir() if p.suffix == kind) for kind in (*KINDS, ".mtl")}
    for _ in range(count):
        kind = str(rng.choice(list(names)))
        base = str(rng.choice(names[kind]))
        data = (BASES / base).read_bytes()
        changes = _CHANGES + (_OF_JSON if kind == ".glb" else [] if _is_binary(data) else _OF_TEXT)
        change = changes[int(rng.integers(len(changes)))]
        mutated = data
        for _ in range(int(rng.choice([1, 1, 1, 2, 4]))):
            mutated = change(rng, mutated)
        files = {"mesh" + kind: mutated}
        if kind == ".mtl":
            name = next(iter(re.findall(rb"newmtl[ \t]*([^\r\n#]*)", data, re.IGNORECASE)), b"a").strip()
            box = (BASES / "box.obj").read_bytes()
            files = {"mesh.obj": b"mtllib mesh.mtl\n" + box.replace(b"f ", b"usemtl " + name + b"\nf ", 1)} | files
        yield Mutant(base, change.__name__.strip("_"), files)


def judge(mutant: Mutant, folder: Path) -> Verdict:
    """Return what becomes of a mutant, read in process from a folder that holds what the bases name."""
    for name, data in mutant.files.items():
        (folder / name).write_bytes(data)
    path = folder / next(iter(mutant.files))
    start = time.perf_counter()
    try:
        mesh, told = _load(path)
    except jaxrt.SceneError as error:
        sound = str(error).startswith(str(folder)) and "\n" not in str(error) and len(str(error)) < 1000
        return Verdict("refused" if sound else "crash", str(error)[:300])
    except Exception as error:
        return Verdict("crash", f"{type(error).__name__}: {error}"[:300])
    if time.perf_counter() - start > SLOW:
        return Verdict("slow", f"{time.perf_counter() - start:.1f} s")
    found = len(mesh["faces"]), area_of(mesh["vertices"], mesh["faces"])
    if not np.isfinite(found[1]) or mesh["faces"].min() < 0 or mesh["faces"].max() >= len(mesh["vertices"]):
        return Verdict("crash", "faces or vertices that are none")
    before = _before(mutant)
    if before and _agree(found, (*before, before[1])):
        return Verdict("as before", "")
    others = second_readers(path)
    if any(_agree(found, other) for other in others):
        return Verdict("as the second reader", "")
    outcome = "told" if told else "differs" if others else "read by nobody else"
    return Verdict(outcome, f"{found}, before {before}, others {others}, told {told}")


def _load(path: Path) -> tuple[dict[str, Any], list[str]]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        mesh = jaxrt.load_mesh(path)
    return mesh, [str(warning.message) for warning in caught]


def _before(mutant: Mutant) -> tuple[int, float] | None:
    """Return faces and area of the file before it was changed."""
    try:
        mesh, _ = _load(BASES / ("box.obj" if mutant.base.endswith(".mtl") else mutant.base))
    except jaxrt.SceneError:
        return None
    return len(mesh["faces"]), area_of(mesh["vertices"], mesh["faces"])


def _agree(found: tuple[int, float], other: tuple[int, float, float]) -> bool:
    return found[0] == other[0] and other[1] * (1 - 1e-5) <= found[1] <= other[2] * (1 + 1e-5)


# Changes of any file


def _flip_a_bit(rng: Random, data: bytes) -> bytes:
    at = int(rng.integers(len(data))) if data else 0
    return data[:at] + bytes([data[at] ^ (1 << int(rng.integers(8)))]) + data[at + 1 :] if data else data


def _set_a_byte(rng: Random, data: bytes) -> bytes:
    at = int(rng.integers(len(data) + 1))
    return data[:at] + bytes([int(rng.integers(256))]) + data[at + 1 :]


def _insert_bytes(rng: Random, data: bytes) -> bytes:
    at = int(rng.integers(len(data) + 1))
    return data[:at] + rng.bytes(int(rng.integers(1, 5))) + data[at:]


def _remove_bytes(rng: Random, data: bytes) -> bytes:
    at = int(rng.integers(len(data) + 1))
    return data[:at] + data[at + int(rng.integers(1, 5)) :]


def _cut_short(rng: Random, data: bytes) -> bytes:
    return data[: int(rng.integers(len(data) + 1))]


def _repeat_a_part(rng: Random, data: bytes) -> bytes:
    start, end = sorted(int(i) for i in rng.integers(len(data) + 1, size=2))
    return data[:end] + data[start:end] + data[end:]


def _append_junk(rng: Random, data: bytes) -> bytes:
    return data + rng.bytes(int(rng.integers(1, 600)))


def _join_another(rng: Random, data: bytes) -> bytes:
    other = sorted(BASES.iterdir())[int(rng.integers(len(list(BASES.iterdir()))))].read_bytes()
    return data[: int(rng.integers(len(data) + 1))] + other[int(rng.integers(len(other) + 1)) :]


_CHANGES: list[Callable[[Random, bytes], bytes]] = [
    _flip_a_bit,
    _set_a_byte,
    _insert_bytes,
    _remove_bytes,
    _cut_short,
    _repeat_a_part,
    _append_junk,
    _join_another,
]

# Changes of text


def _is_binary(data: bytes) -> bool:
    return b"\0" in data or b"binary_" in data[:60]


def _lines(rng: Random, data: bytes) -> tuple[list[bytes], int, int]:
    lines = data.splitlines(keepends=True) or [b""]
    i, j = (int(k) for k in rng.integers(len(lines), size=2))
    return lines, i, j


def _drop_a_line(rng: Random, data: bytes) -> bytes:
    lines, i, _ = _lines(rng, data)
    return b"".join(lines[:i] + lines[i + 1 :])


def _repeat_a_line(rng: Random, data: bytes) -> bytes:
    lines, i, _ = _lines(rng, data)
    return b"".join(lines[: i + 1] + lines[i:])


def _swap_lines(rng: Random, data: bytes) -> bytes:
    lines, i, j = _lines(rng, data)
    lines[i], lines[j] = lines[j], lines[i]
    return b"".join(lines)


def _words(rng: Random, data: bytes) -> tuple[list[bytes], int]:
    words = re.split(rb"(\s+)", data)
    return words, 2 * int(rng.integers((len(words) + 1) // 2))


def _put_a_nasty_word(rng: Random, data: bytes) -> bytes:
    words, i = _words(rng, data)
    words[i] = str(rng.choice(NASTY)).encode()
    return b"".join(words)


def _drop_a_word(rng: Random, data: bytes) -> bytes:
    words, i = _words(rng, data)
    return b"".join(words[:i] + words[i + 1 :])


def _change_a_number(rng: Random, data: bytes) -> bytes:
    places = list(re.finditer(rb"-?\d+", data))
    if not places:
        return data
    place = places[int(rng.integers(len(places)))]
    return data[: place.start()] + str(int(rng.integers(-3, 12))).encode() + data[place.end() :]


def _encode_anew(rng: Random, data: bytes) -> bytes:
    encoding = str(rng.choice(["utf-8-sig", "utf-16", "utf-32", "latin-1", "utf-16-le"]))
    return data.decode("latin-1").encode(encoding)


def _end_lines_anew(rng: Random, data: bytes) -> bytes:
    return data.replace(b"\n", [b"\r", b"\r\n", b" ", b"\\\n", b"\n\n", b"#\n"][int(rng.integers(6))])


_OF_TEXT: list[Callable[[Random, bytes], bytes]] = [
    _drop_a_line,
    _repeat_a_line,
    _swap_lines,
    _put_a_nasty_word,
    _drop_a_word,
    _change_a_number,
    _encode_anew,
    _end_lines_anew,
]

# Changes of the JSON of a GLB file


def _change_json(rng: Random, data: bytes) -> bytes:
    """Put another value into one place of the JSON, or take it away."""
    size = int.from_bytes(data[12:16], "little")
    try:
        document = json.loads(data[20 : 20 + size])
    except ValueError:
        return data
    places = list(_places(document)) if isinstance(document, dict) else []
    if not places:
        return data
    holder, key = places[int(rng.integers(len(places)))]
    values = [
        None,
        -1,
        0,
        1,
        3,
        7,
        1e9,
        2**70,
        1e400,
        True,
        "x",
        [],
        {},
        [[]],
        5121,
        5126,
        "VEC3",
        "data:,AA",
        "../a.bin",
    ]
    which = int(rng.integers(len(values) + 1))
    if which < len(values):
        holder[key] = values[which]
    else:
        del holder[key]
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    parts = struct.pack("<II", len(text), 0x4E4F534A) + text + data[20 + size :]
    return data[:8] + struct.pack("<I", 12 + len(parts)) + parts


def _places(value: Any) -> Iterator[tuple[Any, Any]]:
    for key in list(value) if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ():
        yield value, key
        yield from _places(value[key])


_OF_JSON = [_change_json] * 8


def prepare(folder: Path) -> None:
    """Copy what the bases name into a folder."""
    for path in BASES.iterdir():
        if path.suffix in (".mtl", ".bin"):
            (folder / path.name).write_bytes(path.read_bytes())


def main() -> int:
    """Judge mutants and print what became of them; 1 where one crashed, was slow, or is not what others read."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("-n", "--count", type=int, default=5000)
    args = parser.parse_args()
    return report(args.seed, args.count)


def report(seed: int, count: int) -> int:
    """Judge mutants, print what became of them, and return how many crashed, were slow, or are not what others read."""
    logging.getLogger("trimesh").disabled = True
    counts: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as name:
        prepare(Path(name))
        for mutant in mutations(seed, count):
            verdict = judge(mutant, Path(name))
            counts[verdict.outcome] += 1
            if verdict.outcome in ("crash", "slow", "differs", "read by nobody else"):
                print(f"  {verdict.outcome}: {mutant.base}, {mutant.change}: {verdict.detail}")
    print(f"{'mesh files':12} " + ", ".join(f"{count} {outcome}" for outcome, count in counts.most_common()))
    return counts["crash"] + counts["slow"] + counts["differs"]


if __name__ == "__main__":
    raise SystemExit(min(main(), 1))
