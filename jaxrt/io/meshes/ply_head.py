"""The head of a PLY file: which elements follow, how many, and what each holds."""

import codecs
from typing import NamedTuple, NoReturn

from jaxrt.description import SceneError, nearest, show
from jaxrt.io.meshes.text import decode, is_count

KINDS = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8", "int64": "i8", "uint64": "u8",
}  # fmt: skip
LONGEST = 60  # letters of a name
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


class Property(NamedTuple):
    """One value of a row, or a list of them."""

    name: str
    kind: str  # NumPy's name of the type
    size_kind: str | None  # type of a list's size, None for one value


class Element(NamedTuple):
    """Rows of one kind."""

    name: str
    number: int  # of rows
    properties: list[Property]

    def find(self, *names: str) -> Property | None:
        """Return the first property of one of these names."""
        return next((p for name in names for p in self.properties if p.name == name), None)


class Head(NamedTuple):
    """What the head of a PLY file says."""

    order: str  # NumPy's sign of the byte order, "" for text
    elements: list[Element]
    textures: bool
    lines: int
    size: int  # bytes


def read_head(data: bytes, source: str) -> Head:
    """Return the head of a PLY file. Raises SceneError with file and line."""
    return _Reader(source).read(data)


class _Reader:
    def __init__(self, source: str):
        self.source = source
        self.order: str | None = None
        self.elements: list[Element] = []
        self.textures = False

    def read(self, data: bytes) -> Head:
        begin = len(codecs.BOM_UTF8) if data.startswith(codecs.BOM_UTF8) else 0
        if not data.startswith((b"ply\n", b"ply\r", b"ply "), begin):
            raise SceneError(f"{self.source}: cannot be read (not a PLY file): save it again")
        # The head's own line end: after a lone carriage return, numbers may begin with the byte of a line feed
        first = data.find(b"\n"), data.find(b"\r")
        end = b"\r\n" if first[1] == first[0] - 1 else b"\r" if first[0] < 0 or 0 <= first[1] < first[0] else b"\n"
        start, number = begin, 0
        while True:
            stop = data.find(end, start)
            line = decode(data[start : stop if stop >= 0 else len(data)])
            number += 1
            if line.strip() == "end_header":
                break
            if stop < 0 or number > 10_000:
                raise SceneError(f"{self.source}: cannot be read (the head has no end): save it again")
            self._line(number, line)
            start = stop + len(end)
        if self.order is None:
            raise SceneError(f"{self.source}: cannot be read (no format is named): save it again")
        return Head(self.order, self.elements, self.textures, number, stop + len(end) if stop >= 0 else len(data))

    def _refuse(self, number: int, trouble: str) -> NoReturn:
        raise SceneError(f"{self.source}: line {number}: {trouble}")

    def _line(self, number: int, line: str) -> None:
        match line.split():
            case ["element" | "property", *words] if not all(
                len(word) <= LONGEST and word.isprintable() for word in words
            ):
                self._refuse(number, f"{show(line)}: a name of more than {LONGEST} letters, or of others: shorten it")
            case [] | ["ply"] | ["obj_info", *_]:
                pass
            case ["comment", *words]:
                self.textures |= bool(words) and words[0].lower() == "texturefile"
            case ["format", name, "1.0"] if name in ORDERS:
                self.order = ORDERS[name]
            case ["format", *words]:
                self._refuse(number, f"unknown format {show(' '.join(words))}: save it as ascii 1.0 or binary")
            case ["element", name, count] if is_count(count):
                if any(element.name == name for element in self.elements):
                    self._refuse(number, f"element {show(name)} is announced twice: save it again")
                self.elements.append(Element(name, int(count), []))
            case ["property", "list", size_kind, kind, name] if self.elements:
                self._add(number, Property(name, self._kind(number, kind), self._kind(number, size_kind)))
            case ["property", kind, name] if self.elements:
                self._add(number, Property(name, self._kind(number, kind), None))
            case _:
                self._refuse(number, f"{show(line.strip())} is no line of a PLY head: save it again")

    def _add(self, number: int, new: Property) -> None:
        if new.size_kind is not None and new.size_kind.startswith("f"):
            self._refuse(number, f"the size of list {show(new.name)} is no whole number: save it again")
        if self.elements[-1].find(new.name):
            self._refuse(number, f"property {show(new.name)} is announced twice: save it again")
        self.elements[-1].properties.append(new)

    def _kind(self, number: int, word: str) -> str:
        if word not in KINDS:
            self._refuse(number, f"unknown type {show(word)}{nearest(word, KINDS)}: save it again")
        return KINDS[word]
