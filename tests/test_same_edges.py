"""What is seen in a mirror moves as what a camera behind it sees without: the same edges, found by other code.

Before the camera's own eye, outlines and shadows are sampled on the shapes and joined to it; in mirrors they are looked
for on lines through the picture. No finite differences: both derivatives at edges are means over independent seeds,
which may be 6 of their difference's standard errors apart. For 15 degrees of freedom that happens by chance once in
40,000 comparisons (Student), of the 54 here once in 700 runs.
"""

from collections.abc import Sequence
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from edge_scenes import plan, quick_jit

import jaxrt
from benchmarks.edge_rows import bumps
from benchmarks.edge_scenes import Description, ball, box, quad, scene
from benchmarks.ladder import build
from jaxrt.boundary import clearance_of, sample_edges, splat
from jaxrt.boundary.lines import line_edges
from jaxrt.boundary.lines.chains import MISSED, Lamp, blocker, chain_from
from jaxrt.boundary.lines.promises import promises
from jaxrt.boundary.trail import with_trails
from jaxrt.core.maths import normalize
from jaxrt.core.records import Ray
from jaxrt.transport.path import tables_of

SIZE, SEEDS, SAMPLES = 16, 16, {"direct": 16384, "mirror": 65536}
ERRORS = 6  # standard errors
CAMERA = {"position": [0, 1.5, 4], "target": [0, 1.1, -10], "fov": 17}


def still_life(camera: Description, triangles: Sequence[Description] = ()) -> Description:
    """Return a ball and a box on a floor that ends before z = 4.3, under a point light and a ball of light."""
    return scene(
        camera,
        triangles=quad([-6, 0, 4.3], [0, 0, 9], [12, 0, 0], "grey") + list(triangles),
        meshes=[box("box", "red", [-0.9, 0.9, 5.6], 0.5, [10, 30, 0])],
        spheres=[ball("ball", "blue", [0.9, 0.8, 5.9], 0.6)],
        lights=[
            {"position": [1.5, 5, 3], "intensity": 40},
            {"position": [0, 2, 6.5], "intensity": 0.4, "radius": 0.3},
        ],
    )


def descriptions() -> dict[str, tuple[Description, int]]:
    """Return both views of one picture, and after how many events each ends."""
    behind = {"position": [0, 1.5, -8], "target": [0, 1.1, 6], "fov": 17}
    mirrored = still_life(CAMERA, triangles=quad([-9, -9, -2], [18, 0, 0], [0, 18, 0], "mirror"))
    mirrored["materials"]["mirror"] = {"type": "mirror", "albedo": [1, 1, 1]}
    return {"direct": (still_life(behind), 1), "mirror": (mirrored, 2)}


X, Y, _ = np.eye(3, dtype=np.float32)
MOVES = {
    "ball": ("spheres.center[ball]", Y),
    "box": ("meshes.vertices[box]", X),
    "point light": ("lights.position[0]", X),
    "ball of light": ("lights.position[1]", X),
    "its radius": ("lights.radius[1]", np.float32(1)),
    "camera": ("camera.position", X),
}


@cache
def slopes(view):
    """Return the functionals (SEEDS, 9) of each move's derivative at edges."""
    description, depth = descriptions()[view]
    here = build(description, width=SIZE, height=SIZE)
    start = {name: jaxrt.parameters(here, name) for name, _ in MOVES.values()}

    @quick_jit
    def sampled(key):
        return sample_edges(here, key, plan(SAMPLES[view], depth, geometry=True, lights=True))

    @quick_jit
    def along(change, groups):
        tangent = jax.jvp(partial(jaxrt.with_parameters, here), (start,), (change,))[1]
        moves = [jax.jvp(partial(clearance_of, samples=one), (here,), (tangent,))[1] for one in groups]
        return sum(splat(one, move, (SIZE, SIZE)) for one, move in zip(groups, moves, strict=True))

    zeros = {name: jnp.zeros_like(value) for name, value in start.items()}
    changes = {
        move: zeros | {name: jnp.broadcast_to(direction, zeros[name].shape)}
        for move, (name, direction) in MOVES.items()
    }
    found = {move: [] for move in MOVES}
    for seed in range(SEEDS):
        groups = sampled(jnp.uint32(seed))
        for move, change in changes.items():
            picture = np.asarray(along(change, groups))
            found[move].append(bumps(picture[:, ::-1] if view == "mirror" else picture).reshape(9, 3).mean(1))
    return {move: np.stack(values) for move, values in found.items()}


