"""The searches of a mesh, through its tree and face by face, of one shape for all meshes: compiled once."""

from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxrt.core.records import Ray
from jaxrt.kernels.native import map_packets
from jaxrt.shapes import Topology
from jaxrt.shapes.search.bvh import exact_topology
from jaxrt.shapes.triangle import Triangles, find_triangle, occluded_by_triangle, triangle_table
from tests.oracle import unit_vectors

U = 2.0**-24
NODES, LEAVES, DEPTH = 512, 1300, 20
PACKET, RAYS = 64, 102_400


def padded(vertices, faces):
    """Return triangles whose arrays have the same shapes for each mesh of at most 1300 faces."""
    tree = exact_topology(vertices, faces, least=1)
    n, m, v = len(tree.children), len(tree.faces), len(vertices)
    assert n <= NODES and m <= LEAVES and tree.depth <= DEPTH and v <= 3 * LEAVES
    nodes, leaves = ((0, NODES - n), (0, 0)), ((0, LEAVES - m), (0, 0))
    same = Topology(
        *(jnp.pad(x, nodes) for x in (tree.children, tree.first, tree.last)),
        faces=jnp.pad(tree.faces, leaves),
        depth=DEPTH,
    )
    vertices = jnp.asarray(np.pad(vertices, ((0, 3 * LEAVES - v), (0, 0))), jnp.float32)
    faces = jnp.asarray(np.pad(faces, ((0, LEAVES - len(faces)), (0, 0))), jnp.int32)
    return Triangles(vertices, faces, faces[:, 0] * 0, same)


