"""Outputs besides radiance: closed forms, derivatives with moving outlines, compositing, files."""

import warnings
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from edge_scenes import quick_jit

import jaxrt
from jaxrt.core.samplers import SAMPLERS, Stream
from jaxrt.transport.outputs import KINDS

SIZE, SPP = 16, 4
EYE, FOV = np.asarray([0.0, 0.0, 5.0]), 40.0
BALL = {"center": [0.3, -0.2, 0.1], "radius": 1.1, "material": "red", "name": "ball"}
SCENE = {
    "camera": dict(position=EYE.tolist(), target=[0, 0, 0], fov=FOV, width=SIZE, height=SIZE),
    "environment": {"radiance": [0.5, 0.25, 0.125]},
    "materials": {
        "glass": {"type": "glass", "ior": 1.5},
        "red": {"type": "diffuse", "albedo": [0.8, 0.3, 0.2]},
    },
    "spheres": [BALL, {"center": [1.6, 1.5, 0], "radius": 0.4, "material": "glass", "name": "bead"}],
    "lights": [{"position": [-1.6, 1.5, 0], "intensity": [3, 3, 3], "radius": 0.3, "name": "lamp"}],
}
ALL = ("radiance", "foreground", "sky", *KINDS, "mask[ball]", "mask[glass]", "mask[lamp]", "shape", "material")


@cache
def outputs():
    found = jaxrt.render(jaxrt.build(SCENE), 7, spp=SPP, max_depth=1, outputs=ALL)
    return {name: np.asarray(value) for name, value in found.items()}


def rays():
    """Return directions (height, width, spp, 3) of the camera's rays, by the conventions, in float64."""
    x, y, sample = np.meshgrid(np.arange(SIZE), np.arange(SIZE), np.arange(SPP), indexing="xy")

    def jitter(x, y, sample):
        stream = Stream(jnp.uint32(SIZE) * y + x, sample, jnp.uint32(7), jnp.uint32(SPP))
        return SAMPLERS["sobol"](stream, jnp.int32(0))[:2]

    numbers = [jnp.asarray(v.ravel(), jnp.uint32) for v in (x, y, sample)]
    u, v = (np.asarray(n, float).reshape(x.shape) for n in jax.vmap(jitter)(*numbers))
    toward = [x + u - SIZE / 2, SIZE / 2 - y - v, np.full(x.shape, -SIZE / (2 * np.tan(np.radians(FOV) / 2)))]
    toward = np.stack(toward, -1)
    return toward / np.linalg.norm(toward, axis=-1, keepdims=True)


def distance_to_ball(center, radius):
    """Return where rays meet a sphere, ∞ where they do not."""
    away, d = EYE - np.asarray(center), rays()
    b = d @ away
    inside = b * b - away @ away + radius * radius
    return np.where(inside > 0, -b - np.sqrt(np.maximum(inside, 0)), np.inf)


def met():
    """Return the distance to what is nearest, its number, and where it is."""
    balls = [(s["center"], s["radius"]) for s in SCENE["spheres"]] + [([-1.6, 1.5, 0], 0.3)]
    distances = np.stack([distance_to_ball(*ball) for ball in balls], -1)
    nearest, t = distances.argmin(-1), distances.min(-1)
    return np.where(np.isfinite(t), t, 0), np.where(np.isfinite(t), nearest, -1), balls


def test_depth_position_and_normal_of_balls():
    t, number, balls = met()
    place = np.where(number[..., None] >= 0, EYE + t[..., None] * rays(), 0)
    centers, radii = np.asarray([b[0] for b in balls]), np.asarray([b[1] for b in balls])
    normal = np.where(number[..., None] >= 0, (place - centers[number]) / radii[number][..., None], 0)
    found = outputs()
    # A ray that all but grazes a ball meets it where rounding says: by √(2 · 6e-8) of a radius
    for name, value, most in (("depth", t, 1e-5), ("position", place, 2e-5), ("normal", normal, 2e-4)):
        assert np.abs(found[name] - value.mean(2)).max() < most * max(1, np.abs(value).max()), name


