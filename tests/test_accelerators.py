"""What accelerators compute, many lanes at once, computed here: the same as CPUs' narrow packets."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from importlib import import_module

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrt
from benchmarks.ladder import equations
from jaxrt import boundary
from jaxrt.boundary import guiding
from jaxrt.core.maths import FAR
from jaxrt.core.records import Ray
from jaxrt.kernels.gather import FEW, take
from jaxrt.kernels.native import map_packets, map_together
from jaxrt.render import wide_tile
from jaxrt.shapes.sphere import find_sphere, occluded_by_sphere, sphere_table
from jaxrt.shapes.triangle import corner_table, find_triangle, occluded_by_triangle, triangle_table
from jaxrt.textures.recording import add_marks
from jaxrt.transport import film
from tests.meshes import icosphere
from tests.oracle import unit_vectors
from tests.test_traverse import triangles_of

N = 40_000
render_module = import_module("jaxrt.render")  # whose function hides it in the package


@pytest.fixture
def wide(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Let edges be sampled as on an accelerator."""
    monkeypatch.setattr(guiding, "want_wide", lambda devices: True)
    yield


def both(f, operands, n):
    """Return f(operands, k) for k < n, from narrow packets and from wide ones."""

    def packet(operands, k):
        return jax.vmap(partial(f, operands))(k * 64 + jnp.arange(64, dtype=jnp.int32))

    packets = jnp.arange(n // 64, dtype=jnp.int32)
    narrow = jax.jit(lambda operands: map_packets(packet, operands, packets))(operands)
    # Not all at once, and the last turn is not full
    wide = jax.jit(lambda operands: map_together(packet, operands, packets, 100))(operands)
    return [jax.tree.map(lambda x: np.asarray(x).reshape(n, *x.shape[2:]), each) for each in (narrow, wide)]


def rays(rng):
    """Return origins, directions (N, 3) and reaches (N,), of which some are dead."""
    reach = rng.uniform(-1, 9, N).astype(np.float32)
    reach[::3] = FAR
    return rng.normal(0, 3, (N, 3)).astype(np.float32), unit_vectors(rng, N).astype(np.float32), reach


def test_the_nearest_of_few_shapes():
    rng, n = np.random.default_rng(11), 11
    center = rng.normal(0, 3, (n, 3)).astype(np.float32)
    center[n // 2 :] = center[: n - n // 2]  # several at the same place: the first is hit
    built = jaxrt.build(
        {
            "camera": {"position": [0, 0, 9], "target": [0, 0, 0], "fov": 40, "width": 2, "height": 2},
            "environment": {"radiance": [1, 1, 1]},
            "materials": {"m": {"type": "diffuse", "albedo": [1, 1, 1]}},
            "spheres": [{"center": c.tolist(), "radius": 1.0, "material": "m"} for c in center],
        }
    )
    corners = rng.normal(0, 2, (n, 3, 3)).astype(np.float32)
    corners[n // 2 :] = corners[: n - n // 2]
    tables = sphere_table(built.spheres), corner_table(jnp.asarray(corners), jnp.zeros(n, jnp.int32))

    def search(operands, k):
        (balls, faces), (o, d, reach) = operands
        ray, reach = Ray(o[k], d[k]), reach[k]
        near = find_sphere(balls, ray, reach), find_triangle(faces, ray, reach)
        return near, occluded_by_sphere(balls, ray, reach, None), occluded_by_triangle(faces, ray, reach)

    narrow, wide = both(search, (tables, rays(rng)), N)
    assert np.mean(narrow[0][0][1] >= 0) > 0 and np.mean(narrow[0][1][1] >= 0) > 0
    assert 0 < np.mean(narrow[1]) < 1 and 0 < np.mean(narrow[2]) < 1
    jax.tree.map(np.testing.assert_array_equal, narrow, wide)


def test_a_native_search_is_not_taken_for_a_wide_one():
    """JAX keeps what it has traced of a function, and does not know in what kernel."""
    ball = triangles_of(*icosphere(2))
    o, d = jnp.ones((2, 64, 3), jnp.float32)

    def packet(operands, _):
        table, o, d = operands
        return jax.vmap(lambda o, d: find_triangle(table, Ray(o, d), jnp.float32(9)))(o, d)

    def names(mapped):
        program = jax.make_jaxpr(lambda ball: mapped(packet, (triangle_table(ball), o, d), jnp.arange(2)))(ball)
        return [each.params.get("name") for each in equations(program.jaxpr)]

    wide, narrow = names(partial(map_together, together=2)), names(map_packets)
    assert "_together" in narrow and "_together" not in wide


@pytest.mark.parametrize("n", [5, 8, 11])
def test_turns_of_packets_share_one_program(n):
    """However many packets there are: what is left to the last turn is not compiled anew."""
    program = jax.make_jaxpr(lambda x: map_together(lambda x, k: jnp.sin(k.astype(x.dtype) * x), x, jnp.arange(n), 4))(
        jnp.float32(1)
    )
    assert program.out_avals[0].shape == (n,)
    assert [each.primitive.name for each in equations(program.jaxpr)].count("sin") == 1


@pytest.mark.parametrize("n", [1, FEW, FEW + 1])
def test_sums_of_rows(n):
    """Rows of a table are added up in whatever order, outside of kernels and in wide ones, to rounding."""
    rng = np.random.default_rng(n)
    table, i = rng.normal(0, 1, (n, 3)).astype(np.float32), rng.integers(0, n, N).astype(np.int32)
    weights = rng.normal(0, 1, (N, 3)).astype(np.float32)

    def slopes(table, _=None):
        return jax.grad(lambda table: jnp.sum(take(table, i) * weights))(table)

    exact, count = np.zeros((n, 3)), np.bincount(i, minlength=n).max()
    np.add.at(exact, i, weights.astype(float))
    found = jax.jit(slopes)(table), jax.jit(lambda t: map_together(slopes, t, jnp.zeros(1, jnp.int32), 1))(table)[0]
    for sums in found:
        # Each of `count` roundings is of a number of about √count: together count u/√3, of which this is 17 times
        np.testing.assert_allclose(sums, exact, rtol=0, atol=10 * max(count, 9) * 2.0**-24)


def test_sums_of_texels():
    rng = np.random.default_rng(3)
    rows, weights, change = rng.integers(0, 9000, (N, 4)), rng.uniform(0, 1, (N, 4)), rng.normal(0, 1, (N, 3))
    marks = np.concatenate([rows // 4096, rows % 4096, weights, change], 1).astype(np.float32)
    sums = jax.jit(add_marks)(jnp.zeros((9000, 6)), marks)
    exact = np.zeros((9000, 3))
    np.add.at(exact, rows.ravel(), (marks[:, 8:12, None] * marks[:, None, 12:]).astype(float).reshape(-1, 3))
    np.testing.assert_allclose(sums[:, :3] - sums[:, 3:], exact, rtol=0, atol=2e-5)


@pytest.mark.slow
@pytest.mark.usefixtures("quick_compilation")
def test_edges(room, wide):
    """Samples of all kinds are those of narrow packets, but for choices that rounding turns: at most 5 % of a kind.

    1.95 % is the most that was seen, on jax 0.12.
    """
    seed, device = jnp.uint32(1), tuple(jax.devices()[:1])
    plan = boundary.Plan(512, 3, True, True, device)
    found = jax.jit(lambda scene: boundary.sample_edges.__wrapped__(scene, seed, plan))(room)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(guiding, "want_wide", lambda devices: False)
        expected = jax.jit(lambda scene: boundary.sample_edges.__wrapped__(scene, seed, plan))(room)
    assert len(found) == len(expected) > 3
    for ours, theirs in zip(found, expected, strict=True):
        scale = np.abs(theirs.weight).max()
        same = np.all(np.abs(ours.weight - theirs.weight) <= 1e-4 * scale, axis=tuple(range(1, ours.weight.ndim)))
        assert scale > 0
        assert np.mean(same) > 0.95


@pytest.mark.slow
def test_walks_through_a_tree():
    """All rays side by side find what each finds alone, to the bit: dead ones and packets of a batch included."""
    rng = np.random.default_rng(5)
    vertices, faces = icosphere(3)
    table = triangle_table(triangles_of(2 * vertices * rng.uniform(0.8, 1.2, (len(vertices), 1)), faces))

    def search(operands, k):
        table, (o, d, reach) = operands
        ray, reach = Ray(o[k], d[k]), reach[k]
        return find_triangle(table, ray, reach), occluded_by_triangle(table, ray, reach)

    narrow, wide = both(search, (table, rays(rng)), N)
    assert table.tree is not None and 0.1 < np.mean(narrow[0][1] >= 0) < 0.9
    jax.tree.map(np.testing.assert_array_equal, narrow, wide)


@pytest.mark.parametrize(
    ("size", "devices", "tile"),
    [
        ((512, 512), 1, (512, 512)),
        ((600, 400), 1, (300, 400)),
        ((600, 400), 4, (300, 200)),
        ((30, 1), 1, (30, 1)),
        ((300_000, 1), 1, (150_000, 1)),
        ((30, 1), 8, (4, 1)),
    ],
)
def test_packets_make_up_a_picture(size, devices, tile):
    assert wide_tile(*size, devices) == tile


@pytest.mark.usefixtures("quick_compilation")
def test_windows_and_lists(monkeypatch):
    """As on an accelerator: parts of the picture of narrow packets."""
    small = jaxrt.load_scene("scenes/ball_on_floor.toml")
    small = replace(small, camera=replace(small.camera, width=40, height=24))
    options = dict(spp=2, max_depth=2, devices=jax.devices()[:1])
    expected = jaxrt.render(small, 0, **options)
    for module in (render_module, film):
        monkeypatch.setattr(module, "want_wide", lambda devices: True)
    window, pixels = (8, 4, 20, 12), np.array([[3, 2], [39, 23], [17, 9]])
    part = jaxrt.render(small, 0, window=window, **options)
    np.testing.assert_allclose(part, expected[4:16, 8:28], rtol=1e-5, atol=1e-6)
    chosen = jaxrt.render(small, 0, pixels=pixels, **options)
    np.testing.assert_allclose(chosen, expected[pixels[:, 1], pixels[:, 0]], rtol=1e-5, atol=1e-6)
