"""The edges that rough surfaces see: outlines by their scattered rays, against quadratures; and light through them."""

from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from edge_scenes import plan, quad, quick_jit

import jaxrt
from benchmarks.edge_rows import bumps
from benchmarks.edge_scenes import SCENES, round_mesh
from benchmarks.ladder import build
from jaxrt.boundary import clearance_of, sample_edges, splat
from jaxrt.boundary.outlines import bounced_edges
from jaxrt.boundary.shadows import shadow_edges
from jaxrt.boundary.silhouettes import Aim
from jaxrt.core.records import SurfacePoint
from jaxrt.materials import evaluate
from jaxrt.scene import drawn

SEEDS = 32
ERRORS = 5  # standard errors, which 31 degrees of freedom exceed by chance once in 46,000 times (Student)
SIZE, SUB = 4, 4  # pixels, and points in each, either way
RINGS, SPOKES = 48, 96  # of the quadrature over what the ball hides
HEIGHT, FOV = 1.5, 30.0
BALL = np.array([0.25, 1.1, -0.2]), 0.35


@cache
def below():
    """Return a floor, half of rough metal and half of plastic, below a black ball that hides a part of a white sky."""
    return jaxrt.build(
        {
            "camera": dict(position=[0, HEIGHT, 2], target=[0, 0, 0], fov=FOV, width=SIZE, height=SIZE),
            "materials": {
                "metal": {"type": "conductor", "albedo": [0.9, 0.7, 0.4], "roughness": 0.2},
                "plastic": {"type": "plastic", "albedo": [0.3, 0.5, 0.7], "roughness": 0.4},
                "black": {"type": "diffuse", "albedo": [0, 0, 0]},
            },
            "triangles": quad([-50, 0, -50], [0, 0, 100], [50, 0, 0], "metal")
            + quad([0, 0, -50], [0, 0, 100], [50, 0, 0], "plastic"),
            "spheres": [{"center": BALL[0].tolist(), "radius": BALL[1], "material": "black"}],
            "environment": {"radiance": [1, 1, 1]},
        }
    )


@cache
def places():
    """Return the points of the floor that the picture's pixels show, and the way from there to the camera."""
    eye = np.array([0, HEIGHT, 2])
    forward = -eye / np.linalg.norm(eye)
    right = np.cross(forward, [0, 1, 0])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    n = SIZE * SUB
    x, y = np.meshgrid((np.arange(n) + 0.5) / n * 2 - 1, 1 - (np.arange(n) + 0.5) / n * 2)
    half = np.tan(np.radians(FOV) / 2)
    rays = forward + half * (x.reshape(-1, 1) * right + y.reshape(-1, 1) * up)
    points = eye - rays * (eye[1] / rays[:, 1:2])
    return points, -rays / np.linalg.norm(rays, axis=1, keepdims=True)


@jax.jit
def _sent(row, wo, wi):
    """Return f cosθ at the floor, for many pairs of directions."""
    up = jnp.asarray([0.0, 1.0, 0.0])

    def one(row, wo, wi):
        surface = SurfacePoint(jnp.zeros(3), up, jnp.zeros(()), row)
        return evaluate(below().materials, surface, wo, wi)[0]

    return jax.vmap(jax.vmap(one, (None, None, 0)))(row, wo, wi)


def hidden(center, radius):
    """Return the light that the ball hides from the floor, mean over the picture: by Gauss's rule across its cone."""
    points, wo = places()
    away = center - points
    distance = np.linalg.norm(away, axis=1, keepdims=True)
    axis, top = away / distance, np.sqrt(1 - (radius / distance) ** 2)
    side = np.cross(axis, [0.3, 0.1, 0.9])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    other = np.cross(axis, side)
    nodes, shares = np.polynomial.legendre.leggauss(RINGS)
    cos = (1 + top + (1 - top) * nodes[None]) / 2
    sin = np.sqrt(1 - cos * cos)
    turn = 2 * np.pi * np.arange(SPOKES) / SPOKES
    wi = cos[:, :, None, None] * axis[:, None, None] + sin[:, :, None, None] * (
        np.cos(turn)[:, None] * side[:, None, None] + np.sin(turn)[:, None] * other[:, None, None]
    )
    # Diffuse black is the first material, metal and plastic follow
    row = np.where(points[:, 0] < 0, 1, 2).astype(np.int32)
    value = np.asarray(
        _sent(row, jnp.asarray(wo, jnp.float32), jnp.asarray(wi.reshape(len(points), -1, 3), jnp.float32))
    )
    rings = value.reshape(*wi.shape).astype(float).mean(2)
    return np.sum(rings * shares[None, :, None] * np.pi * (1 - top)[:, :, None], 1).mean(0)


MOVES = {
    "up": ("spheres.center", np.float32([[0, 1, 0]])),
    "sideways": ("spheres.center", np.float32([[1, 0, 0.5]])),
    "radius": ("spheres.radius", np.float32([1])),
}


@cache
def sampled():
    """Return edge samples of that scene, which serve whatever moves, for each of several seeds."""
    sample = quick_jit(partial(bounced_edges, plan=plan(8192, 1, geometry=True)))
    return [sample(below(), jnp.uint32(seed))[0] for seed in range(SEEDS)]