def test_masks_and_albedo():
    _, number, _ = met()
    found = outputs()
    for name, own in {
        "alpha": number >= 0,
        "mask[ball]": number == 0,
        "mask[glass]": number == 1,
        "mask[lamp]": number == 2,
    }.items():
        np.testing.assert_allclose(found[name], own.mean(2), atol=1e-6, err_msg=name)
    albedo = np.asarray([[0.8, 0.3, 0.2], [1, 1, 1], [0, 0, 0], [0, 0, 0]])[number]
    np.testing.assert_allclose(found["albedo"], albedo.mean(2), atol=1e-6)


def test_numbers_are_those_of_the_file():
    found = outputs()
    whole = found["alpha"] == 1
    for i, (name, material) in enumerate({"mask[ball]": 1, "mask[glass]": 0, "mask[lamp]": -1}.items()):
        own = whole & (found[name] == 1)
        assert own.any()
        assert (found["shape"][own] == i).all() and (found["material"][own] == material).all()
    assert (found["shape"][found["alpha"] == 0] == -1).all() and found["shape"].dtype == np.int32


def test_uv_of_balls_and_triangles():
    """At the middle of a ball seen from +z u and v are one half; on a triangle they are linear in the place."""
    own = outputs()["mask[ball]"] == 1
    assert np.abs(outputs()["uv"][own].mean(0) - 0.5).max() < 0.02
    corners = [[-9, -9, 0], [9, -9, 0], [-9, 9, 0]]
    flat = SCENE | {"spheres": [], "triangles": [{"vertices": corners, "material": "red"}], "lights": []}
    found = jaxrt.render(jaxrt.build(flat), 7, spp=SPP, max_depth=1, outputs=("uv", "position", "alpha"))
    np.testing.assert_allclose(
        found["uv"], (found["position"][..., :2] + 9 * found["alpha"][..., None]) / 18, atol=1e-5
    )


@pytest.mark.parametrize("textured", [False, True])
@pytest.mark.usefixtures("quick_compilation")
def test_uv_of_meshes_is_their_own(textured):
    """Linear in the place, seams and all, whether a texture asks for it or not; other meshes have shares of corners."""
    square = {"vertices": [[-2, -2, 0], [0, -2, 0], [0, 2, 0], [-2, 2, 0]], "faces": [[0, 1, 2], [0, 2, 3]]}
    right = {"vertices": [[0, -9, 0], [9, -9, 0], [0, 9, 0]], "faces": [[0, 1, 2]], "material": "red"}
    uv = [[1, 2], [3, 2], [3, 8], [1, 8], [4, 2], [6, 8], [4, 8]]  # the second face's u begins at 4
    left = square | {"uv": uv, "face_uv": [[0, 1, 2], [4, 5, 6]], "material": "paint"}
    albedo = {"albedo": "tiles"} if textured else {"albedo": [0.5, 0.5, 0.5]}
    scene = SCENE | {"spheres": [], "lights": [], "meshes": [left, right], "textures": {"tiles": {"type": "checker"}}}
    scene["materials"] = SCENE["materials"] | {"paint": {"type": "diffuse"} | albedo}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jaxrt.SceneWarning)
        built = jaxrt.build(scene)
    found = jaxrt.render(built, 7, spp=1, outputs=("uv", "position"))
    x, y = np.moveaxis(np.asarray(found["position"], float)[..., :2], -1, 0)
    across, up = (x + 2) / 2, (y + 2) / 4
    on_left = np.stack([1 + 2 * across + 3 * (up > across), 2 + 6 * up], -1)
    on_right = np.stack([x / 9, (y + 9) / 18], -1)
    np.testing.assert_allclose(found["uv"], np.where((x < 0)[..., None], on_left, on_right), atol=1e-4)


def test_the_picture_is_its_foreground_and_its_sky():
    found = outputs()
    alone = jaxrt.render(jaxrt.build(SCENE), 7, spp=SPP, max_depth=1)
    np.testing.assert_array_equal(found["radiance"], alone)
    sky = (1 - found["alpha"])[..., None] * np.asarray([0.5, 0.25, 0.125])
    np.testing.assert_allclose(found["sky"], sky, atol=1e-7)
    np.testing.assert_allclose(found["foreground"] + found["sky"], found["radiance"], rtol=1e-6, atol=1e-7)


