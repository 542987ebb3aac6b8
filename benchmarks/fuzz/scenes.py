"""Scene files: every key with every kind of bad value, keys lost, doubled and misspelt, damaged text."""

import random
from collections.abc import Iterator
from functools import cache

from benchmarks.fuzz.judge import Case
from benchmarks.fuzz.values import (
    BAD_NUMBERS,
    BAD_VALUES,
    GIANT,
    HUGE,
    KEYS,
    NOT_NUMBERS,
    TABLES,
    VECTORS,
    WRONG_LENGTHS,
)

NAMES = ['"шар"', '"a.b"', '"a\\nb"', f'"{"b" * 9999}"', '"😀"', '""']  # odd, but names


def scene(changes: dict[tuple[str, str], str | None] | None = None, more: dict[str, str] | None = None) -> str:
    """Return the valid scene with values changed, keys left out where they are None, and lines added to tables."""
    changes, more = changes or {}, more or {}
    lines = []
    for table in TABLES:
        lines.append(table.strip())
        for owner, key, value, *_ in KEYS:
            value = changes.get((table, key), value) if owner == table else None
            if value is not None:
                lines.append(f"{key} = {value}")
        if table in more:
            lines.append(more[table])
    return "\n".join(lines) + "\n"


def bad_values(kind: str, valid: str) -> Iterator[str]:
    """Return values that a key of this kind must refuse."""
    if kind in BAD_VALUES:
        yield from BAD_VALUES[kind]
        return
    numbers = NOT_NUMBERS + BAD_NUMBERS[kind]
    if kind == "power":  # one number is grey
        yield from BAD_NUMBERS[kind]
    if kind not in VECTORS:
        yield from [*numbers, "[1]", "[1, 2, 3]", GIANT]
        return
    yield from [*(v for v in NOT_NUMBERS), *WRONG_LENGTHS]
    parts = valid.strip("[]").split(", ")
    for component in range(3):
        for bad in numbers:
            yield f"[{', '.join([*parts[:component], bad, *parts[component + 1 :]])}]"


def _values() -> Iterator[Case]:
    for table, key, valid, kind, _ in KEYS:
        for bad in bad_values(kind, valid):
            case = _refused(f"{table.strip()} {key} = {bad[:60]}", scene({(table, key): bad}))
            yield case._replace(names=table.strip("[] ").split(".")[0])


def _keys() -> Iterator[Case]:
    for table, key, valid, _, required in KEYS:
        place = f"{table.strip()} {key}"
        if required:
            yield _refused(f"{place} is missing", scene({(table, key): None}))
        yield _refused(f"{place} doubled", scene(more={table: f"{key} = {valid}"}))
        yield _refused(f"{place} without a value", scene({(table, key): ""}))
        misspelt = {key[:i] + key[i + 1 :] for i in range(len(key))} | {key.upper(), key + "s", "_" + key, f'"{key} "'}
        for wrong in sorted(
            misspelt | {f'"{key}\\u0000"', f'"{key}\\u200b"', f"{key}.x", f'"{key}".{key}', "x" * 5000}
        ):
            if wrong != "":
                line = f"{wrong} = {valid}" if wrong.split(".")[0].strip('"') != key else f"y{wrong} = 1"
                yield _refused(f"{place} as {wrong[:40]}", scene({(table, key): None}, {table: line}))
        for other in TABLES:
            if (other.strip(), key) not in {(t.strip(), k) for t, k, *_ in KEYS} and not (
                other.startswith("[[meshes]]") and table.startswith("[[m")
            ):
                yield _refused(f"{place} in {other.strip()}", scene(more={other: f"{key} = {valid}"}))
    for table in TABLES:
        plain, double = table.strip().strip("[]"), table.startswith("[[")
        yield _refused(
            f"{table} with other brackets", scene().replace(table.strip(), f"[{plain}]" if double else f"[[{plain}]]")
        )
        for value in ("5", "'x'", "[]" if not double else "[5]", "true", "[[1]]", "nan", *HUGE[:2]):
            if not plain.startswith("materials."):
                yield _refused(f"{plain} = {value[:20]}", f"{plain} = {value}\n" + _without(plain))


def _without(name: str) -> str:
    """Return the valid scene without a table, or an array of them."""
    keep, lines = True, []
    for line in scene().splitlines():
        if line.startswith("["):
            keep = line.strip("[]") != name
        if keep:
            lines.append(line)
    return "\n".join(lines)


