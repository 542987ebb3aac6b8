"""What JAX and XLA may do to a renderer: cases X1-X6. Naive methods are shown to fail.

X1's naive figures are those of jax 0.10.2, which jaxrt excludes: they cannot be measured here.
"""

import ast
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrt
from jaxrt.cameras import view_of
from jaxrt.core.maths import FAR, dot, normalize
from jaxrt.core.records import Ray
from jaxrt.kernels.native import map_packets
from jaxrt.shapes.triangle import Triangles, corner_table, find_triangle
from jaxrt.transport.path import radiance, tables_of
from tests.lanes import lanes
from tests.meshes import aim_at_edges, aim_at_vertices, star_mesh
from tests.oracle import directions, triangle_distances
from tests.stability import naive

KERNELS = [p for p in sorted(Path(jaxrt.__file__).parent.rglob("*.py")) if "import jax.numpy" in p.read_text("utf-8")]
NUMBERS = tuple(jnp.float32(x) for x in (0.3, 0.6, 0.4, 0.7))  # any four in [0, 1)


@pytest.mark.parametrize("n", [32_769, 40_000])
def test_x1_reductions_over_many_rows(figures, n):
    rows = np.zeros((n, 3), np.float32)
    rows[:, 0] = np.arange(n)
    compiled = jax.jit(jax.vmap(lambda r: jnp.sum(jnp.matmul(jnp.eye(3), r) ** 2)))(rows)
    error = np.abs(np.asarray(compiled) / np.maximum(np.arange(n, dtype=float) ** 2, 1) - 1)[1:]
    naive = "jax 0.10.2: 18 % of rows wrong"
    figures("X1", "relative error of sums over rows of a matrix of 40 000 rows", naive=naive, ours=error, at_most=1e-5)
    d = np.random.default_rng(0).normal(size=(n, 3)).astype(np.float32)
    truth = d / np.linalg.norm(d.astype(float), axis=1, keepdims=True)
    assert np.abs(jax.jit(jax.vmap(lambda d: d / jnp.linalg.norm(d)))(d) - truth).max() <= 1e-5
    error = np.abs(jax.jit(jax.vmap(normalize))(d) - truth)
    naive = "jax 0.10.2: 18 % of directions wrong"
    figures("X1", "error of 40 000 directions made unit vectors", naive=naive, ours=error, at_most=1e-5)


def test_x1_triangles_times_rays(figures):
    rng = np.random.default_rng(1)
    corners = rng.uniform(-1, 1, (12, 3, 3)).astype(np.float32)
    o = rng.uniform(-1, 1, (4096, 3)).astype(np.float32)
    d = directions(o, rng.uniform(-1, 1, (4096, 3)))
    by_ray = jax.vmap(naive.moller_trumbore, (0, 0, None))
    t = np.asarray(jax.jit(jax.vmap(by_ray, (None, None, 0)))(o, d, corners))
    truth, least = triangle_distances(o, d, corners[:, None])
    sure = np.abs(least) > 1e-5  # rounding decides nearer to an edge
    wrong = ((t < FAR) != np.isfinite(truth))[sure].mean()
    stored = "jax 0.10.2: 33 % of pairs wrong"
    figures("X1", "wrong hits among 12 triangles × 4096 rays", naive=stored, ours=wrong, at_most=0)


@pytest.mark.parametrize("native", [True, False])
def test_x1_camera_rays_at_40000(room, native):
    frame = view_of(room.camera)
    x, y = (np.random.default_rng(k).uniform(0, 512, 40_000).astype(np.float32) for k in (0, 1))

    def one(x, y):
        return frame.ray((x, y), (x, y))

    ray = (lanes(one) if native else jax.jit(jax.vmap(one)))(x, y)
    right, up, forward = (np.asarray(v, float) for v in (frame.right, frame.up, frame.forward))
    d = np.outer(x - frame.width / 2, right) - np.outer(y - frame.height / 2, up) + forward
    assert np.abs(ray.direction - d / np.linalg.norm(d, axis=1, keepdims=True)).max() <= 1e-6