@pytest.mark.usefixtures("quick_compilation")
def test_alpha_composites():
    """A black sky's picture laid over a colour is the picture under a sky of it that lights nothing: here of balls that
    are black, so that a coloured sky is a background alone."""
    black = SCENE["materials"] | {"red": {"type": "diffuse", "albedo": [0, 0, 0]}}
    spheres = [BALL]
    scene = jaxrt.build(SCENE | {"materials": black, "spheres": spheres})
    other = jaxrt.with_parameters(scene, {"environment.radiance": jnp.asarray([0.1, 0.9, 0.4])})
    found, over = (
        jaxrt.render(s, 7, spp=SPP, max_depth=1, outputs=("foreground", "alpha", "radiance")) for s in (scene, other)
    )
    composite = found["foreground"] + (1 - found["alpha"])[..., None] * jnp.asarray([[[0.1, 0.9, 0.4]]])
    np.testing.assert_allclose(composite, over["radiance"], atol=1e-6)


NAMES = ("alpha", "mask[ball]", "depth", "albedo")
EDGES = 8 * SIZE * SIZE


@partial(jax.jit, static_argnames=("spp", "edges"))
def functionals(values, key, spp, edges=0):
    """Return means weighted by four Gaussians (4, c): smooth where box pixels have kinks."""
    scene = jaxrt.with_parameters(jaxrt.build(SCENE), values)
    found = jaxrt.render(scene, key, spp=spp, max_depth=1, outputs=NAMES, boundary_samples=edges)
    y, x = np.mgrid[:SIZE, :SIZE] + 0.5
    places = [((i + 0.5) * SIZE / 2, (j + 0.5) * SIZE / 2) for i in range(2) for j in range(2)]
    weights = jnp.asarray(np.stack([np.exp(-((y - a) ** 2 + (x - b) ** 2) / 32) for a, b in places]), jnp.float32)
    pictures = jnp.concatenate([jnp.atleast_3d(found[name]) for name in NAMES], -1)
    return jnp.einsum("kyx,yxc->kc", weights, pictures, precision="highest") / SIZE**2


@quick_jit
def slope(values, changes, key):
    return jax.jvp(lambda values: functionals(values, key, 64, EDGES), (values,), (changes,))[1]


MOVED = {
    "spheres.center": [1.0, 0, 0],
    "spheres.radius": 1.0,
    "lights.position": [1.0, 0, 0],
    "camera.position": [0, 0, 1.0],
}


@pytest.mark.parametrize("name", list(MOVED))
def test_masks_and_depth_move_as_differences_say(name):
    """Within 1 % and three standard errors: those of depth at rims, where it changes without bound, are the largest.

    The error of four functionals lies beyond three standard errors once in 90 if these are alike.
    """
    values = {k: v for k, v in jaxrt.parameters(jaxrt.build(SCENE)).items() if k in MOVED}
    changes = jax.tree.map(jnp.zeros_like, values)
    changes[name] = jnp.broadcast_to(jnp.asarray(MOVED[name], jnp.float32), values[name].shape)
    step = 0.015
    ends = [jax.tree.map(lambda v, c, h=h: v + h * c, values, changes) for h in (step, -step)]
    differences = np.stack(
        [np.subtract(*(functionals(end, key, 2048) for end in ends)) / (2 * step) for key in range(8)]
    )
    slopes = np.stack([slope(values, changes, 100 + key) for key in range(8)])
    difference, error = differences.mean(0), slopes.mean(0) - differences.mean(0)
    noise = np.sqrt((differences.var(0, ddof=1) + slopes.var(0, ddof=1)) / 8)
    size, error, noise = (np.linalg.norm(each, axis=0) for each in (difference, error, noise))
    assert (noise <= 0.03 * size).all(), (name, noise / size)
    assert (error <= 0.01 * size + 3 * noise).all(), (name, error / size)
