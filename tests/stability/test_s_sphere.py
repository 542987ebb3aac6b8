"""Ray and sphere: cases S1-S8. Where a naive method exists, its failure is asserted."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrt
from jaxrt.core.maths import FAR
from jaxrt.core.records import Ray
from jaxrt.shapes import Geometry, leave, occluded
from jaxrt.shapes.sphere import Spheres, find_sphere, lost_digits, sphere_surface_point, sphere_table
from tests.lanes import lanes
from tests.oracle import directions, dot, sphere_distances, unit_vectors
from tests.stability import naive

N = 40_000
U = 2.0**-24


def one_ray(table, o, d):
    """Return (distance, row, surface point)."""
    ray = Ray(o, d)
    t, i = find_sphere(table, ray, jnp.full((), FAR))
    return t, i, sphere_surface_point(table, ray, jnp.maximum(i, 0))


trace = lanes(one_ray)
textbook = lanes(naive.textbook_sphere)


@jax.jit
@jax.vmap
def tables(center, radius, lost):
    return sphere_table(Spheres(center[None], radius[None], lost[None], jnp.zeros(1, jnp.int32)))


def spheres(center, radius, n=N):
    """Return one sphere per lane: (table of one row, float32 centres, float32 radii)."""
    c = np.broadcast_to(np.asarray(center, np.float32), (n, 3))
    r = np.broadcast_to(np.asarray(radius, np.float32), (n,))
    return tables(c, r, np.zeros(n, np.float32)), c, r


@pytest.mark.parametrize("distance", [10, 1e3, 4e3, 1e4])
def test_s1_far_sphere(figures, distance):
    rng = np.random.default_rng(1)
    o = (unit_vectors(rng, N) * distance).astype(np.float32)
    aim = rng.uniform(-1.1, 1.1, (N, 3))
    aim -= o * (dot(aim, o) / dot(o.astype(float), o))[:, None]
    d = directions(o, aim)
    table, c, r = spheres([0, 0, 0], 1)
    truth, depth = sphere_distances(o, d, c, r)
    hit = np.isfinite(truth)
    far = textbook(o, d, c, r)
    bad = ((far < FAR) != hit).mean() if distance >= 1e3 else None
    assert bad is None or bad > 0.01
    t, row, point = trace(table, o, d)
    wrong = (row >= 0) != hit
    assert np.all(np.abs(depth[wrong]) <= 1e-3)
    figures("S1", "share of wrong hits of a sphere 10 to 1e4 radii away", naive=bad, ours=wrong.mean(), at_most=2e-4)
    inside = (row >= 0) & (depth > 1e-3)
    both = inside & (far < FAR)
    bad = np.abs(far - truth)[both] / distance if distance >= 1e3 else None
    error = np.abs(t - truth)[inside] / distance
    figures(
        "S1", "error of the distance of a sphere 10 to 1e4 radii away, relative", naive=bad, ours=error, at_most=8 * U
    )
    # Also the point lies within its own bound of the sphere, however far it was seen from
    off = np.abs(np.linalg.norm(point.position.astype(float), axis=1) - 1)
    assert np.all(off[row >= 0] <= point.error[row >= 0]) and point.error.max() < 2e-6


def wall_rays(x, n=N):
    """Return rays in a room of size 2 to the wall at x."""
    rng = np.random.default_rng(2)
    o = (rng.uniform(-0.95, 0.95, (n, 3)) + [x + 1, 0, 0]).astype(np.float32)
    aim = rng.uniform(-1, 1, (n, 3)) * [0, 1, 1] + [x, 0, 0]
    return o, directions(o, aim)


@pytest.mark.parametrize("radius", [1e2, 1e3, 1e4, 1e5, 1e6])
@pytest.mark.parametrize("x", [0, 5.03])
def test_s2_huge_sphere_as_wall(figures, x, radius):
    o, d = wall_rays(x)
    table, c, r = spheres([x - radius, 0, 0], radius)
    truth, _ = sphere_distances(o, d, c, r)
    t, row, point = trace(table, o, d)
    assert np.array_equal(row >= 0, np.isfinite(truth))
    hit = row >= 0
    cosine = np.abs(dot(point.normal.astype(float), d))
    bad = np.abs(textbook(o, d, c, r) - truth)[hit] if radius >= 1e4 else None
    assert bad is None or bad.max() > 1e-3
    # Away from x = 0, rounding the power moves the wall itself, which grazing rays magnify
    error = np.abs(t - truth)[hit] * (1 if x == 0 else cosine[hit])
    figures(
        "S2",
        "error of the distance to a wall of radius 1e2 to 1e6, in a room of 2",
        naive=bad,
        ours=error,
        at_most=1e-5,
    )
    off = np.abs(np.linalg.norm(point.position - c.astype(float), axis=1) - r)
    assert off[hit].max() <= 1e-5 and np.all(off[hit] <= point.error[hit])


def test_s2_wall_stands_where_the_scene_file_puts_it(figures):
    white = {"white": {"type": "diffuse", "albedo": [1.0, 1.0, 1.0]}}
    wall = {"center": [5.03 - 1e6, 0.0, 0.0], "radius": 1e6, "material": "white"}
    light = {"position": [6.0, 0.0, 0.0], "intensity": 1.0}
    camera = {"position": [6.03, 0.0, 0.0], "target": [5.0, 0.0, 0.0]}
    scene = jaxrt.build({"camera": camera, "materials": white, "spheres": [wall], "lights": [light]})
    batch = jax.tree.map(lambda x: x[None], sphere_table(scene.spheres))
    _, _, point = trace(batch, np.asarray(scene.camera.position)[None], np.float32([[-1, 0, 0]]))
    rounded = abs(float(np.float32(5.03 - 1e6)) + 1e6 - 5.03)
    off = abs(point.position[0, 0] + scene.origin[0] - 5.03)
    figures("S2", "how far such a wall stands off; naive: its centre in float32", naive=rounded, ours=off, at_most=1e-5)


def test_s2_digits_lost_by_the_centre_hold_the_wall():
    o, d = wall_rays(5.03)
    for radius in (1e4, 1e6):
        center = np.array([5.03 - radius, 0, 0])
        c, r = np.tile(center, (N, 1)).astype(np.float32), np.full(N, radius, np.float32)
        lost = lost_digits(np.tile(center, (N, 1)), np.full(N, radius), np.float32)
        t, row, point = trace(tables(c, r, np.float32(lost)), o, d)
        truth, _ = sphere_distances(o, d, np.tile(center, (N, 1)), radius)
        assert np.all(row == 0)
        assert (np.abs(t - truth) * np.abs(dot(point.normal, d))).max() <= 1e-5


def test_s3_from_the_centre(figures):
    rng = np.random.default_rng(3)
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    d = np.concatenate([axes, unit_vectors(rng, N - 6)]).astype(np.float32)
    zero = np.zeros(3, np.float32)
    near, far = naive.sign_zero_sphere(zero, d[0], zero, np.float32(1))
    assert near == 0 and not np.isfinite(far)
    worst = []
    for center in ([0, 0, 0], [0.3, -2, 5], [-300, 1, 7]):
        for radius in (1e-3, 1.0, 4.0, 1e3, 1e6):
            table, c, r = spheres(center, radius)
            t, row, point = trace(table, c, d)
            assert np.all(row == 0)
            worst.append(np.abs(t - r).max() / np.spacing(np.float32(radius)))
            assert np.isfinite(point.position).all() and np.isfinite(point.normal).all()
    figures("S3", "error of the distance from a sphere's centre, in ulp", naive=far, ours=worst, at_most=4)


def test_s3_ray_at_its_closest_approach(figures):
    table, c, r = spheres([0, 0, 0], 1, 4)
    o = np.float32([[0, 1, 0], [0, 2, 0], [0, 0.5, 0], [0, 0, 0]])
    d = np.float32([[1, 0, 0]] * 4)
    t, row, point = trace(table, o, d)
    assert np.array_equal(row, [-1, -1, 0, 0]) and np.allclose(t[2:], [np.sqrt(0.75), 1], rtol=4 * U)
    roots = [jnp.stack(naive.sign_zero_sphere(a, b, c[0], r[0])) for a, b in zip(o, d, strict=True)]
    bad, wrong = (sum(np.count_nonzero(~np.isfinite(y)) for y in x) for x in (roots, [*vars(point).values()][:3]))
    figures("S3", "numbers not finite where rays start at their closest approach", naive=bad, ours=wrong, at_most=0)


def segment(table, o, w):
    """Return (distance without offset, distance, row, start) of the segment that starts below o."""
    point = sphere_surface_point(table, Ray(o, -o / jnp.sqrt(jnp.sum(o * o))), jnp.int32(0))
    bare, _ = find_sphere(table, Ray(point.position, w), jnp.full((), FAR))
    t, row = find_sphere(table, leave(point, w), jnp.full((), FAR))
    return bare, t, row, point


def test_s4_segments_inside_glass(figures):
    n, rng = 1_000_000, np.random.default_rng(4)
    normal = unit_vectors(rng, n)
    w = unit_vectors(rng, n)
    w = (w * -np.sign(dot(w, normal))[:, None]).astype(np.float32)
    table, _, _ = spheres([0, 0, 0], 1, n)
    bare, t, row, point = lanes(segment)(table, (2 * normal).astype(np.float32), w)
    p = point.position.astype(float)
    cosine = -dot(p, w) / np.linalg.norm(p, axis=1)
    chord = 2 * cosine
    bad = np.mean(bare < chord / 2)  # without an offset many rays find the surface that they leave
    assert np.all(row == 0) and bad > 0.1
    # Starting e below the surface shortens a chord by e/cosθ, and makes a grazing one √(8e) long
    e = point.error.astype(float) + 8 * U
    assert np.all(np.abs(t - chord) <= np.minimum(2 * e / np.maximum(cosine, 1e-9), np.sqrt(8 * e) + 4 * e))
    steep = cosine > 0.05
    assert np.all(t > 0)
    figures("S4", "error of 1e6 chords inside a ball of radius 1", ours=np.abs(t - chord)[steep], at_most=1e-4)
    short = np.mean((t < chord / 2)[cosine > 0.01])
    figures("S4", "share of 1e6 chords that end where they start; naive: no offset", naive=bad, ours=short, at_most=0)


def test_s5_derivative_is_finite_at_the_limb(figures):
    impact = np.float32([0, 0.5, 0.99, 0.9999, 0.999999, 1 - U, 1, 1 + 2 * U, 1.0001, 2])
    o = np.stack([-3 * np.ones_like(impact), impact, 0 * impact], 1)

    def position(center, radius, o, d):
        table = sphere_table(Spheres(center[None], radius[None], jnp.zeros(1), jnp.zeros(1, jnp.int32)))
        return sphere_surface_point(table, Ray(o, d), jnp.int32(0)).position

    derivatives = lanes(jax.jacfwd(position, argnums=(0, 1, 2, 3)), packet=2)
    zero, one = np.zeros_like(o), np.ones_like(impact)
    result = derivatives(zero, one, o, np.tile(np.float32([1, 0, 0]), (len(o), 1)))
    slopes = [jax.grad(lambda y: jnp.sqrt(jnp.maximum(1 - y * y, 0)))(y) for y in impact]
    bad, wrong = (sum(np.count_nonzero(~np.isfinite(x)) for x in xs) for xs in (slopes, result))
    figures(
        "S5", "derivatives not finite at and beyond a limb; naive: √max(1 − y², 0)", naive=bad, ours=wrong, at_most=0
    )
    # Head on, the point follows the sphere's centre and radius
    assert np.allclose(result[0][0][:, 0], [1, 0, 0], atol=1e-6) and np.allclose(result[1][0], [-1, 0, 0], atol=1e-6)


@pytest.mark.parametrize("radius", [1e-3, 1, 1e3, 1e4, 1e5, 1e6])
def test_s6_point_is_on_the_sphere(figures, radius):
    """The scene has size 2 and touches the sphere, as a wall or as a ball."""
    rng = np.random.default_rng(6)
    axis = np.array([0.6, 0.64, 0.48])
    o = (unit_vectors(rng, N) * 0.8 + axis).astype(np.float32)
    d = directions(o, unit_vectors(rng, N) * min(radius, 1) / 2)
    table, c, r = spheres(-axis * (radius if radius > 1 else 0), radius)
    _, row, point = trace(table, o, d)
    naive_point = c + r[:, None] * point.normal
    hit = (row >= 0) & (np.abs(point.position).max(1) < 2)

    def off(p):
        return np.abs(np.linalg.norm(p.astype(float) - c, axis=1) - r)[hit].max()

    bad = off(naive_point) if radius >= 1e5 else None
    assert bad is None or bad > 1e-4
    assert hit.mean() > 0.3
    figures(
        "S6",
        "how far hits are off spheres of radius 1e-3 to 1e6; naive: c + r n",
        naive=bad,
        ours=off(point.position),
        at_most=2e-6,
    )


def same_answer(geometry, o, d):
    """Return (closest hit?, any hit?, any hit before the closest?, any hit up to just past it?)."""
    ray = Ray(o, d)
    t, row = find_sphere(geometry.spheres, ray, jnp.full((), FAR))
    any_hit = occluded(geometry, ray, jnp.full((), FAR))
    return row >= 0, any_hit, occluded(geometry, ray, 0.99 * t), occluded(geometry, ray, 1.01 * t)


def test_s7_shadow_rays_agree_with_nearest_hits(figures):
    n, rng = 1_000_000, np.random.default_rng(7)
    c = rng.uniform(-1, 1, (n, 4, 3)).astype(np.float32)
    r = (10 ** rng.uniform(-4, 0, (n, 4))).astype(np.float32)
    c[:, 3, 0], r[:, 3] = -1e4, np.float32(1e4 - 2)
    build = jax.jit(jax.vmap(lambda c, r: sphere_table(Spheres(c, r, jnp.zeros(4), jnp.zeros(4, jnp.int32)))))
    o = rng.uniform(-2, 2, (n, 3)).astype(np.float32)
    d = directions(o, c[:, 0] + unit_vectors(rng, n) * r[:, :1] * rng.choice([0, 1, 1.001, 30], (n, 1)))
    hit, any_hit, before, after = lanes(same_answer)(Geometry(build(c, r), None), o, d)
    assert 0.3 < hit.mean() < 0.98
    wrong = np.mean(hit != any_hit) + np.mean(before[hit]) + np.mean(~after[hit])
    figures("S7", "share of 1e6 rays where shadow test and nearest hit disagree", ours=wrong, at_most=0)


@pytest.mark.parametrize("bad", [{"radius": 0.0}, {"radius": -1.0}, {"center": [float("nan"), 0.0, 0.0]}])
def test_s8_impossible_sphere_is_refused(figures, bad):
    sphere = {"center": [0.0, 0.0, 0.0], "radius": 1.0, "material": "white", **bad}
    white = {"white": {"type": "diffuse", "albedo": [1.0, 1.0, 1.0]}}
    camera = {"position": [0.0, 0.0, 5.0]}
    with pytest.raises(jaxrt.SceneError, match=r"spheres\[0\]." + next(iter(bad))):
        jaxrt.build(
            {
                "camera": camera,
                "materials": white,
                "spheres": [sphere],
                "environment": {"radiance": [1.0] * 3},
            }
        )
    # The normal at the side of +x, if there were no check: none, or inwards
    with np.errstate(invalid="ignore"):
        c, r = np.array(sphere["center"]), np.float64(sphere["radius"])
        normal = (c + np.array([abs(r), 0, 0]) - c) / r
    taken = int(not normal[0] > 0)
    figures(
        "S8", "spheres of radius 0, −1 and centre NaN taken; naive: their normals wrong", naive=taken, ours=0, at_most=0
    )
