"""What leaves a surface: directions, weights, and which material is which row."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrt.core.maths import reflect
from jaxrt.core.records import SurfacePoint
from jaxrt.materials import Materials, scatter
from jaxrt.materials.diffuse import Diffuse
from jaxrt.materials.glass import Glass, sample_glass
from jaxrt.materials.mirror import Mirror

N = 40_000
ALL = Materials.of(
    glass=Glass(jnp.asarray([1.5, 1.2])),
    diffuse=Diffuse(jnp.asarray([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]])),
    mirror=Mirror(jnp.asarray([[0.7, 0.8, 0.9]])),
)


def scattered_at(materials, row, normal, wo, u):
    return scatter(materials, SurfacePoint(jnp.zeros(3), normal, jnp.zeros(()), row), wo, u)


SCATTER = jax.jit(jax.vmap(scattered_at, (None, None, 0, 0, 0)))


def unit_vectors(seed):
    v = np.random.default_rng(seed).normal(size=(N, 3))
    return (v / np.linalg.norm(v, axis=1, keepdims=True)).astype(np.float32)


@pytest.fixture(scope="module")
def scattered():
    """(normals, wo, one Scattering for each row: 2 diffuse, 1 mirror, 2 glass, a light)."""
    normal, wo = unit_vectors(1), unit_vectors(2)
    u = jax.random.uniform(jax.random.key(3), (N, 2))
    rows = [SCATTER(ALL, jnp.int32(row), normal, wo, (u[:, 0], u[:, 1])) for row in range(6)]
    return normal.astype(float), wo.astype(float), rows


def cosines(a, b):
    return np.sum(np.asarray(a, float) * np.asarray(b, float), -1)


def test_directions_have_unit_length(scattered):
    for s in scattered[2][:5]:
        np.testing.assert_allclose(np.linalg.norm(s.direction, axis=-1), 1, atol=2e-6)


def test_rows_tell_kinds(scattered):
    kinds = [(bool(s.diffuse.all()), bool(s.specular.all())) for s in scattered[2]]
    assert kinds == [(True, False)] * 2 + [(False, True)] * 3 + [(False, False)]


def test_diffuse_is_two_sided_with_its_albedo_as_weight(scattered):
    """On wo's side; E[cosθ] = 2/3 within 4σ, σ² = 1/18."""
    normal, wo, rows = scattered
    for s, albedo in zip(rows, ALL.diffuse.albedo, strict=False):
        side = np.sign(cosines(normal, wo))
        cosine = side * cosines(normal, s.direction)
        assert cosine.min() > -1e-6
        assert abs(cosine.mean() - 2 / 3) < 4 * np.sqrt(1 / 18 / N)
        np.testing.assert_array_equal(s.weight, np.tile(albedo, (N, 1)))
        np.testing.assert_array_equal(s.albedo, s.weight)


def test_mirror_is_two_sided(scattered):
    """In the plane of incidence, at the same angle, on the same side."""
    normal, wo, rows = scattered
    mirrored = np.asarray(rows[2].direction, float)
    np.testing.assert_allclose(cosines(mirrored, normal), cosines(wo, normal), atol=2e-6)
    np.testing.assert_allclose(np.cross(mirrored + wo, normal), 0, atol=2e-6)
    np.testing.assert_array_equal(rows[2].weight, np.tile(ALL.mirror.albedo[0], (N, 1)))
    np.testing.assert_array_equal(rows[2].albedo, 0)


def test_a_mirror_reflects_for_either_normal():
    wo, normal = jnp.asarray([0.6, 0.0, 0.8]), jnp.asarray([0.0, 0.0, 1.0])
    np.testing.assert_array_equal(reflect(wo, normal), reflect(wo, -normal))


@pytest.mark.parametrize(("row", "ior"), [(3, 1.5), (4, 1.2)])
def test_glass_obeys_snell_and_weighs_radiance(scattered, row, ior):
    """n sinθ is kept; weights 1, 1/eta² and eta²; refraction on the other side, reflection by the mirror's
    law.
    """
    normal, wo, rows = scattered
    direction, weight = np.asarray(rows[row].direction, float), np.asarray(rows[row].weight, float)[:, 0]
    entering = cosines(normal, wo) > 0
    through = cosines(normal, wo) * cosines(normal, direction) < 0
    assert 0.1 < np.mean(~through) < 0.5
    sin_o, sin_t = (np.linalg.norm(np.cross(normal, v), axis=-1) for v in (wo, direction))
    eta = np.where(entering, ior, 1 / ior)
    np.testing.assert_allclose(sin_o[through], (eta * sin_t)[through], atol=3e-6)
    np.testing.assert_allclose(weight, np.where(through, 1 / eta**2, 1), rtol=1e-6)
    mirrored = 2 * cosines(normal, wo)[:, None] * normal - wo
    np.testing.assert_allclose(direction[~through], mirrored[~through], atol=3e-6)
    # Beyond the critical angle nothing goes through
    total = ~entering & (sin_o > 1 / ior + 1e-6)
    assert total.any() and not np.any(through & total)


@pytest.mark.parametrize("cos", [1.0, 0.5, 0.1])
def test_glass_reflects_its_fresnel_share(cos):
    """Binomial 4σ; Schlick's approximation is another number at cosθ = .1."""
    wo, normal = jnp.asarray([np.sqrt(1 - cos**2), 0, cos], jnp.float32), jnp.asarray([0.0, 0.0, 1.0])
    u = jax.random.uniform(jax.random.key(6), (N,))
    direction, _ = jax.jit(jax.vmap(sample_glass, (None, None, None, 0)))(jnp.float32(1.5), wo, normal, u)
    share = np.mean(np.asarray(direction[:, 2]) > 0)
    t = np.sqrt(1 - (1 - cos**2) / 2.25)
    exact = (((1.5 * cos - t) / (1.5 * cos + t)) ** 2 + ((cos - 1.5 * t) / (cos + 1.5 * t)) ** 2) / 2
    assert abs(share - exact) < 4 * np.sqrt(exact * (1 - exact) / N)
    if cos == 0.1:
        assert abs(0.04 + 0.96 * (1 - cos) ** 5 - exact) > 4 * np.sqrt(exact / N)


def test_a_light_absorbs(scattered):
    np.testing.assert_array_equal(scattered[2][5].weight, 0)


@pytest.mark.parametrize("kind", ["diffuse", "mirror", "glass"])
def test_kinds_alone(kind):
    """Rows start at 0 for whichever kind is there; without diffuse materials there is no albedo."""
    alone = Materials.of(**{k: getattr(ALL, k) if k == kind else None for k in ("diffuse", "mirror", "glass")})
    wo, normal, u = jnp.asarray([0.6, 0.0, 0.8]), jnp.asarray([0.0, 0.0, 1.0]), jnp.float32(0.9)
    first = {"diffuse": 0, "mirror": 2, "glass": 3}[kind]
    a, b = (
        scattered_at(alone, jnp.int32(0), normal, wo, (u, u)),
        scattered_at(ALL, jnp.int32(first), normal, wo, (u, u)),
    )
    np.testing.assert_allclose(a.direction, b.direction, atol=1e-6)
    np.testing.assert_allclose(a.weight, b.weight, rtol=1e-6)
    assert (a.albedo is None) == (kind != "diffuse")
    assert sum(alone.counts) == len(jax.tree.leaves(getattr(alone, kind))[0])