def edge(p, q):
    return p[0] * q[1] - p[1] * q[0]


def test_x2_naive_edge_function_is_not_antisymmetric():
    p, q = np.random.default_rng(2).normal(size=(2, 100_000, 2)).astype(np.float32)
    both = jax.jit(jax.vmap(lambda p, q: (edge(p, q), edge(q, p))))
    forth, back = both(p, q)
    assert np.mean(np.asarray(forth) != -np.asarray(back)) > 0.01


@jax.jit
def woop_leaks(mesh, o, d):
    """Return how many rays miss a closed mesh when edge functions are compared with 0 itself."""

    def missed(o, d):
        z = jnp.argmax(jnp.abs(d))
        x, y = (z + 1) % 3, (z + 2) % 3
        v = mesh - o.reshape(1, 1, 3)
        sx, sy = v[..., x] - d[x] / d[z] * v[..., z], v[..., y] - d[y] / d[z] * v[..., z]
        e = jnp.stack([sx[:, i] * sy[:, j] - sy[:, i] * sx[:, j] for i, j in ((2, 1), (0, 2), (1, 0))])
        ahead = jnp.sum(e * (v[..., z] / d[z]).T, 0) / jnp.sum(e, 0) > 0
        return ~jnp.any((jnp.all(e >= 0, 0) | jnp.all(e <= 0, 0)) & ahead)

    return jnp.sum(jax.vmap(missed)(o, d))


