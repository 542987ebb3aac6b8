"""A file of one kept program: what determines it, a checksum, the program."""

import hashlib
import os
import stat
from functools import partial
from pathlib import Path
from typing import BinaryIO

from jaxrt.core.writing import write_whole

MAGIC = b"jaxrt program, format 1\n"
SUFFIX = ".program"
LARGEST = 1 << 30  # bytes


def file_of(folder: Path, key: bytes) -> Path:
    """Return where the program of this key is kept, whether it is there or not."""
    return folder / (hashlib.sha256(key).hexdigest()[:32] + SUFFIX)


def write_program(file: Path, key: bytes, program: bytes) -> None:
    """Write the file, for its owner only."""
    write_whole(file, partial(_write, _head(key, program), program), mode=0o600)


def read_program(file: Path, key: bytes) -> bytes | None:
    """Return the program of this key, to the bit as it was written, or None; nothing in the file is interpreted."""
    try:
        descriptor = os.open(file, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError:
        return None
    with open(descriptor, "rb") as opened:
        found = os.fstat(descriptor)
        ours = stat.S_ISREG(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o077
        if not ours or found.st_size > LARGEST:
            return None
        content = opened.read()
    start = len(MAGIC) + len(key) + len("\n") + hashlib.sha256().digest_size
    program = content[start:]
    return program if content[:start] == _head(key, program) else None


def _head(key: bytes, program: bytes) -> bytes:
    named = MAGIC + key + b"\n"
    return named + hashlib.sha256(named + program).digest()


def _write(head: bytes, program: bytes, file: BinaryIO) -> None:
    file.write(head)
    file.write(program)
