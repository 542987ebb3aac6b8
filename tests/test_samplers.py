"""What each sampler promises: its structure, its seeds, and the same numbers however they are asked for."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrt.core.samplers import SAMPLERS, Stream, seed_from_key, strata
from jaxrt.kernels.native import map_packets

AXES = Stream(0, 0, 0, None)


def numbers(name, pixel, sample, seed=0, spp=64, block=0):
    """Return (4, n) numbers of the broadcast arguments, from jitted calls of 40 000 rows: one compilation."""
    p, s, k = (np.ravel(x).astype(np.uint32) for x in np.broadcast_arrays(pixel, sample, seed))
    rows = [np.resize(x, -(-len(p) // 40_000) * 40_000).reshape(-1, 40_000) for x in (p, s, k)]
    parts = [np.stack(NUMBERS[name](Stream(*row, np.uint32(spp)), np.uint32(block))) for row in zip(*rows, strict=True)]
    return np.concatenate(parts, 1)[:, : len(p)]


NUMBERS = {name: jax.jit(jax.vmap(f, (AXES, None))) for name, f in SAMPLERS.items()}


def pcg4d(v):
    """Jarzynski & Olano's (2020) listing, in NumPy."""
    x, y, z, w = (a.astype(np.uint32) * np.uint32(1664525) + np.uint32(1013904223) for a in v)
    for turn in range(2):
        x, y, z, w = (a ^ (a >> np.uint32(16)) for a in (x, y, z, w)) if turn else (x, y, z, w)
        x = x + y * w
        y = y + z * x
        z = z + x * y
        w = w + y * z
    return np.stack([x, y, z, w])