def _texts() -> Iterator[Case]:
    """Text that is no TOML, no UTF-8, or far too much of something."""
    valid = scene()
    # fmt: off
    for text in (
        "a = " + "[" * 100_000, "a = " + "{a = " * 50_000, ".".join("a" * 3000) + " = 1", "a." * 100_000 + "a = 1",
        '"a b".' * 3000 + "a = 1", "[" + ".".join("a" * 3000) + "]", f"[{'a.' * 63}a]", "'" * 100_000, '"' * 100_001,
        "[" * 3, "x" * 1_000_000, "x = 1\n" * 2, "= 1", "a", "a = 1 b = 2", "a = \x01", 'a = "\x01"', "a = 1\x00",
        "\x00" * 1000, "a = 0x", "a = 1__0", "a = 01", "a = 1979-13-45", 'a = "\\ud800"', 'a = "\\q"', "[a]\n[a]",
        "a = '''", "[[camera]]", "camera = [",
    ):
        yield _refused(f"text {text[:30]!r}", valid + text)
    for name, content in {
        "UTF-16": valid.encode("utf-16"), "UTF-16 BE": b"\xfe\xff" + valid.encode("utf-16-be"),
        "UTF-32": valid.encode("utf-32"), "Latin-1": valid.encode() + b"# \xe9\n", "nothing": b"",
        "zeros": bytes(9999), "PNG": b"\x89PNG\r\n\x1a\n" + bytes(99), "surrogate": b"a = '\xed\xa0\x80'\n",
        "gzip": b"\x1f\x8b\x08" + bytes(50),
        "long UTF-8": valid.encode() + b"# \xc0\xaf", "CR": valid.replace("\n", "\r").encode(),
        "comment": b"# nothing else",
        "two BOM": ("\ufeff\ufeff" + valid).encode(), "escape": b"\x1b[31m" + valid.encode(),
    }.items():
        yield Case(name, content, ".toml", taken=False)
    # fmt: on
    # An unknown name among very many
    many = "".join(f"[materials.m{i}]\ntype = 'mirror'\n" for i in range(3000))
    for name in ("m", "whit", "nothing like it"):
        yield _refused(f"{name} among 3000", scene({("[[spheres]]", "material"): f"'{name}'"}) + many)


def _good() -> Iterator[Case]:
    """Files that must be read, however odd they look."""
    valid = scene()
    less = valid.replace("[render]\nspp = 4\nmax_depth = 3\n", "")
    for name, text in {
        "as it is": valid,
        "BOM": "\ufeff" + valid,
        "CRLF": valid.replace("\n", "\r\n"),
        "no last line end": valid.rstrip(),
        "comments": valid.replace("\n", " # π\n"),
        "tabs": valid.replace(" = ", "\t=\t"),
        "quoted keys": valid.replace("fov", '"fov"'),
        "hexadecimal": valid.replace("fov = 60", "fov = 0x3c"),
        "underscores": valid.replace("spp = 4", "spp = 1_024"),
        "dotted": "render.spp = 4\n" + less,
        "inline": "render = {spp = 4}\n" + less,
        "brightest": valid.replace("[9, 9, 9]", "1e29"),
        "many spheres": valid + _spheres(2000),
        **{
            f"name {name[:9]}": valid.replace("materials.ball", f"materials.{name}").replace('"ball"', name)
            for name in NAMES
        },
    }.items():
        yield Case(name, text.encode(), ".toml", taken=True)


def _spheres(count: int) -> str:
    return "".join(f"[[spheres]]\ncenter = [{i}, 9, 9]\nradius = 0.1\nmaterial = 'white'\n" for i in range(count))


def _refused(name: str, text: str) -> Case:
    return Case(name, text.encode(errors="surrogatepass"), ".toml", taken=False)


@cache
def systematic() -> tuple[Case, ...]:
    """Return all cases that are not drawn."""
    return (*_good(), *_texts(), *_keys(), *_values())


def mutations(seed: int, n: int) -> Iterator[Case]:
    """Return n cases: the systematic ones in an order that the seed gives, then drawn damage to the valid file."""
    rng = random.Random(f"scenes {seed}")
    cases = list(systematic())
    rng.shuffle(cases)
    yield from cases[:n]
    for i in range(n - len(cases)):
        yield Case(f"damage {i}", _damaged(rng, scene()).encode(errors="surrogatepass"), ".toml")


def _damaged(rng: random.Random, text: str) -> str:
    """Return the text with one to three pieces replaced, lines moved, lost or doubled."""
    pieces = [value for values in BAD_VALUES.values() for value in values if len(value) < 100] + NOT_NUMBERS
    for _ in range(rng.randint(1, 3)):
        lines = text.splitlines(keepends=True) or [""]
        i, j = sorted(rng.randrange(len(text) + 1) for _ in range(2))
        row = rng.randrange(len(lines))
        match rng.randrange(6):
            case 0:
                text = text[:i] + rng.choice(pieces) + text[min(j, i + rng.randrange(20)) :]
            case 1:
                text = (
                    text[:i]
                    + chr(rng.choice([0, 1, 9, 13, 27, 34, 39, 91, 127, 0x85, 0x2028, 0xD800, 0xFEFF]))
                    + text[i:]
                )
            case 2:
                text = "".join(lines[:row] + lines[row + 1 :])
            case 3:
                text = "".join([*lines[: row + 1], lines[row], *lines[row + 1 :]])
            case 4:
                rng.shuffle(lines)
                text = "".join(lines)
            case _:
                text = text[:i] + text[i : i + 1].swapcase() + text[i + 2 :]
    return text
