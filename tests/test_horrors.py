"""Every parameter of scenes with everything: forward = reverse, and no NaN or infinity at the worst corners.

Compilation is what costs here, so each scene has one program, forwards and backwards, fed with all parameters.
Specular surfaces and the environment have a scene without edge terms: those of mirrors and glass take long to compile.
"""

import warnings
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import jaxrt

pytestmark = pytest.mark.usefixtures("quick_compilation")
ONE = tuple(jax.devices()[:1])

# Forward = reverse, every parameter

DIFFUSE, BLACK = {"type": "diffuse", "albedo": [0.5, 0.6, 0.7]}, {"type": "diffuse", "albedo": [0, 0, 0]}
CAMERA = {"position": [0.2, 1.5, 6], "target": [0, 0.7, 0], "width": 64, "height": 48, "fov": 45}
SPECULAR = {
    "camera": CAMERA,
    "environment": {"radiance": [0.2, 0.3, 0.4]},
    "materials": {
        "wall": DIFFUSE,
        "black": BLACK,
        "silver": {"type": "mirror", "albedo": [0.9, 0.8, 0.7]},
        "crown": {"type": "glass", "ior": 1.5},
    },
    "spheres": [
        {"center": [0, 0.6, 0], "radius": 0.6, "material": "wall"},
        {"center": [0.8, 0.3, 1.2], "radius": 0.3, "material": "black"},
        {"center": [-1.5, 0.6, 0], "radius": 0.6, "material": "silver"},
        {"center": [1.5, 0.6, 0.3], "radius": 0.6, "material": "crown"},
    ],
    "lights": [{"position": [0.5, 4, 1], "intensity": 20}],
}
TRIANGLES = {
    "camera": CAMERA,
    "materials": {"wall": DIFFUSE, "black": BLACK},
    "triangles": [
        {"vertices": [[-8, 0, -8], [-8, 0, 8], [16, 0, 0]], "material": "wall"},
        {"vertices": [[-1, 0.2, 0.5], [0.4, 0.3, 0.9], [-0.5, 1.2, 0.5]], "material": "wall"},
        {"vertices": [[1, 0.2, 0.5], [2, 0.2, 0.5], [1.5, 1, 0.5]], "material": "black"},
    ],
    "lights": [{"position": [0.5, 4, 1], "intensity": 20}, {"position": [-2, 3, 2], "intensity": 10}],
}
BALLS = {
    "camera": CAMERA,
    "materials": {"wall": DIFFUSE, "black": BLACK},
    "spheres": [
        {"center": [0, 0.6, 0], "radius": 0.6, "material": "wall"},
        {"center": [0.8, 0.3, 1.2], "radius": 0.3, "material": "black"},
        {"center": [0, -50, 0], "radius": 50, "material": "wall"},
    ],
    "lights": [{"position": [0.5, 4, 1], "intensity": 20, "radius": 0.4}],
}
SCENES = {"specular": SPECULAR, "triangles": TRIANGLES, "balls": BALLS}
EDGES = {"specular": 0, "triangles": 1024, "balls": 1024}
SLOW = {"triangles": pytest.mark.slow}
NAMES = {
    "specular": [
        "lights.position",
        "lights.intensity",
        "materials.albedo",
        "materials.ior",
        "spheres.center",
        "spheres.radius",
        "camera.position",
        "camera.target",
        "camera.fov",
        "environment.radiance",
    ],
    "balls": [
        "lights.position",
        "lights.intensity",
        "lights.radius",
        "materials.albedo",
        "spheres.center",
        "spheres.radius",
        "camera.position",
        "camera.target",
        "camera.fov",
    ],
    "triangles": [
        "lights.position",
        "lights.intensity",
        "materials.albedo",
        "meshes.vertices",
        "camera.position",
        "camera.target",
        "camera.fov",
    ],
}


def cases(names):
    """Return parameters of a test: each name of each scene."""
    return [pytest.param(kind, name, marks=SLOW.get(kind, ())) for kind in names for name in names[kind]]


@cache
def scene_of(kind):
    with warnings.catch_warnings():
        # Glass under a point light casts a black shadow, as jaxrt warns
        warnings.simplefilter("ignore", jaxrt.SceneWarning)
        return jaxrt.build(SCENES[kind])


def picture(kind, values):
    """Two samples a pixel, three events."""
    scene = jaxrt.with_parameters(scene_of(kind), values)
    return jaxrt.render(scene, 3, spp=2, max_depth=3, boundary_samples=EDGES[kind], devices=ONE)