@pytest.mark.parametrize("move", MOVES)
def test_the_light_that_a_ball_hides_from_metal_and_plastic_is_that_of_a_quadrature(move):
    name, direction = MOVES[move]
    scene, step = below(), 0.01
    start = jaxrt.parameters(scene, name)
    by = np.asarray(direction[0], float)
    ends = [
        hidden(BALL[0] + h * by, BALL[1]) if name == "spheres.center" else hidden(BALL[0], BALL[1] + h * by)
        for h in (step, -step)
    ]
    expected = -(ends[0] - ends[1]) / (2 * step)

    @jax.jit
    def change(samples):
        def clearance(value):
            return clearance_of(jaxrt.with_parameters(scene, {name: value}), samples)

        return splat(samples, jax.jvp(clearance, (start,), (jnp.asarray(direction),))[1], (SIZE, SIZE))

    slopes = np.stack([np.asarray(change(samples), float).mean((0, 1)) for samples in sampled()])
    slope, noise = slopes.mean(0), slopes.std(0, ddof=1) / SEEDS**0.5
    bound = ERRORS * noise + 0.005 * np.abs(expected).max()
    assert np.all(np.abs(slope - expected) < bound), (slope, expected, noise)
    assert np.all(bound < 0.1 * np.abs(expected).max())


def test_the_shadow_that_a_ball_casts_on_frosted_glass_shows_from_outside():
    """Of a lamp and a ball inside: as the ball moves, so does nothing else of what the camera sees."""
    scene = build(SCENES["lamp in frosted glass"], width=16, height=16)
    name, moves = "spheres.center[ball]", jnp.asarray([1.0, 0.5, 0])
    start = jaxrt.parameters(scene, name)

    @quick_jit
    def change(seed):
        samples = shadow_edges(drawn(scene), seed, plan(16384, 1, geometry=True))

        def clearance(value, one):
            return clearance_of(drawn(jaxrt.with_parameters(scene, {name: value})), one)

        parts = [(one, jax.jvp(partial(clearance, one=one), (start,), (moves,))[1]) for one in samples]
        return sum(splat(one, slope, (16, 16)) for one, slope in parts)

    step = 0.01

    @jax.jit
    def draw(h):
        moved = jaxrt.with_parameters(scene, {name: start + h * moves})
        return jaxrt.render(moved, 0, spp=4096, max_depth=1)

    expected = bumps((np.asarray(draw(step), float) - np.asarray(draw(-step), float)) / (2 * step))
    found = np.stack([bumps(change(jnp.uint32(seed))) for seed in range(4)])
    size = np.linalg.norm(expected)
    assert np.linalg.norm(found.std(0)) < 0.02 * size
    assert np.linalg.norm(found.mean(0) - expected) < 0.03 * size


SURFACES = {
    "tinted": {"type": "glass", "ior": 1.5, "absorption": [0.1, 0.2, 0.3]},
    "milky": {"type": "rough_glass", "ior": 1.5, "absorption": [0.1, 0.2, 0.3]},
    "metal": {"type": "conductor", "albedo": [0.9, 0.7, 0.4]},
    "paint": {"type": "plastic", "albedo": [0.3, 0.5, 0.7]},
    "white": {"type": "diffuse", "albedo": [0.8, 0.8, 0.8]},
}


@pytest.mark.parametrize("kinds", [1, pytest.param(len(SURFACES), marks=pytest.mark.slow)])
def test_edges_are_sampled_whatever_the_surfaces_are_of(kinds):
    """The program is made up, not compiled: what one kind of surface has, the edges of all must have."""
    used = {name: SURFACES[name] for name in list(SURFACES)[:kinds]}
    scene = {"materials": used, "environment": {"radiance": [1, 1, 1]}}
    scene["spheres"] = [{"center": [3 * i, 1, 0], "radius": 1, "material": name} for i, name in enumerate(used)]
    if kinds > 1:
        scene["meshes"] = [round_mesh(smooth=True) | {"material": "milky", "translate": [0, 1, 4]}]
    scene["lights"] = [{"position": [0, 5, 0], "intensity": 10, "radius": 0.1}]
    scene["camera"] = {"position": [0, 1, 9], "target": [0, 1, 0], "width": 8, "height": 8}
    sample = partial(sample_edges, plan=plan(64, kinds, geometry=True, lights=True))
    assert jax.eval_shape(sample, drawn(jaxrt.build(scene)), jax.ShapeDtypeStruct((), jnp.uint32))


@pytest.mark.parametrize("is_round", [True, False])
@pytest.mark.parametrize("width", [1e-3, 0.05, 1.0])
@pytest.mark.parametrize("t", [0.0, 0.4, 1.0])
def test_places_near_a_lobe_have_their_density(is_round, width, t):
    """The share of places drawn before each of many is the density's integral up to there."""
    aim = Aim(jnp.float32(t), jnp.float32(width), jnp.asarray(is_round))
    u = (np.arange(20_000, dtype=np.float32) + 0.5) / 20_000
    drawn_at = np.sort(np.asarray(aim.draw(u), float))
    near = t + width * np.tan(np.pi * (u[::4].astype(float) - 0.5))
    near = near % 1 if is_round else np.clip(near, 0, 1)
    places = np.unique([*np.linspace(0, 1, 2001), *near])
    middle = (places[1:] + places[:-1]) / 2
    before = np.cumsum(np.asarray(aim.density(middle.astype(np.float32)), float) * np.diff(places))
    assert before[-1] == pytest.approx(1, abs=0.02)
    np.testing.assert_allclose(np.searchsorted(drawn_at, places[1:]) / 20_000, before, atol=0.02)
