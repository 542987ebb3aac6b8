"""Programs that say of themselves what the loader looks for.

XLA compiles for CPUs with AVX-512 under two preferences, which it then counts among the instructions that a program
needs. No CPU has them as instructions: so jaxlib 0.10 prints a page of "features not supported" for each program that
it loads again, as if it could crash. They are of no use once code is there, and are stored as not needed.
"""

import zlib

PREFERENCES = (b"prefer-no-gather", b"prefer-no-scatter")
ZSTD = bytes.fromhex("28b52ffd")  # begins what it compresses


def matching(program: bytes) -> bytes:
    """Return a serialized program, or JAX's compressed file of one, with the preferences as not needed.

    What is not understood is returned as it is.
    """
    if program[:4] == ZSTD:
        try:
            import zstandard
        except ImportError:
            return program
        plain = zstandard.ZstdDecompressor().decompressobj().decompress(program)
        matched = _matched(plain)
        return program if matched == plain else zstandard.ZstdCompressor().compress(matched)
    try:
        plain = zlib.decompress(program)
    except zlib.error:
        return _matched(program)
    matched = _matched(plain)
    return program if matched == plain else zlib.compress(matched)


def _matched(program: bytes) -> bytes:
    """Return the program with each preference's plus a minus: no length changes."""
    for name in PREFERENCES:
        program = program.replace(b"+" + name, b"-" + name)
    return program