@partial(jax.jit, static_argnums=0)
def both_ways(kind, values, changes, weights):
    """Return the picture (48, 64, 3), its change along `changes`, and the weights (48, 64, 3) pulled back to values."""
    image, forwards = jax.linearize(partial(picture, kind), values)
    (pulled,) = jax.linear_transpose(forwards, values)(weights)
    return image, forwards(changes), pulled


def all_at_once(kind, values):
    """Return the picture, its change where every number grows alike, and the derivatives of the picture's sum."""
    return both_ways(kind, values, jax.tree.map(jnp.ones_like, values), jnp.ones((48, 64, 3), jnp.float32))


@pytest.mark.parametrize(("kind", "name"), cases(NAMES))
def test_forward_is_the_transpose_of_reverse(figures, kind, name):
    """⟨w, J v⟩ = ⟨Jᵀ w, v⟩ to 1e-5 of the sum of magnitudes, in a picture that is not square, edges included."""
    values = jaxrt.parameters(scene_of(kind))
    assert values.keys() == set(NAMES[kind])
    v = np.random.default_rng(1).normal(size=values[name].shape).astype(np.float32)
    changes = {k: jnp.zeros_like(x) for k, x in values.items()} | {name: jnp.asarray(v)}
    weights = np.random.default_rng(0).normal(size=(48, 64, 3)).astype(np.float32)
    _, change, pulled = both_ways(kind, values, changes, jnp.asarray(weights))
    terms = weights.astype(float) * np.asarray(change, float)
    assert abs(terms).sum() > 1e-3
    error = abs(np.sum(np.asarray(pulled[name], float) * v) - terms.sum()) / abs(terms).sum()
    figures(
        "A10", "difference of forward and reverse derivatives of every parameter, relative", ours=error, at_most=1e-5
    )


def test_edges_do_not_touch_the_picture():
    """Bit for bit; beside a derivative, in a program of its own with roundings of its own, to 1e-5."""
    plain = jaxrt.render(scene_of("balls"), 3, spp=2, max_depth=3, devices=ONE)
    values = jaxrt.parameters(scene_of("balls"))
    np.testing.assert_array_equal(picture("balls", values), plain)
    beside = all_at_once("balls", values)[0]
    np.testing.assert_allclose(beside, plain, rtol=1e-5, atol=1e-6)


# Nothing but numbers

HORRORS = {
    "specular": {
        "as it is": {},
        "camera at a ball's centre": {"camera.position": [0, 0.6, 0], "camera.target": [1, 0.6, 0]},
        "camera at the mirror's centre": {"camera.position": [-1.5, 0.6, 0], "camera.target": [0, 0.6, 0]},
        "camera inside the glass, total reflection": {"camera.position": [1.5, 0.05, 0.3], "camera.fov": 150.0},
        "camera at the glass's centre": {"camera.position": [1.5, 0.6, 0.3], "materials.ior": [3.0]},
        "glass of index 1": {"materials.ior": [1.0]},
        "light at a ball's centre": {"lights.position": [[0, 0.6, 0]]},
        "light around a ball's rim": {"lights.position": [[0, 1.2, 0]]},
        "light inside the glass": {"lights.position": [[1.5, 0.6, 0.3]]},
        "camera in the light": {"lights.position": [[0.2, 1.5, 6.1]]},
        "camera at the light's centre": {"lights.position": [[0.2, 1.5, 6]]},
        "camera on a ball": {"camera.position": [0, 1.2, 0], "camera.target": [1, 1.2, 0]},
        "black": {"materials.albedo": np.zeros((3, 3)), "environment.radiance": [0, 0, 0]},
        "dark": {"lights.intensity": np.zeros((1, 3))},
        "balls in one place": {"spheres.center": np.tile([[0, 0.6, 0]], (4, 1)), "spheres.radius": np.full(4, 0.6)},
        "huge wall": {
            "spheres.center": [[0, -1e4, 0], [1, 1, 0], [-1, 1, 0], [0, 1, 0]],
            "spheres.radius": [1e4, 1, 1, 1],
        },
        "light seen through the camera's pole": {"camera.position": [0.5, 8, 1], "camera.target": [0.5, 4, 1.0001]},
    },
    "balls": {
        "as it is": {},
        "camera at a ball's centre": {"camera.position": [0, 0.6, 0], "camera.target": [1, 0.6, 0]},
        "camera on a ball": {"camera.position": [0, 1.2, 0], "camera.target": [1, 1.2, 0]},
        "camera in the light": {"lights.position": [[0.2, 1.5, 6.1]]},
        "camera at the light's centre": {"lights.position": [[0.2, 1.5, 6]]},
        "light at a ball's centre": {"lights.position": [[0, 0.6, 0]]},
        "light around a ball's rim": {"lights.position": [[0, 1.2, 0]]},
        "light of no size": {"lights.radius": [0]},
        "light under the floor": {"lights.position": [[0.5, -4, 1]]},
        "balls in one place": {"spheres.center": np.tile([[0, 0.6, 0]], (3, 1)), "spheres.radius": np.full(3, 0.6)},
        "black": {"materials.albedo": np.zeros((2, 3))},
        "dark": {"lights.intensity": np.zeros((1, 3))},
        "only sky": {"camera.target": [0.2, 20, 6.1]},
    },
    "triangles": {
        "as it is": {},
        "without area": {"meshes.vertices": np.tile([[0, 0.5, 0]], (9, 1))},
        "in a line": {"meshes.vertices": np.outer(np.arange(9), [0.1, 0.1, 0.05])},
        "camera in the floor's plane": {"camera.position": [0.2, 0, 6], "camera.target": [0, 0, 0]},
        "camera at a vertex": {"camera.position": [-1, 0.2, 0.5], "camera.target": [0, 0.4, 0.5]},
        "camera at a light": {"camera.position": [0.5, 4, 1]},
        "light at a vertex": {"lights.position": [[-1, 0.2, 0.5], [0.4, 0.3, 0.9]]},
        "light in the floor": {"lights.position": [[0, 0, 0], [1, 0, 1]]},
        "light on an edge's line": {"lights.position": [[3, 0.2, 0.5], [1.5, 0.2, 0.5]]},
        "lights in one place": {"lights.position": [[0.5, 4, 1], [0.5, 4, 1]]},
        "dark": {"lights.intensity": np.zeros((2, 3))},
        "black": {"materials.albedo": np.zeros((2, 3))},
        "only sky": {"camera.target": [0.2, 20, 6.1]},
        "nearly half a turn": {"camera.fov": 179.9},
    },
}


