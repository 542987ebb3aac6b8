"""The native kernel: really there, once per program, and computing what plain JAX computes."""

import re
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array, lax

import jaxrt
from jaxrt.kernels.few import where_any, where_needed
from jaxrt.kernels.native import LARGE, fold_packets, in_stages, map_packets, once

pytestmark = pytest.mark.quick

TAG = 'xla_cpu_small_call="true"'


def weigh(operands: tuple[Array, Array], packet: Array) -> Array:
    scale, _ = operands
    lane = (jnp.arange(64, dtype=jnp.int32) + 64 * packet).astype(scale.dtype)
    total = once(lambda x: jnp.sin(x) + x)(lane * scale[0])
    return lax.fori_loop(0, 3, lambda _, t: t * scale[1] + 1, total)


OPERANDS = (jnp.array([0.25, 0.5], jnp.float32), jnp.arange(5, dtype=jnp.int32))


@pytest.mark.parametrize("packets", [1, 3, 625])  # 625 packets of 64 lanes: 40 000
def test_map_packets_equals_plain_code(packets: int) -> None:
    numbers = jnp.arange(packets, dtype=jnp.int32)
    native = jax.jit(lambda o, n: map_packets(weigh, o, n))(OPERANDS, numbers)
    x = np.arange(64 * packets, dtype=np.float64).reshape(packets, 64) * 0.25
    expected = ((np.sin(x) + x) / 8) + 1.75
    np.testing.assert_allclose(native, expected, rtol=2e-6)


@pytest.mark.parametrize("f", [lambda o, n: jnp.zeros(64), lambda o, n: o[0][:1] * n.astype(jnp.float32)])
def test_unused_operands_are_harmless(f: Callable[..., Array]) -> None:
    # jaxlib 0.10.1 aborts the process when a tagged call's operand turns out to be unused
    out = jax.jit(lambda o, n: map_packets(f, o, n))(OPERANDS, jnp.arange(2, dtype=jnp.int32))
    assert out.shape[0] == 2


@pytest.mark.parametrize("needed", [[], [0], [3, 4, 63], range(64)])
def test_what_few_lanes_need_is_computed_for_those(needed: list[int]) -> None:
    wanted = np.isin(np.arange(64), needed)

    def shared(scale: Array, x: tuple[Array, Array]) -> tuple[Array, Array]:
        return scale * x[0] + x[1][0], x[1] * lax.while_loop(lambda y: y < 3, lambda y: 2 * y, x[0] + 1)

    def packet(operands: tuple[Array, Array], packet: Array) -> tuple[Array, Array]:
        lane = jnp.arange(64, dtype=jnp.float32) * packet.astype(jnp.float32)
        rows = lane, jnp.stack([lane, -lane], -1)
        return jax.vmap(lambda few, x: where_needed(shared, few, operands[0][0], x))(operands[1], rows)

    operands = jnp.array([2.0]), jnp.asarray(wanted)
    program = jax.jit(lambda o, n: map_packets(packet, o, n))
    rows, pairs = program(operands, jnp.arange(3, dtype=jnp.int32))
    lane = np.arange(64) * np.arange(3)[:, None]
    above = (lane + 1) * 2.0 ** np.maximum(np.ceil(np.log2(3 / (lane + 1))), 0)
    np.testing.assert_array_equal(rows, np.where(wanted, 3 * lane, 0))
    np.testing.assert_array_equal(pairs, np.where(wanted, above * lane, 0)[..., None] * [1, -1])
    # By as many turns of a loop as lanes need it
    assert "dynamic_update_slice" in str(program.trace(operands, jnp.arange(3, dtype=jnp.int32)).jaxpr)


def test_packets_of_which_no_lane_needs_it_compute_something_else() -> None:
    needed = np.zeros((3, 64), bool)
    needed[1, 7] = True

    def packet(operands: tuple[Array, Array], packet: Array) -> Array:
        factor, needed = operands
        lane = jnp.arange(64, dtype=jnp.float32)
        return jax.vmap(lambda wanted, x: where_any(wanted, times, less, factor, x))(needed[packet], lane)

    def times(factor: Array, x: Array) -> Array:
        return factor[0] * x

    def less(_: Array, x: Array) -> Array:
        return -x

    operands = jnp.array([2.0]), jnp.asarray(needed)
    found = jax.jit(lambda o, n: map_packets(packet, o, n))(operands, jnp.arange(3, dtype=jnp.int32))
    # The second packet's lanes all do what one of them needs
    np.testing.assert_array_equal(found, np.arange(64) * np.array([-1, 2, -1])[:, None])