@pytest.mark.usefixtures("quick_compilation")
def test_both_show_the_same_picture():
    views = descriptions().values()
    direct, mirror = (
        jaxrt.render(build(description, width=SIZE, height=SIZE), 0, spp=256, max_depth=depth)
        for description, depth in views
    )
    assert np.sqrt(np.mean((mirror[:, ::-1] - direct) ** 2) / np.mean(direct**2)) < 0.05


@pytest.mark.slow
@pytest.mark.parametrize("move", MOVES)
def test_edges_move_as_they_do_without(move):
    truth, found = slopes("direct")[move], slopes("mirror")[move]
    bound = ERRORS * np.sqrt((truth.var(0, ddof=1) + found.var(0, ddof=1)) / SEEDS)
    assert np.linalg.norm(bound) < 0.5 * np.linalg.norm(truth.mean(0)), "too noisy to tell"
    assert np.all(np.abs(found.mean(0) - truth.mean(0)) < bound)


@pytest.mark.usefixtures("quick_compilation")
def test_no_shadow_is_looked_for_where_nothing_is_lit_any_more():
    """A mirror shows the shadow of the box, as a second event: after one alone it shows nothing but lights."""
    here = build(descriptions()["mirror"][0], width=SIZE, height=SIZE)
    tables, position = tables_of(here), jnp.asarray([1.5, 5, 3], jnp.float32)
    lamp = Lamp(jnp.int32(0), position, jnp.zeros(3), jnp.ones(3))
    # Behind the mirror, the place of the floor that is opposite to the light
    shadow = np.float32([-1.43, 0, -10.17])
    ray = Ray(here.camera.position, normalize(shadow - here.camera.position))

    @partial(jax.jit, static_argnums=0)
    def blocked(max_depth):
        chain = chain_from(tables, ray, lambda k: (jnp.float32(0.5),) * 4, max_depth + 1)
        return blocker(tables, chain, lamp, max_depth)[2]

    assert blocked(1) == MISSED
    assert blocked(2) >= 0


@pytest.mark.usefixtures("quick_compilation")
def test_a_lamp_between_looks_at_its_mirror_image_is_looked_for():
    """It is a twentieth of a pixel wide, so that nearly all looks at the corners of pixels miss it."""
    lamp, radius, center, r = np.array([-2.0, 5, 4]), 0.1, np.array([0, 1.2, -2.5]), 1.3
    eye, size = np.array([0.0, 1, 7]), 16
    here = jaxrt.build(
        {
            "camera": {"position": eye.tolist(), "target": [0, 1, 0], "fov": 30, "width": size, "height": size},
            "materials": {"mirror": {"type": "mirror", "albedo": [0.9, 0.9, 0.9]}},
            "spheres": [ball("mirror", "mirror", center.tolist(), r)],
            "lights": [{"position": lamp.tolist(), "intensity": 40, "radius": radius}],
        }
    )
    # Where the ball mirrors the camera's rays to the lamp
    places = (np.arange(128 * size) + 0.5) / 128
    y, x = np.meshgrid(places, places, indexing="ij")
    ray = np.stack([x - size / 2, size / 2 - y, np.full_like(x, -size / 2 / np.tan(np.radians(15)))], -1)
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    away = eye - center
    half = ray @ away
    root = half**2 - away @ away + r * r
    hit = root > 0
    point = away - (half + np.sqrt(np.where(hit, root, 0)))[..., None] * ray
    normal = point / r
    on = ray - 2 * (ray * normal).sum(-1, keepdims=True) * normal
    toward = lamp - center - point
    along = (toward * on).sum(-1)
    shows = hit & (along > 0) & ((toward**2).sum(-1) - along**2 < radius**2)
    assert 0 < shows.sum() < (128 / 4) ** 2
    pixel = int(y[shows].mean()) * size + int(x[shows].mean())
    weights = jax.jit(partial(promises, plan(1024, 1, geometry=True), tables_of(here)))
    found = [np.asarray(weights(jnp.uint32(seed))) for seed in range(8)]
    assert all(each[pixel] > 0.9 * each.max() for each in found)
    # Not by marking all
    assert all((each > 0.9 * each.max()).mean() < 0.1 for each in found)