@pytest.mark.parametrize(("kind", "name"), cases(HORRORS))
def test_horrors_have_finite_derivatives(figures, kind, name):
    """With respect to every parameter, forwards and backwards, edges included."""
    values = jaxrt.parameters(scene_of(kind))
    values |= {k: jnp.asarray(v, jnp.float32) for k, v in HORRORS[kind][name].items()}
    image, change, pulled = all_at_once(kind, values)
    wrong = sum(np.count_nonzero(~np.isfinite(x)) for x in (image, change, *pulled.values()))
    figures("A1", "numbers not finite of pictures and derivatives at 44 corners of three scenes", ours=wrong, at_most=0)


# Whatever values

coordinate = st.sampled_from([0, 1, -1, 0.6, 1e-6, 50, 1e3, -1e4]) | st.floats(-4, 4, width=32)
length = st.sampled_from([1e-6, 1e-3, 0.6, 50, 1e4]) | st.floats(0.125, 3, width=32)
brightness = st.sampled_from([0, 1e-6, 20, 1e6]) | st.floats(0, 100, width=32)
VALUES = {
    "lights.intensity": brightness,
    "lights.radius": st.just(0) | length,
    "materials.albedo": st.sampled_from([0, 1e-6, 1]) | st.floats(0, 1, width=32),
    "materials.ior": st.sampled_from([1, 100, 0.01]) | st.floats(0.5, 3, width=32),
    "spheres.radius": length,
    "camera.fov": st.sampled_from([1e-3, 179.9]) | st.floats(1, 150, width=32),
    "environment.radiance": brightness,
}


@st.composite
def changes_of(draw, kind):
    """Return new values of one to four of the parameters of a scene."""
    values = jaxrt.parameters(scene_of(kind))
    names = draw(st.lists(st.sampled_from(list(values)), min_size=1, max_size=4, unique=True))
    return {
        name: draw(arrays(np.float32, values[name].shape, elements=VALUES.get(name, coordinate).map(np.float32)))
        for name in names
    }


@pytest.mark.parametrize("kind", [pytest.param(kind, marks=SLOW.get(kind, ())) for kind in SCENES])
def test_fuzzed_values_have_finite_derivatives(kind):
    """15 draws a scene, the same in every run."""

    @settings(max_examples=15, deadline=None, derandomize=True, database=None)
    @given(changes_of(kind))
    @example({"camera.position": np.zeros(3, np.float32)})  # looks along `up`, so that its frame is 0
    def draws(changes):
        values = jaxrt.parameters(scene_of(kind)) | {k: jnp.asarray(v) for k, v in changes.items()}
        image, change, pulled = all_at_once(kind, values)
        numbers = {"picture": image, "change": change, **pulled}
        bad = [name for name, x in numbers.items() if not jnp.isfinite(x).all()]
        assert not bad, bad

    draws()
