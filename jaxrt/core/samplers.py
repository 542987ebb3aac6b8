"""Numbers in [0, 1) as a pure function of (pixel, sample, seed, block): no state, any order, any split.

A block is the four numbers of one decision: two pairs (a, b), (c, d). Block 0 belongs to the camera, whose
first pair places the ray in its pixel; block k to event k along the path, whose first pair picks a point on a
light and whose second picks a direction. All pairs, blocks, pixels and seeds are mutually independent; a
sampler only decides how the samples 0 … spp-1 of ONE pair in one pixel are spread over the unit square.

Everything is 32-bit integer arithmetic on scalars, free of tables and loops: it vectorises over rays.
"""

import operator
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array


class Stream(NamedTuple):
    """Which random numbers: those of one sample of one pixel. Scalars, uint32."""

    pixel: Array  # index in the image, any number below 2³²
    sample: Array  # 0 … spp-1
    seed: Array  # from `seed_from_key`
    spp: Array  # samples that the pixel will get in all


Block = tuple[Array, Array, Array, Array]  # (a, b, c, d): four float32 in [0, 1)
Sampler = Callable[[Stream, Array | int], Block]  # sampler(stream, block index)

LAST = 1 - 2.0**-24  # the largest of all numbers
GROUP_BITS = 20  # strata and index arithmetic cover 2²⁰ samples; later samples start a new, independent group


def independent(stream: Stream, block: Array | int) -> Block:
    """Return a block of mutually independent numbers: plain Monte Carlo."""
    a, b, c, d = _pcg4d(stream.pixel, stream.sample, _u32(block), stream.seed)
    return _to_float(a), _to_float(b), _to_float(c), _to_float(d)


def stratified(stream: Stream, block: Array | int) -> Block:
    """Return a block whose pairs are jittered: the samples of a pixel fall in different cells of a grid.

    The grid has nx·ny >= spp cells, nx = ⌊√spp⌋, ny = ⌈spp/nx⌉. A random bijection of the grid, made anew for
    each pixel, pair and seed, says which cell is whose. So every sample is uniform on its own, and means are
    unbiased for any spp, also when cells stay empty.
    """
    nx, ny = strata(stream.spp)
    group = stream.sample >> GROUP_BITS
    keys = _pcg4d(stream.pixel ^ _STRATA, group, _u32(block), stream.seed)
    a, b, c, d = independent(stream, block)
    y, x = _divide(stream.sample & ((1 << GROUP_BITS) - 1), nx)
    y = jnp.where(y < ny, y, 0)  # only a sample index beyond spp gets there
    x0, y0 = _shuffle_cells(x, y, nx, ny, keys[0], keys[1])
    x1, y1 = _shuffle_cells(x, y, nx, ny, keys[2], keys[3])
    first = place_in_cell(x0, nx, a), place_in_cell(y0, ny, b)
    return *first, place_in_cell(x1, nx, c), place_in_cell(y1, ny, d)


def sobol(stream: Stream, block: Array | int) -> Block:
    """Return a block whose pairs are Owen-scrambled Sobol' points, in an own order for each pixel and pair.

    Padding of 2-D sequences, shuffled and scrambled by hashes: Burley, "Practical Hash-based Owen Scrambling"
    (2020). Best when spp is a power of two.
    """
    keys = _pcg4d(stream.pixel ^ _SOBOL, _u32(block), stream.seed, _u32(0))
    more = [_mix(keys[2] ^ (keys[1] >> 16)), _mix(keys[3] ^ (keys[0] >> 16))]
    reversed_index = _reverse_bits(stream.sample)
    a, b = _sobol_pair(reversed_index, keys[0], keys[2], keys[3])
    c, d = _sobol_pair(reversed_index, keys[1], more[0], more[1])
    return a, b, c, d


SAMPLERS: dict[str, Sampler] = {"independent": independent, "stratified": stratified, "sobol": sobol}