def rows_hit(mesh, o, d):
    """Return the row of the triangle that each ray hits; one program serves all meshes."""
    packets = -(-len(o) // 64)
    fill = np.arange(packets * 64) % len(o)
    return np.asarray(_rows(jnp.asarray(mesh), o[fill].reshape(-1, 64, 3), d[fill].reshape(-1, 64, 3)))[: len(o)]


@jax.jit
def _rows(mesh, o, d):
    def one_packet(operands, k):
        mesh, o, d = operands
        table = corner_table(mesh, jnp.zeros(mesh.shape[0], jnp.int32))
        return jax.vmap(lambda o, d: find_triangle(table, Ray(o, d), jnp.full((), FAR))[1])(o[k], d[k])

    return map_packets(one_packet, (mesh, o, d), jnp.arange(o.shape[0], dtype=jnp.int32)).reshape(-1)


@pytest.mark.parametrize("offset", [0, 1e3])
@pytest.mark.parametrize("scale", [1e-3, 1, 1e3])
def test_x2_no_ray_leaks_through_an_edge_or_vertex(figures, scale, offset):
    rng, n = np.random.default_rng(2), 50_000
    mesh = star_mesh(rng, 8, scale, offset)
    aim = np.concatenate([aim_at_edges(rng, mesh, n), aim_at_vertices(rng, mesh, n)])
    o = np.full((2 * n, 3), offset, np.float32)
    d = directions(o, aim)
    naive = woop_leaks(mesh, o[:20_000], d[:20_000]) / 20_000 if offset == 0 else None
    leaks = np.mean(rows_hit(mesh, o, d) < 0)
    figures(
        "X2", "share of 1e5 rays at edges and vertices that leak through a mesh", naive=naive, ours=leaks, at_most=0
    )


def products(source):
    """Return the lines of a module with a matrix product whose precision an accelerator may lower."""
    lowered = {"dot", "matmul", "einsum", "tensordot", "vdot", "inner", "dot_general"}
    tree, lines = ast.parse(source), []
    full = {
        id(n.func)
        for n in ast.walk(tree)
        if isinstance(n, ast.Call) and "precision=lax.Precision.HIGHEST" in ast.unparse(n)
    }
    for node in ast.walk(tree):
        operator = isinstance(node, ast.BinOp | ast.AugAssign) and isinstance(node.op, ast.MatMult)
        called = isinstance(node, ast.Attribute) and node.attr in lowered
        of_jax = called and isinstance(node.value, ast.Name | ast.Attribute) and ast.unparse(node.value) != "np"
        if operator or (of_jax and id(node) not in full):
            lines.append(node.lineno)
    return lines


def test_x3_naive_products_are_noticed():
    for line in ("a @ b", "a @= b", "jnp.dot(a, b)", "jnp.einsum('i,i', a, b)", "jax.numpy.matmul(a, b)"):
        assert products(line) == [1]
    assert products("jnp.matmul(a, b, precision=lax.Precision.HIGHEST)") == []
    assert products("dot(a, b)") == [] and products("@pytree\nclass A: pass") == []


@pytest.mark.parametrize("path", KERNELS, ids=lambda p: p.name)
def test_x3_kernels_hold_no_matrix_product(path):
    assert products(path.read_text(encoding="utf-8")) == []


def ten_bits(x):
    """Return float32 numbers as a TF32 unit reads them: rounded to 10 bits of mantissa."""
    return ((x.view(np.int32) + 0x1000) & ~0x1FFF).view(np.float32)


def test_x3_products_of_ten_bits(figures):
    """What an accelerator may make of a matrix product, emulated: its operands lose 13 bits."""
    a, b = np.random.default_rng(3).normal(size=(2, 40_000, 3)).astype(np.float32)
    truth = (a.astype(float) * b).sum(1)
    size = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
    naive = np.abs((ten_bits(a).astype(float) * ten_bits(b)).sum(1) - truth) / size
    error = np.abs(np.asarray(jax.jit(jax.vmap(dot))(a, b)) - truth) / size
    figures(
        "X3",
        "error of a·b of unit vectors; naive: as a product in TF32, emulated",
        naive=naive,
        ours=error,
        at_most=1e-5,
    )
    lines = sum(len(products(path.read_text(encoding="utf-8"))) for path in KERNELS)
    naive = len(products("a @ b"))
    figures("X3", "matrix products in kernels whose precision may be lowered", naive=naive, ours=lines, at_most=0)


def white_room(materials, **more):
    """Return a scene: a camera in a sphere of the first material."""
    return jaxrt.build(
        {
            "camera": {"position": [0.0, 0.0, 0.0], "width": 4, "height": 4},
            "materials": materials,
            "spheres": [{"center": [0.0, 0.0, 0.0], "radius": 1.0, "material": "m0"}],
            "lights": [{"position": [0.0, 0.2, 0.0], "intensity": 1.0}],
            **more,
        }
    )


def diffuse(n, albedo=0.5):
    return {f"m{k}": {"type": "diffuse", "albedo": [albedo] * 3} for k in range(n)}


def test_x4_tiny_throughput_stays_finite(figures):
    tenth = jax.jit(lambda k: 0.1**k * 1e-3)(jnp.arange(46.0))
    assert np.isfinite(tenth).all() and tenth[-1] == 0  # what XLA flushes must not come back as 1/0
    scene = white_room(diffuse(1))

    def seen(albedo):
        materials = replace(scene.materials, diffuse=replace(scene.materials.diffuse, albedo=albedo))
        tables = tables_of(replace(scene, materials=materials))
        ray = Ray(jnp.zeros(3), jnp.asarray([0.0, 0.0, -1.0]))
        return radiance(tables, ray, lambda k: NUMBERS, 45, unroll=False)

    albedo = np.float32([10.0**-k for k in range(46)] + [0.0, 1.0])
    both = lanes(lambda a: (seen(a), jax.jvp(seen, (a,), (jnp.ones(3),))[1]), packet=48)
    value, slope = both(np.repeat(albedo[:, None], 3, 1))
    assert np.all(value >= 0)
    bad, naive = (np.count_nonzero(~np.isfinite(x)) for x in ((value, slope), 1 / tenth))
    figures(
        "X4",
        "numbers not finite at throughputs of 1 to 1e-45; naive: their reciprocals",
        naive=naive,
        ours=bad,
        at_most=0,
    )
    assert np.all(value[-2] == 0) and np.all(value[1] > 0)


def naive_reads():
    """Return what an array of three gives in rows −1 and 7: its last number, whose derivative drops the second read."""
    albedo = jnp.asarray([0.1, 0.2, 0.3])
    row = jnp.asarray([-1, 7])
    assert np.allclose(jax.grad(lambda a: jnp.sum(a[row]))(albedo), [0, 0, 1])
    return albedo[row]


@pytest.mark.parametrize("n", [1, 2, 7])
def test_x5_misses_are_black_whatever_the_materials(figures, n):
    ball = [{"center": [0.0, 0.0, -3.0], "radius": 1.0, "material": f"m{n - 1}"}]
    # The others are where no ray goes: of a material that nothing is made of there is nothing to read
    ball += [{"center": [100.0 + 3 * i, 50.0, -20.0], "radius": 1.0, "material": f"m{i}"} for i in range(n - 1)]
    scene = white_room(diffuse(n, 1.0), spheres=ball)
    o = np.zeros((8, 3), np.float32)
    d = directions(o, [[0, 0, -1], [0, 0, 1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [1, 1, 1], [2, 0, -3]])

    def seen(albedo, o, d):
        materials = replace(scene.materials, diffuse=replace(scene.materials.diffuse, albedo=albedo))
        return radiance(tables_of(replace(scene, materials=materials)), Ray(o, d), lambda k: NUMBERS, 1, unroll=True)

    def value_and_slopes(o, d):
        albedo = jnp.ones((n, 3))
        return seen(albedo, o, d), jax.jacfwd(seen)(albedo, o, d)

    value, slopes = lanes(value_and_slopes, packet=8)(o, d)
    assert np.all(value[0] > 0) and np.all(slopes[0, :, : n - 1] == 0)
    wrong = max(np.abs(value[1:]).max(), np.abs(slopes[1:]).max())
    naive = naive_reads()
    figures("X5", "what a ray that hits nothing reads of materials, or derives", naive=naive, ours=wrong, at_most=0)
    assert np.allclose(np.diag(slopes[0, :, n - 1]), value[0], rtol=1e-5)


def distances_with_nan():
    """Return the distances of three triangles, the second of which is NaN."""
    return jnp.asarray([[1, 2, 3], [jnp.nan] * 3, [3, 2, 1]])


def test_x6_nan_triangle_changes_no_pixel(figures):
    rng = np.random.default_rng(6)
    materials = diffuse(1)
    corners = rng.uniform(-1, 1, (6, 3, 3))
    triangles = [{"vertices": (v * 0.9 - [0, 0, 1.5]).tolist(), "material": "m0"} for v in corners]
    room = {"center": [0.0, 0.0, 0.0], "radius": 9.0, "material": "m0"}
    scene = white_room(materials, triangles=triangles, spheres=[room])
    extra = np.float32([[np.nan] * 3, [0, 0, np.inf], [1, 0, 0], [0, 0, 40], [1, 0, 40], [0, 1, 40]])
    faces = np.asarray(scene.triangles.faces)

    def picture(face):
        more = replace(
            scene.triangles,
            vertices=jnp.concatenate([scene.triangles.vertices, extra]),
            faces=jnp.concatenate([faces[:3], np.int32([face]), faces[3:]]),
            material=jnp.zeros(len(faces) + 1, jnp.int32),
        )
        return np.asarray(jaxrt.render(replace(scene, triangles=more), 3, spp=8, max_depth=3))

    v = len(scene.triangles.vertices)
    assert isinstance(scene.triangles, Triangles)
    unseen = picture([v + 3, v + 4, v + 5])  # outside the room, so that both pictures come from one program
    faces_of_nan = ([v, v, v], [v, v + 3, v + 4], [v + 1, v + 2, v], [v + 2, v + 1, v + 3])
    changed = [np.mean(picture(face) != unseen) for face in faces_of_nan]
    assert unseen.std() > 0
    naive = np.mean(jnp.argmin(distances_with_nan(), axis=0) == 1)
    figures(
        "X6",
        "pixels that a NaN triangle changes; naive: share of argmins that take it",
        naive=naive,
        ours=changed,
        at_most=0,
    )