def test_empty_operands_beside_large_ones_are_harmless() -> None:
    large, empty = jnp.ones(LARGE + 1), jnp.zeros((3, 0))

    def lane(operands: tuple[tuple[Array, Array]], packet: Array) -> Array:
        ((large, empty),) = operands
        return large[packet] + jnp.sum(empty)

    out = jax.jit(lambda o, n: map_packets(lane, o, n))(((large, empty),), jnp.arange(2, dtype=jnp.int32))
    np.testing.assert_array_equal(out, 1)


def entry(text: str) -> str:
    return text[text.index("\nENTRY ") :]


def test_operands_that_are_constants_are_harmless() -> None:
    # jaxlib 0.10.1 aborts too when it moves a constant operand into the call
    numbers = jnp.arange(4, dtype=jnp.int32)
    zeros = jnp.zeros(8)
    summed = jax.jit(
        lambda x: fold_packets(lambda o, n, total: total + o[0] * n.astype(o[0].dtype), (x, zeros), zeros, numbers)
    )
    np.testing.assert_array_equal(summed(jnp.ones(8)), jnp.full(8, 6.0))
    drawn = jax.jit(lambda: map_packets(lambda o, n: o[0] * n.astype(o[0].dtype) + o[1], (zeros, zeros), numbers))
    np.testing.assert_array_equal(drawn(), jnp.zeros((4, 8)))


def test_a_batch_shares_what_it_does_not_enter() -> None:
    """A batch of tangents must not make a batch of the paths: that costs a render for each."""

    def f(operands: tuple[Array, Array], packet: Array) -> Array:
        return jnp.sin(operands[0] + packet.astype(jnp.float32)) * operands[1]

    numbers = jnp.arange(3, dtype=jnp.int32)
    many = jax.vmap(lambda x, y: map_packets(f, (x, y), numbers), in_axes=(None, 0))
    x, y = jnp.arange(8.0), jnp.arange(40.0).reshape(5, 8)
    program = str(jax.make_jaxpr(many)(x, y))
    assert re.findall(r":f32(\S*) = sin ", program) == ["[8]"], program
    expected = [jax.vmap(lambda n, row=row: f((x, row), n))(numbers) for row in y]
    np.testing.assert_allclose(jax.jit(many)(x, y), jnp.stack(expected), rtol=1e-6)


def test_large_leaves_are_not_joined_with_others() -> None:
    """Joining copies: with a mesh of a million faces that took as long as a twentieth of the picture."""
    large, small = jnp.arange(LARGE + 1.0), jnp.arange(3.0)

    def f(operands: tuple[dict[str, Array], Array], packet: Array) -> Array:
        tables, row = operands
        return tables["large"][packet] * tables["x"] + tables["y"] + row

    numbers = jnp.array([LARGE - 1, LARGE], jnp.int32)
    run = jax.jit(lambda x, y: map_packets(f, ({"large": x, "x": y, "y": y}, y), numbers))
    program = str(jax.make_jaxpr(run)(large, small))
    assert re.findall(r":f32(\S*) = concatenate", program) == ["[6]"], program
    expected = np.outer([LARGE - 1, LARGE], np.arange(3)) + 2 * np.arange(3)
    np.testing.assert_array_equal(run(large, small), expected)


@pytest.mark.parametrize("unroll", [False, True])
def test_a_render_is_one_native_kernel(room: jaxrt.Scene, unroll: bool) -> None:
    def draw(scene: jaxrt.Scene) -> Array:
        return jaxrt.render(scene, 0, spp=2, max_depth=2, unroll=unroll, devices=jax.devices()[:1])

    text = jax.jit(draw).lower(room).compile().as_text()
    calls = [line for line in entry(text).splitlines() if " call(" in line]
    assert sum(TAG in line for line in calls) == 1, calls
    # All loops, over packets, samples, events and spheres, are inside it
    assert " while(" not in entry(text)