@pytest.mark.parametrize("n", [1000, 40_000])
def test_independent_is_pcg4d(n):
    i = np.arange(n)
    v = np.broadcast_arrays(i % 997, i // 997, 5, 123456789)
    expected = (pcg4d(v) >> np.uint32(8)) * np.float32(2.0**-24)
    np.testing.assert_array_equal(numbers("independent", v[0], v[1], v[3], block=5), expected)


@pytest.mark.parametrize("name", SAMPLERS)
def test_same_numbers_however_asked(name):
    """All at once, alone, in another order, with a Python block, and in a native kernel: bitwise equal."""
    i = np.arange(40_000)
    whole = numbers(name, i // 64, i % 64, seed=9, block=3)
    assert whole.dtype == np.float32 and whole.shape == (4, 40_000)
    some = np.random.default_rng(0).permutation(i)[:777]
    np.testing.assert_array_equal(numbers(name, some // 64, some % 64, 9, block=3), whole[:, some])
    alone = SAMPLERS[name](Stream(*(jnp.uint32(x) for x in (123, 45, 9, 64))), 3)
    np.testing.assert_array_equal(alone, whole[:, 123 * 64 + 45])

    def packet(seed, p):
        lane = 100 * p.astype(jnp.uint32) + jnp.arange(100, dtype=jnp.uint32)
        stream = Stream(lane // 64, lane % 64, seed, jnp.uint32(64))
        return jnp.stack(jax.vmap(SAMPLERS[name], (Stream(0, 0, None, None), None))(stream, 3))

    kernel = jax.jit(lambda seed: map_packets(packet, seed, jnp.arange(400)))
    np.testing.assert_array_equal(np.concatenate(kernel(jnp.uint32(9)), 1), whole)


def test_strata_are_exact_for_every_spp():
    spp = np.arange(1, 2**20 + 1)
    nx, ny = (np.asarray(n, np.int64) for n in jax.jit(strata)(spp.astype(np.uint32)))
    assert np.all(nx * nx <= spp) and np.all((nx + 1) ** 2 > spp)
    np.testing.assert_array_equal(ny, -(-spp // nx))


def test_strata_of_no_or_too_many_samples():
    assert [int(n) for n in strata(jnp.uint32(0))] == [1, 1]
    assert [int(n) for n in strata(jnp.uint32(2**32 - 1))] == [1024, 1024]


@pytest.mark.parametrize("spp", [1, 2, 3, 7, 64, 100, 500, 1000])
def test_stratified_samples_have_cells_of_their_own(spp):
    nx = math.isqrt(spp)
    ny = -(-spp // nx)
    pixel, sample = np.divmod(np.arange(8 * spp), spp)
    x = numbers("stratified", pixel, sample, seed=3, spp=spp, block=2).astype(np.float64)
    for a, b in (x[:2], x[2:]):
        cells = (np.floor(a * nx + 1e-4) * ny + np.floor(b * ny + 1e-4)).reshape(8, spp)
        away = np.minimum(np.abs(a * nx - np.round(a * nx)), np.abs(b * ny - np.round(b * ny))) > 2e-4
        for row, sure in zip(cells, away.reshape(8, spp), strict=True):
            assert len(set(row[sure])) == sure.sum()


@pytest.mark.parametrize("k", range(11))
def test_sobol_is_a_net(k):
    """Any aligned run of 2^k samples has one point in each elementary interval of area 2^-k (Sobol' 1967)."""
    pixel, sample = np.divmod(np.arange(6 * 2**k), 2**k)
    first = np.array([0, 1, 2, 3, 77, 1021])[pixel] * 2**k
    x = numbers("sobol", pixel * 1001, first + sample, seed=pixel, block=4).astype(np.float64)
    for a, b in (x[:2], x[2:]):
        for bits in range(k + 1):
            interval = np.floor(a * 2**bits) * 2 ** (k - bits) + np.floor(b * 2 ** (k - bits))
            assert np.all(np.sort(interval.reshape(6, -1)) == np.arange(2**k))


def test_sobol_order_and_points_change_with_pixel_pair_and_seed():
    """The cell of a 16 × 16 grid that sample i falls in: equal for 1 in 256 of the samples, on average."""
    i = np.arange(256)
    base = numbers("sobol", 5, i, 7, 256, 1)
    others = [numbers("sobol", *args)[:2] for args in ((6, i, 7, 256, 1), (5, i, 8, 256, 1), (5, i, 7, 256, 2))]
    for other in [*others, base[2:]]:
        same = np.all(np.floor(16 * base[:2]) == np.floor(16 * other), 0)
        assert same.sum() < 10


def test_samples_beyond_the_grid_start_anew():
    """Samples 2²⁰ apart share no cell by rule: their streams are independent, and still below 1."""
    i = np.arange(4096)
    a = numbers("stratified", 0, i, spp=2**22)
    b = numbers("stratified", 0, i + 2**20, spp=2**22)
    assert np.all(np.floor(a[:2] * 1024) == np.floor(b[:2] * 1024), 0).sum() < 3
    assert b.max() < 1


@pytest.mark.parametrize("integer", [0, 1, 5, 2**31 - 1])
def test_seed_of_an_integer_is_itself_in_every_form(integer):
    forms = [
        integer,
        np.int64(integer),
        np.uint32(integer),
        jnp.int32(integer),
        jnp.uint32(integer),
        jax.random.key(integer),
        jax.random.PRNGKey(integer),
    ]
    for key in forms:
        seed = seed_from_key(key)
        assert seed.dtype == jnp.uint32 and seed.shape == () and seed == integer
        if isinstance(key, jax.Array):
            assert jax.jit(seed_from_key)(key) == integer


def test_seeds_of_wide_and_negative_integers_differ():
    keys = [0, 1, 2**32 - 1, 2**32, 2**32 + 1, 2**40, 2**63, 2**64 - 2, -2, -(2**63) + 1]
    keys += [(hi << 32) | lo for hi in range(1, 30) for lo in range(30)]
    seeds = {int(seed_from_key(k)) for k in keys}
    assert len(seeds) == len(set(k % 2**64 for k in keys))
    assert seed_from_key(-7) == seed_from_key(jnp.int32(-7)) == seed_from_key(2**64 - 7)
    with jax.enable_x64(True):
        for k in (-7, 2**40 + 3, -(2**63), 12):
            assert seed_from_key(jnp.int64(k)) == seed_from_key(k)


def test_seeds_of_split_keys_differ_also_under_vmap():
    keys = jax.random.split(jax.random.key(0), 1000)
    seeds = np.asarray(jax.jit(jax.vmap(seed_from_key))(keys))
    assert len(set(seeds.tolist())) == 1000
    raw = jax.vmap(seed_from_key)(jax.random.key_data(keys))
    np.testing.assert_array_equal(raw, seeds)


@pytest.mark.parametrize("key", [0.5, "0", None, jnp.float32(1), jnp.arange(3), jnp.zeros((2, 2), jnp.uint32)])
def test_seed_of_something_else_is_a_type_error(key):
    with pytest.raises(TypeError, match="^key: "):
        seed_from_key(key)


def test_seed_of_many_keys_or_too_wide_a_number():
    with pytest.raises(TypeError, match=r"^key: .*jax\.vmap"):
        seed_from_key(jax.random.split(jax.random.key(0), 3))
    for key in (2**64, -(2**63) - 1):
        with pytest.raises(ValueError, match="64 bits"):
            seed_from_key(key)