def seed_from_key(key: Array | int) -> Array:
    """Return the uint32 seed of a key: an integer, an integer scalar array, or a JAX key, old or new style.

    Integers 0 … 2³²-1 are their own seeds, so their streams differ; wider keys are hashed to 32 bits,
    negative ones taken modulo 2⁶⁴. `jax.random.key(n)` stands for n. Raises TypeError for anything else,
    arrays of keys included (use `jax.vmap`), and ValueError for integers beyond 64 bits.
    """
    if not isinstance(key, jax.Array | np.ndarray):
        return _seed_from_words(_words_of_int(key))
    if jax.dtypes.issubdtype(key.dtype, jax.dtypes.prng_key):
        if key.shape != ():
            raise TypeError(f"key: an array of {key.shape} keys is not one key (use jax.vmap, or index it)")
        return _seed_from_words(list(jax.random.key_data(key)))
    if not jnp.issubdtype(key.dtype, jnp.integer):
        raise TypeError(f"key: dtype {key.dtype} is neither an integer nor a JAX key (try jax.random.key(0))")
    if key.dtype == jnp.uint32 and key.shape in {(2,), (4,)}:
        return _seed_from_words(list(key))
    if key.shape != ():
        raise TypeError(f"key: shape {key.shape} is not that of one key (use jax.vmap, or index it)")
    return _seed_from_words(_words_of_scalar(key))


def strata(spp: Array) -> tuple[Array, Array]:
    """Return (nx, ny), uint32, of the grid for spp samples: ⌊√n⌋ and ⌈n/nx⌉, n = spp clipped to [1, 2²⁰]."""
    n = jnp.clip(spp, 1, 1 << GROUP_BITS)
    # Take the root of n + ½, at least 4 ulp away from every integer: any decent √ gives the exact floor
    nx = _floor(jnp.sqrt(_whole(n) + 0.5))
    return nx, _divide(n + nx - 1, nx)[0]


def place_in_cell(cell: Array, n: Array, a: Array) -> Array:
    """Return the number at a of 1 in cell 0 … n-1 of n: below 1, although (n - 1 + a)/n may round to 1."""
    return jnp.minimum((_whole(cell) + a) * (1 / _whole(n)), np.float32(LAST))


_U32 = np.uint32
_STRATA, _SOBOL = _U32(0x5BD1E995), _U32(0xA511E9B3)  # keep the samplers' own hashes apart from the jitter's
_COLUMN = _U32(0x9E3779B9)


def _u32(x: Array | int) -> Array:
    return jnp.asarray(x).astype(jnp.uint32)


def _whole(x: Array) -> Array:
    """Return a number below 2²⁴ in float32, exactly, by way of int32: unsigned conversions are slow."""
    return x.astype(jnp.int32).astype(jnp.float32)


def _floor(x: Array) -> Array:
    return x.astype(jnp.int32).astype(jnp.uint32)


def _to_float(x: Array) -> Array:
    """Return the upper 24 bits as a float32 in [0, 1 - 2⁻²⁴]: every value is exact, none rounds up to 1."""
    return _whole(x >> 8) * np.float32(2.0**-24)


def _pcg4d(x: Array, y: Array, z: Array, w: Array) -> tuple[Array, Array, Array, Array]:
    """Return four hashes of four numbers, a bijection of 128 bits (Jarzynski & Olano 2020, pcg4d)."""
    x, y, z, w = (_u32(v) * _U32(1664525) + _U32(1013904223) for v in (x, y, z, w))
    x, y, z, w = _pcg4d_round(x, y, z, w)
    return _pcg4d_round(*(v ^ (v >> 16) for v in (x, y, z, w)))


def _pcg4d_round(x: Array, y: Array, z: Array, w: Array) -> tuple[Array, Array, Array, Array]:
    x = x + y * w
    y = y + z * x
    z = z + x * y
    return x, y, z, w + y * z


def _mix(x: Array) -> Array:
    """Return a bijective hash that keeps 0 (lowbias32, Wellons 2018)."""
    x = (x ^ (x >> 16)) * _U32(0x7FEB352D)
    x = (x ^ (x >> 15)) * _U32(0x846CA68B)
    return x ^ (x >> 16)


def _mix_upper(x: Array) -> Array:
    """Return a hash of which only the upper bits are good: all that `_scale` looks at."""
    x = x * _U32(0x7FEB352D)
    return (x ^ (x >> 15)) * _U32(0x846CA68B)


