"""T7, smooth normals: icospheres become the analytic sphere. One compiled program draws them all.

Every scene holds 1280 faces, some of them empty, and a sphere; one of the two is in view, the other behind the camera.
"""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh

import jaxrt
from jaxrt.shapes.smooth import corner_normals

FACES, VERTICES = 1280, 642
WHITE, GLASS = 0, 1
AWAY = np.array([0.0, 0, 100])


def ball(level):
    mesh = trimesh.creation.icosphere(level)
    return np.array(mesh.vertices), np.array(mesh.faces)


@pytest.fixture(scope="module")
def template():
    vertices, faces = ball(3)
    return jaxrt.build(
        {
            "camera": {"position": [0, 0, 3], "width": 48, "height": 48, "fov": 45},
            "materials": {
                "white": {"type": "diffuse", "albedo": [0.8, 0.8, 0.8]},
                "glass": {"type": "glass", "ior": 1.5},
            },
            "spheres": [{"center": [0, 0, 100], "radius": 1, "material": "white"}],
            "meshes": [{"vertices": vertices, "faces": faces, "material": "white", "smooth": True}],
            "triangles": [{"vertices": [[0, 0, 99], [1, 0, 99], [0, 1, 99]], "material": "glass"}],  # replaced
            "lights": [{"position": [3, 3, 1], "intensity": 30, "radius": 0.3}],
            "environment": {"radiance": [0.2, 0.3, 0.4]},
        }
    )


def draw(template, level, smooth, material, seed=1, spp=16):
    """Return the picture of an icosphere; level None: of the analytic sphere."""
    vertices, faces = ball(3 if level is None else level)
    groups = faces if smooth else np.arange(faces.size).reshape(-1, 3)
    v, n = VERTICES - len(vertices), FACES - len(faces)
    vertices = np.concatenate([vertices, np.zeros((v, 3))]) + (AWAY if level is None else 0)
    triangles = replace(
        template.triangles,
        vertices=jnp.asarray(vertices, jnp.float32),
        faces=jnp.asarray(np.pad(faces, ((0, n), (0, 0))), jnp.int32),
        material=jnp.full(FACES, material, jnp.int32),
        bvh=None,
        smooth=jnp.asarray(np.pad(groups, ((0, n), (0, 0))), jnp.int32),
    )
    scene = jaxrt.with_parameters(template, {"spheres.center": (AWAY * (level is not None))[None]})
    spheres = replace(scene.spheres, material=jnp.full(1, material, jnp.int32))
    scene = replace(scene, triangles=triangles, spheres=spheres)
    return np.asarray(jaxrt.render(scene, seed, spp=spp, max_depth=3, devices=jax.devices()[:1]))


def rms(x):
    return float(np.sqrt(np.mean(x**2)))


@pytest.mark.parametrize("level", [1, 3])
def test_vertex_normals_of_an_icosphere_are_exact(level):
    """Max's weights are exact for vertices on a sphere; float32 leaves some roundings of 6e-8 each, edges being 0.1."""
    vertices, faces = ball(level)
    normals = corner_normals(jnp.asarray(vertices[faces], jnp.float32), jnp.asarray(faces, jnp.int32))
    np.testing.assert_allclose(normals, vertices[faces], atol=2e-6)


def test_flat_faces_keep_their_normals_and_no_area_gives_zero():
    corners = jnp.asarray([[[0.0, 0, 0], [2, 0, 0], [0, 3, 0]], [[1, 1, 1], [1, 1, 1], [1, 1, 1]]], jnp.float32)
    normals = corner_normals(corners, jnp.arange(6, dtype=jnp.int32).reshape(2, 3))
    np.testing.assert_allclose(normals[0], [[0, 0, 1]] * 3, atol=1e-7)
    np.testing.assert_array_equal(normals[1], np.zeros((3, 3)))
    slope = jax.jit(jax.grad(lambda c: corner_normals(c, jnp.zeros((2, 3), jnp.int32)).sum()))(corners)
    assert np.isfinite(slope).all()


def test_a_fold_keeps_the_normal_of_its_face():
    """Two faces back to back share vertices: their mean is zero or faces away from one of them."""
    corners = jnp.asarray([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 0], [0, 2, 0.1], [2, 0, 0.1]]], jnp.float32)
    normals = corner_normals(corners, jnp.zeros((2, 3), jnp.int32))
    a, b, c = (np.asarray(corners[:, i]) for i in range(3))
    assert (np.sum(np.cross(b - a, c - a)[:, None] * np.asarray(normals), -1) > 0).all()


def blocks(image):
    """Return the means of 8×8 pixels: sixteen samples a pixel draw an outline too coarsely to compare it."""
    return image.reshape(6, 8, 6, 8, 3).mean((1, 3))


def test_t7_error_falls_threefold_with_each_subdivision(figures, template):
    """Places, normals and the area that the outline lacks all err by h²: fourfold, with room for the sampling.

    The samples are the same numbers, so that only the surfaces differ.
    """
    truth = blocks(draw(template, None, True, WHITE))
    errors = [rms(blocks(draw(template, level, True, WHITE)) - truth) for level in (1, 2, 3)]
    falls = [errors[0] / errors[1], errors[1] / errors[2]]
    figures("T7", "by what each subdivision of an icosphere divides its picture's error", ours=falls, at_least=3)


def test_t7_no_facets_at_the_shadow_terminator(figures, template):
    """Where light fades, each pixel within 10 % of the sphere's. Unlifted rays leave 0.15 to 1.3 of it there.

    Lit from the side, without other light; 320 faces, whose normals differ by 16°.
    """
    dark = {"environment.radiance": np.zeros(3), "lights.position": [[3, 1, 0.2]]}
    scene = jaxrt.with_parameters(template, dark)
    truth, smooth = (draw(scene, level, True, WHITE, spp=64)[..., 0] for level in (None, 2))
    flat = draw(scene, 2, False, WHITE)[..., 0]
    across = np.linalg.norm(np.indices((48, 48)) - 23.5, axis=0)
    radius = 24 * np.tan(np.arcsin(1 / 3)) / np.tan(np.radians(22.5))
    fading = (across < 0.9 * radius) & (truth > 0.01) & (truth < 0.3)
    assert fading.sum() > 150
    wrong, bad = (abs(x[fading] / truth[fading] - 1) for x in (smooth, flat))
    figures("T7", "error where light fades on 320 smooth faces; naive: flat faces", naive=bad, ours=wrong, at_most=0.1)


def test_glass_mesh_sphere_is_the_glass_sphere(template):
    """z of the image mean over 8 pairs of seeds, at 6 σ of Student's t (7): false alarm 5e-4.

    The bias of 1280 faces, h² = 0.005 of the outline's share of the picture, is far below the noise.
    """
    pairs = [
        draw(template, 3, True, GLASS, seed=2 * s, spp=8).mean()
        - draw(template, None, True, GLASS, seed=2 * s + 1, spp=8).mean()
        for s in range(8)
    ]
    z = np.mean(pairs) / (np.std(pairs, ddof=1) / np.sqrt(len(pairs)))
    assert abs(z) < 6, (z, np.mean(pairs))