@jax.jit
def _search(triangles, rays, count):
    def packet(operands, k):
        table, rays, count = operands
        rows = [lax.dynamic_slice_in_dim(x, k * PACKET, PACKET) for x in rays]

        def one(o, d, farthest):
            ray = Ray(o, d)
            return *find_triangle(table, ray, farthest), occluded_by_triangle(table, ray, farthest)

        nothing = rows[2], jnp.full(PACKET, -1, jnp.int32), jnp.zeros(PACKET, bool)
        return lax.cond(k < count, jax.vmap(one), lambda *_: nothing, *rows)

    packets = jnp.arange(RAYS // PACKET, dtype=jnp.int32)
    found = map_packets(packet, (triangle_table(triangles), rays, count), packets)
    return [x.reshape(-1) for x in found]


def search(triangles, o, d, farthest):
    """Return (distance, face, whether anything is hit) of rays (n, 3), n a multiple of 64 up to 102 400."""
    n = len(farthest)
    rays = [np.concatenate([x, np.zeros((RAYS - n, *x.shape[1:]), x.dtype)]) for x in map(np.asarray, (o, d, farthest))]
    found = _search(triangles, [jnp.asarray(x, jnp.float32) for x in rays], jnp.int32(n // PACKET))
    return [np.asarray(x)[:n] for x in found]


def rays_at(rng, vertices, faces, n):
    """Return (origins, directions) of n rays of all kinds around and on a mesh, float32 unit vectors.

    A quarter each: random; along the 26 directions with ±0 components, from vertices, edges and faces; grazing, in
    the planes of faces; narrow bundles of 64, as packets meet them.
    """
    q = n // 4
    low, high = vertices.min(0), vertices.max(0)
    size = max((high - low).max(), 1e-3)
    corners = vertices[faces]

    def on_faces(n, sparse):
        weights = rng.dirichlet([1, 1, 1], n)
        if sparse:  # also on edges and vertices
            weights = np.where(rng.uniform(size=(n, 3)) < 0.4, 1e-300, weights + 1e-9)
            weights /= weights.sum(1, keepdims=True)
        face = rng.integers(0, len(faces), n)
        return (corners[face] * weights[:, :, None]).sum(1), face

    target, _ = on_faces(q, True)
    o = [target - size * rng.uniform(0.1, 2, (q, 1)) * unit_vectors(rng, q)]
    d = [target - o[0] + 0.05 * size * rng.normal(size=(q, 3)) * (rng.uniform(size=(q, 1)) < 0.5)]
    grid = np.array([x for x in np.ndindex(3, 3, 3) if x != (1, 1, 1)], float) - 1
    grid = np.where(grid == 0, np.where(rng.uniform(size=grid.shape) < 0.5, -0.0, 0.0), grid)
    d.append(grid[rng.integers(0, 26, q)])
    o.append(on_faces(q, True)[0] - d[1] * size * rng.choice([0, 0, 0.5, 1], (q, 1)))
    target, face = on_faces(q, False)
    normal = np.cross(corners[face, 1] - corners[face, 0], corners[face, 2] - corners[face, 0])
    d.append(np.cross(normal, unit_vectors(rng, q)) + 1e-4 * normal * rng.choice([-1, 0, 1], (q, 1)))
    d[2] = np.where(np.linalg.norm(d[2], axis=1, keepdims=True) > 0, d[2], [[1.0, 0, 0]])
    o.append(target - size * d[2] / np.linalg.norm(d[2], axis=1, keepdims=True))
    eye = np.repeat((low + high) / 2 + 1.5 * size * unit_vectors(rng, -(-q // 64)), 64, 0)[:q]
    target = np.repeat(on_faces(-(-q // 64), False)[0], 64, 0)[:q] + 0.05 * size * rng.uniform(-1, 1, (q, 3))
    o.append(eye)
    d.append(target - eye)
    o, d = np.concatenate(o), np.concatenate(d)
    d = np.where(np.abs(d).max(1, keepdims=True) > 0, d, [[0, 0, 1.0]])
    return o.astype(np.float32), (d / np.linalg.norm(d, axis=1, keepdims=True)).astype(np.float32)


class Rounding(NamedTuple):
    """What float32 leaves open about rays (n,) and one face for each: bounds derived, not fitted."""

    doubt: np.ndarray  # (n,) bool: whether the face is hit at all
    distance: np.ndarray  # (n,) of the distance, between two ways to round


def rounding_of(o, d, corners):
    """Return what is open about rays and faces (n, 3, 3), in long double.

    A sheared corner x = p_x − (d_x/d_z) p_z is wrong by r = 4u max|p|, so an edge function x₁y₂ − y₁x₂ in a box W·H by
    r(W + H) + 3uWH; what is below 4uWH counts as zero. So the test says nothing about functions below their sum, b, nor
    about a face whose box in x or y ends within r of the ray, nor about one that is behind the origin to rounding.
    The distance, Σeᵢzᵢ/Σeᵢ with z in a range Z, is wrong by 3bZ/|Σeᵢ| + 4u max|z|: twice that between two roundings.
    """
    o, d, v = (np.asarray(x, np.longdouble) for x in (o, d, corners))
    axis = np.argmax(np.abs(d), 1)[:, None]
    p = v - o[:, None]
    x, y, z = (
        np.take_along_axis(p, np.broadcast_to((axis[:, :, None] + k) % 3, (*p.shape[:2], 1)), 2)[..., 0]
        for k in (1, 2, 3)
    )
    dx, dy, dz = (np.take_along_axis(d, (axis + k) % 3, 1) for k in (1, 2, 3))
    x, y, z = x - dx / dz * z, y - dy / dz * z, z / dz
    e = np.stack([x[:, a] * y[:, b] - y[:, a] * x[:, b] for a, b in ((2, 1), (0, 2), (1, 0))], 1)
    r = 4 * U * np.abs(p).max((1, 2))
    wide, high = np.abs(x).max(1) + r, np.abs(y).max(1) + r
    bound = 7 * U * wide * high + r * (wide + high)
    beside = np.stack([f(a, 1) for a in (x, y) for f in (np.min, np.max)])
    depth, total, span = (e * z).sum(1), np.abs(e.sum(1)), np.ptp(z, axis=1)
    error = 3 * bound * span + 4 * U * np.abs(z).max(1) * np.maximum(total, bound)
    behind = (z.min(1) <= 0) & (np.abs(depth) <= 2 * bound * span + error)
    doubt = (np.abs(e) <= bound[:, None]).any(1) | (np.abs(beside) <= r).any(0) | behind
    return Rounding(doubt, 2 * error / np.maximum(np.maximum(total, bound), 1e-300))


def assert_same(triangles, o, d, farthest):
    """Assert that tree and loop find the same, but for what float32 leaves open; return the tree's faces.

    The same face at the same distance within its bound; or two faces whose distances are equal within theirs; or one
    that is in doubt. No exception is made, and the any-hit search agrees with the other on each side.
    """
    t, face, blocked = search(triangles, o, d, farthest)
    true_t, true_face, true_blocked = search(replace(triangles, bvh=None), o, d, farthest)
    assert np.array_equal(blocked, face >= 0) and np.array_equal(true_blocked, true_face >= 0)
    corners = np.asarray(triangles.vertices)[np.asarray(triangles.faces)]
    ours, loops = (rounding_of(o, d, corners[np.maximum(f, 0)]) for f in (face, true_face))
    hit, true_hit = face >= 0, true_face >= 0
    gap = np.abs(t.astype(np.longdouble) - true_t)
    same = (face == true_face) & (~hit | (gap <= ours.distance))
    tied = hit & true_hit & (gap <= ours.distance + loops.distance)
    # The nearer of the two is in doubt, or as far as the ray goes
    nearer_ours = hit & (~true_hit | (t <= true_t))
    nearer = np.where(nearer_ours, ours.doubt, loops.doubt)
    reach = np.where(nearer_ours, ours.distance, loops.distance)
    at_end = np.abs(np.where(nearer_ours, t, true_t).astype(np.longdouble) - farthest) <= reach
    wrong = np.flatnonzero(~(same | tied | nearer | at_end))
    assert not len(wrong), [(int(i), int(face[i]), int(true_face[i]), t[i], true_t[i]) for i in wrong[:5]]
    return face