def _scale(x: Array, n: Array) -> Array:
    """Return ⌊n·x/2³²⌋ for n <= 2¹¹ from the upper 21 bits of x: no 64-bit product, no remainder."""
    return ((x >> 11) * n) >> 21


def _divide(i: Array, n: Array) -> tuple[Array, Array]:
    """Return quotient and remainder of i/n for i < 2²¹, n > 0.

    Exact: (i + ½)/n is at least ½/n away from any integer; its two roundings move it by less than i·2⁻²²/n.
    """
    q = _floor((_whole(i) + 0.5) * (1 / _whole(n)))
    return q, i - q * n


def _shuffle_cells(x: Array, y: Array, nx: Array, ny: Array, k0: Array, k1: Array) -> tuple[Array, Array]:
    """Return cell (x, y) moved by a random bijection of the nx × ny grid: rows, columns shift each other."""
    for key in (k0, k1):
        # Never hash the same number for row and column, or equal x and y would shift alike
        x = _wrapped_sum(x, _scale(_mix_upper(y ^ key), nx), nx)
        y = _wrapped_sum(y, _scale(_mix_upper((x + _COLUMN) ^ key), ny), ny)
    return x, y


def _wrapped_sum(a: Array, b: Array, n: Array) -> Array:
    total = a + b
    return jnp.where(total >= n, total - n, total)


def _reverse_bits(x: Array) -> Array:
    for mask, shift in ((0x55555555, 1), (0x33333333, 2), (0x0F0F0F0F, 4), (0x00FF00FF, 8)):
        x = ((x >> shift) & _U32(mask)) | ((x & _U32(mask)) << shift)
    return (x >> 16) | (x << 16)


def _scramble_upwards(x: Array, key: Array) -> Array:
    """Return x with each bit flipped by a hash of the bits below it: an Owen scramble of the reversed bits.

    Laine & Karras (2011) with the constants of Vegdahl (2021), as in pbrt-v4's FastOwenScrambler.
    """
    x = x ^ (x * _U32(0x3D20ADEA))
    x = (x + key) * ((key >> 16) | 1)
    x = x ^ (x * _U32(0x05526C56))
    return x ^ (x * _U32(0x53A22864))


def _sobol_pair(reversed_index: Array, order: Array, key_x: Array, key_y: Array) -> tuple[Array, Array]:
    """Return a scrambled 2-D Sobol' point, its coordinates made bit-reversed and reversed at the end."""
    index = _reverse_bits(_scramble_upwards(reversed_index, order))
    x = _reverse_bits(_scramble_upwards(index, key_x))
    y = _reverse_bits(_scramble_upwards(_second_dimension(index), key_y))
    return _to_float(x), _to_float(y)


def _second_dimension(index: Array) -> Array:
    """Return the bit-reversed second Sobol' coordinate: Pascal's matrix modulo 2, as five steps."""
    for mask, shift in ((0xAAAAAAAA, 1), (0xCCCCCCCC, 2), (0xF0F0F0F0, 4), (0xFF00FF00, 8), (0xFFFF0000, 16)):
        index = index ^ ((index & _U32(mask)) >> shift)
    return index


def _words_of_int(key: int) -> list[Array]:
    try:
        number = operator.index(key)
    except TypeError:
        raise TypeError(f"key: {key!r} is neither an integer nor a JAX key (try 0)") from None
    if not -(2**63) <= number < 2**64:
        raise ValueError(f"key: {number} does not fit in 64 bits")
    return [jnp.uint32((number >> 32) & 0xFFFFFFFF), jnp.uint32(number & 0xFFFFFFFF)]


def _words_of_scalar(key: Array) -> list[Array]:
    if key.dtype.itemsize == 8:
        return [_u32(key >> 32), _u32(key & 0xFFFFFFFF)]
    return [jnp.where(key < 0, _U32(0xFFFFFFFF), _U32(0)), _u32(key)]


def _seed_from_words(words: list[Array]) -> Array:
    """Return the last word, moved by a hash of those before it that is 0 when they are 0."""
    hashed = jnp.uint32(0)
    for word in words[:-1]:
        hashed = _mix(hashed * _U32(0x9E3779B9) ^ word)
    return words[-1] ^ hashed