@pytest.mark.usefixtures("quick_compilation")
@pytest.mark.slow
def test_an_outline_in_a_mirror_counts_with_the_light_at_the_very_rim():
    """A ball of 3 pixels in radius, lit nearly from the front: a thousandth of a pixel within it is 6 % brighter."""
    size, distance, radius, lamp = 48, 19.0, 0.8, np.array([4.0, 0, -1])
    here = jaxrt.build(
        {
            "camera": {"position": [0, 0, 6], "target": [0, 0, 0], "fov": 40, "width": size, "height": size},
            "materials": {
                "mirror": {"type": "mirror", "albedo": [1, 1, 1]},
                "white": {"type": "diffuse", "albedo": [1, 1, 1]},
            },
            "triangles": quad([-4, -4, -2], [8, 0, 0], [0, 8, 0], "mirror"),
            "spheres": [ball("ball", "white", [0, 0, 9], radius)],
            "lights": [{"position": lamp.tolist(), "intensity": 1}],
        }
    )
    own = plan(16384, 2, geometry=True)

    @jax.jit
    def brought(seed):
        (samples,) = with_trails(tables_of(here), line_edges(here, seed, own), True, own.devices)
        return jnp.sum(jnp.where(samples.pixel[..., None] < size * size, samples.weight, 0)[..., 0])

    found = np.asarray([brought(jnp.uint32(seed)) for seed in range(4)], float)
    # The light along the rim, as the mirror's eye sees it, times what a unit of clearance sweeps in pixels
    turn = (np.arange(10_000) + 0.5) / 10_000 * 2 * np.pi
    sine = radius / distance
    normal = np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], -1) * np.sqrt(1 - sine**2) - [0, 0, sine]
    toward = lamp - ([0, 0, 9] + radius * normal)
    squared = (toward**2).sum(-1)
    light = np.maximum((normal * toward).sum(-1), 0) / squared**1.5 / np.pi
    scale = size / 2 / np.tan(np.radians(20)) / distance
    wanted = light.mean() * 2 * np.pi * radius * scale**2
    assert abs(abs(found.mean()) / wanted - 1) < 0.02 + 4 * found.std(ddof=1) / 2 / wanted, (found, wanted)


@pytest.mark.usefixtures("quick_compilation")
def test_where_walls_meet_neither_is_in_the_shadow_of_the_other():
    """Balls of radius 940 that cross: a hit near the curve is behind the other ball as often as rounding puts it there.

    A dark wall on the left of a bright one, a light at the camera: along a row of pixels all jumps are upward, and the
    curve, (x, y, x), crosses each row once. A seed's mean is half a percent off.
    """
    size, intensity, eye = 16, 10_000, np.array([0.0, 0, 52])
    walls = {"left": ([-1000.0, 0, 0], 0.2), "back": ([0, 0, -1000.0], 0.8)}
    here = jaxrt.build(
        {
            "camera": {"position": eye.tolist(), "target": [-62, 0, -62], "fov": 20, "width": size, "height": size},
            "materials": {name: {"type": "diffuse", "albedo": [albedo] * 3} for name, (_, albedo) in walls.items()},
            "spheres": [ball(name, name, center, 940) for name, (center, _) in walls.items()],
            "lights": [{"position": eye.tolist(), "intensity": intensity}],
        }
    )
    sampled = jax.jit(partial(line_edges, here, plan=plan(4096, 1, geometry=True)))
    found = []
    for seed in range(4):
        (samples,) = sampled(jnp.uint32(seed))
        across = (samples.pixel[:, 0] < size * size) & (samples.path.along[:, 0] == 1)
        weights = np.asarray(samples.weight[:, 0, 0])[np.asarray(across)]
        assert weights.size > 256 and weights.min() > 0
        found.append(weights.sum() / size)
    y = (np.arange(size) + 0.5 - size / 2) * np.tan(np.radians(10)) / (size / 2) * np.linalg.norm(eye - [-62, 0, -62])
    x = -500 + np.sqrt(940**2 - y**2 - 500_000) / np.sqrt(2)
    toward = eye - np.stack([x, y, x], -1)
    distance = np.linalg.norm(toward, axis=-1)
    light = [albedo * (toward * (np.stack([x, y, x], -1) - center) / 940).sum(-1) for center, albedo in walls.values()]
    wanted = np.mean((light[1] - light[0]) / distance**3) * intensity / np.pi
    assert abs(np.mean(found) / wanted - 1) < 0.02, (found, wanted)