def test_each_device_runs_one_native_kernel(room: jaxrt.Scene) -> None:
    assert len(jax.devices()) == 2

    def draw(scene: jaxrt.Scene) -> Array:
        return jaxrt.render(scene, 0, spp=2, max_depth=2, devices=jax.devices())

    text = jax.jit(draw).lower(room).compile().as_text()
    assert sum(TAG in line for line in entry(text).splitlines() if " call(" in line) == 1
    assert re.search(r"num_partitions=2", text)


def test_tags_can_be_left_out() -> None:
    numbers = jnp.arange(3, dtype=jnp.int32)
    native, wide = (jax.jit(lambda n, tag=tag: map_packets(weigh, OPERANDS, n, tag)) for tag in (True, False))
    # Before compilation: XLA gives small loops the tag on its own account
    assert "xla_cpu_small_call" in native.lower(numbers).as_text()
    assert "xla_cpu_small_call" not in wide.lower(numbers).as_text()
    np.testing.assert_allclose(wide(numbers), native(numbers), rtol=1e-6)


def test_a_stage_outside_a_kernel_is_plain_code() -> None:
    assert "xla_cpu_small_call" not in jax.jit(once(jnp.sin)).lower(jnp.ones(3)).as_text()


@pytest.mark.parametrize("inner", [False, True], ids=["equation by equation", "in a jit of its own"])
def test_stages_of_any_length_are_native(inner: bool) -> None:
    """XLA divides a dear operation among threads, which no native kernel can: long stages did not compile."""

    def lobes(x: Array) -> Array:
        return jnp.asarray(sum(i * jnp.exp(-i * (x - i) ** 2) for i in range(1, 400)))

    f = jax.jit(lobes) if inner else lobes

    def packet(x: Array, i: Array) -> Array:
        return jax.vmap(in_stages(lambda x: f(x) * x))(x + i.astype(x.dtype))

    x = jnp.linspace(0, 3, 128)
    found = jax.jit(lambda x: map_packets(packet, x, jnp.arange(2, dtype=jnp.int32)))(x)
    want = np.stack([np.asarray(x, float), np.asarray(x, float) + 1])
    want = want * sum(i * np.exp(-i * (want - i) ** 2) for i in range(1, 400))
    np.testing.assert_allclose(found, want, rtol=2e-3, atol=1e-4)


def test_stages_of_vectors_are_native() -> None:
    """They cost as many times the numbers that they have: of so few operations, each on three, none compiled."""

    def waves(x: Array) -> Array:
        v = x * jnp.arange(1, 4, dtype=x.dtype)
        for _ in range(160):
            v = jnp.sin(v) + v
        return v

    def packet(x: Array, i: Array) -> Array:
        return jax.vmap(in_stages(waves))(x + i.astype(x.dtype))

    x = jnp.linspace(0.1, 0.9, 128)
    found = jax.jit(lambda x: map_packets(packet, x, jnp.arange(2, dtype=jnp.int32)))(x)
    # Odd multiples of π draw on both sides
    start = np.stack([np.asarray(x, float), np.asarray(x, float) + 1])[..., None] * [1, 2, 3]
    np.testing.assert_allclose(found, np.pi * (2 * (start // (2 * np.pi)) + 1), rtol=1e-5)


def test_stages_backwards_are_stages() -> None:
    """What a stage's transpose computes is kept, too, and right."""

    def back(x: Array, i: Array) -> Array:
        y, pull = jax.vjp(jax.vmap(once(lambda x: jnp.sin(x) * x)), x + i.astype(x.dtype))
        change: Array = pull(jnp.ones_like(y))[0]
        return y + change

    x = jnp.linspace(0, 3, 128)
    program = jax.jit(lambda x: map_packets(back, x, jnp.arange(2, dtype=jnp.int32)))
    want = np.stack([np.asarray(x, float), np.asarray(x, float) + 1])
    want = np.sin(want) * want + np.cos(want) * want + np.sin(want)
    np.testing.assert_allclose(program(x), want, rtol=1e-5, atol=1e-5)
    # Before compilation: the kernel, the stage and its transpose
    assert program.lower(x).as_text().count("xla_cpu_small_call") == 3
