"""Rough glass, measured metals, glTF's material, absorption: against quadratures in float64, and closed forms."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrt
from jaxrt.materials import Materials, scatter
from jaxrt.materials.conductor import Conductor, conducted
from jaxrt.materials.glass import fresnel
from jaxrt.materials.metals import METALS
from jaxrt.materials.principled import Principled
from jaxrt.materials.rough_glass import RoughGlass
from tests.test_rough import SURFACE, TINTS, check_density, toward

N = 40_000
DRAWS = jax.random.uniform(jax.random.key(2), (N, 2))
GRID = np.meshgrid(*2 * [(np.arange(300) + 0.5) / 300], indexing="ij")


def glass(roughness, ior=1.5):
    return RoughGlass(jnp.asarray(ior, jnp.float32), jnp.asarray(roughness, jnp.float32), None)


def principled(roughness, metallic=0.5, albedo=TINTS, compensation=1.0):
    return Principled(*(jnp.asarray(x, jnp.float32) for x in (albedo, metallic, roughness, compensation)))


def rows(one):
    return Materials.of(**{one.kind.name: jax.tree.map(lambda leaf: leaf[None], one)})


@jax.jit
def scattered(one, turn, wo):
    """Return directions (n, 3) and weights (n, 3) at a surface that is turned about y."""
    surface = replace(SURFACE, normal=jnp.stack([jnp.sin(turn), jnp.zeros_like(turn), jnp.cos(turn)]))
    out = jax.vmap(lambda u: scatter(rows(one), surface, wo, (u[0], u[1])))(DRAWS)
    return out.direction, out.weight


@jax.jit
def slopes(one, turn, wo, change):
    """Return the derivative of the light of a sky that brightens to one side, in the material and the turn."""

    def light(one, turn):
        wi, weight = scattered(one, turn, wo)
        return weight * (1 + 0.9 * wi[:, :1])

    return jax.jvp(light, (one, turn), change)[1]


class Facets:
    """Directions that facets send light to, with the share of it that goes there: a quadrature over normals."""

    def __init__(self, roughness, wo, turn=0.0):
        self.alpha = alpha = roughness**2
        normal = np.array([np.sin(turn), 0, np.cos(turn)])
        tangent = np.array([np.cos(turn), 0, -np.sin(turn)])
        self.side = 1 if np.dot(wo, normal) > 0 else -1
        axes = np.stack([tangent, [0, 1, 0], normal * self.side])
        u, v = GRID
        tan, turn = alpha * np.sqrt(u / (1 - u)), 2 * np.pi * v
        cos = 1 / np.sqrt(1 + tan**2)
        local = np.stack([tan * cos * np.cos(turn), tan * cos * np.sin(turn), cos], -1)
        self.wo, self.normal, self.m, self.cos_m = np.asarray(wo), axes[2], local @ axes, cos
        self.cos_o, self.met = wo @ axes[2], np.maximum(self.m @ wo, 0)

    def share(self, wi):
        """Return G2 |wo·m| / (cos_o cos_m), which goes to `wi` of light that meets facets by D cos."""
        cos = np.abs(wi @ self.normal)
        far_o, far_i = (np.sqrt(self.alpha**2 + (1 - self.alpha**2) * c**2) for c in (self.cos_o, cos))
        return 2 * self.cos_o * cos / (self.cos_o * far_i + cos * far_o) * self.met / (self.cos_o * self.cos_m)

    def reflected(self):
        wi = 2 * self.met[..., None] * self.m - self.wo
        return wi, np.where(wi @ self.normal > 0, self.share(wi), 0)

    def refracted(self, ior):
        eta = ior if self.side > 0 else 1 / ior
        squared = 1 - (1 - self.met**2) / eta**2
        cos_t = np.sqrt(np.maximum(squared, 1e-12))
        wi = (self.met / eta - cos_t)[..., None] * self.m - self.wo / eta
        parallel = (eta * self.met - cos_t) / (eta * self.met + cos_t)
        across = (self.met - eta * cos_t) / (self.met + eta * cos_t)
        fresnel = np.where(squared > 0, (parallel**2 + across**2) / 2, 1)
        return wi, np.where((squared > 0) & (wi @ self.normal < 0), self.share(wi) / eta**2, 0), fresnel


def lit(roughness, ior, wo, turn=0.0):
    """Return the light of the one-sided sky that rough glass reflects and refracts."""
    facets = Facets(roughness, np.asarray(wo, float), turn)
    there, mirrored = facets.reflected()
    through, passed, fresnel = facets.refracted(ior)
    return [
        (s * w * (1 + 0.9 * d[..., 0])).mean()
        for d, s, w in ((there, mirrored, fresnel), (through, passed, 1 - fresnel))
    ]


SIDES = {"outside": 0.7, "grazing": 0.25, "inside": -0.8, "beyond the critical angle": -0.4}


@pytest.mark.parametrize("roughness", [0.25, 0.5, 1.0])
@pytest.mark.parametrize("cos", SIDES.values(), ids=SIDES.keys())
def test_rough_glass_draws_with_the_density_told_and_sends_what_a_quadrature_does(roughness, cos):
    one, wo = glass(roughness), toward(cos)
    check_density(one, wo, kept=True)
    wi, weight = (np.asarray(x, float) for x in scattered(one, jnp.zeros(()), wo))
    light = weight[:, 0] * (1 + 0.9 * wi[:, 0])
    crosses = wi[:, 2] * cos < 0
    for wanted, part in zip(lit(roughness, 1.5, wo), (light * ~crosses, light * crosses), strict=True):
        assert abs(part.mean() - wanted) < 4 * part.std() / np.sqrt(N) + 1e-4, (part.mean(), wanted)


@pytest.mark.parametrize("ior", [1.5, 0.7])
@pytest.mark.parametrize("cos", [0.7, -0.7])
def test_slopes_of_rough_glass_are_those_of_a_quadrature(ior, cos):
    """In roughness, index and the surface's normal, within 4σ."""
    one, wo, step = glass(0.6, ior), toward(cos), 1e-3
    zero, unit, none = jnp.zeros(()), jnp.ones(()), jax.tree.map(jnp.zeros_like, one)
    changes = {
        (step, 0, 0): (replace(none, roughness=unit), zero),
        (0, step, 0): (replace(none, ior=unit), zero),
        (0, 0, step): (none, unit),
    }
    for (r, n, t), change in changes.items():
        slope = np.asarray(slopes(one, zero, wo, change), float)[:, 0]
        ends = [sum(lit(0.6 + h * r, ior + h * n, wo, h * t)) for h in (1, -1)]
        wanted = (ends[0] - ends[1]) / (2 * step)
        assert abs(slope.mean() - wanted) < 4 * slope.std() / np.sqrt(N) + 2e-3, ((r, n, t), slope.mean(), wanted)


def test_light_through_rough_glass_is_mutual():
    """But for the square of the index (Veach 1997, §5.2)."""
    one = glass(0.5)
    there, back = toward(0.8), jnp.asarray([-0.3, 0.2, -np.sqrt(0.87)], jnp.float32)
    for wi in (back, back * jnp.asarray([1, 1, -1.0])):
        a, b = (one.evaluate(SURFACE, *pair)[0] / jnp.abs(pair[1][2]) for pair in ((there, wi), (wi, there)))
        squared = 1.5**2 if float(wi[2]) < 0 else 1
        np.testing.assert_allclose(a * squared, b, rtol=1e-4)


@pytest.mark.parametrize("cos", [0.8, -0.9])
def test_least_roughness_is_nearly_smooth_glass(cos):
    wi, weight = (np.asarray(x, float) for x in scattered(glass(0.05), jnp.zeros(()), toward(cos)))
    eta = jnp.float32(1.5 if cos > 0 else 1 / 1.5)
    share, cos_t = (float(x) for x in fresnel(jnp.float32(abs(cos)), eta))
    reflected = wi[:, 2] * cos > 0
    assert abs((weight[:, 0] * reflected).mean() - share) < 0.01
    assert abs((weight[:, 0] * ~reflected).mean() * float(eta) ** 2 - (1 - share)) < 0.01
    way = [-np.sqrt(1 - cos**2) / float(eta), 0, -np.sign(cos) * cos_t]
    np.testing.assert_allclose(np.median(wi[~reflected], 0), way, atol=2e-3)


@pytest.mark.parametrize("name", METALS)
def test_metals_reflect_by_fresnels_equations(name):
    eta, k = METALS[name]
    for cos in (1.0, 0.6, 0.1):
        index = np.asarray(eta) + 1j * np.asarray(k)
        inner = np.sqrt(1 - (1 - cos**2) / index**2)
        amplitudes = (cos - index * inner) / (cos + index * inner), (index * cos - inner) / (index * cos + inner)
        found = conducted(jnp.float32(cos), jnp.asarray(eta, jnp.float32), jnp.asarray(k, jnp.float32))
        np.testing.assert_allclose(found, sum(abs(a) ** 2 for a in amplitudes) / 2, rtol=2e-5)


@pytest.mark.parametrize("roughness", [0.3, 0.5**0.5, 1.0])
@pytest.mark.parametrize("compensation", [0.0, 1.0])
def test_a_white_metal_without_compensation_loses_what_a_quadrature_does(roughness, compensation):
    one = Conductor(
        jnp.ones(3), jnp.asarray(roughness, jnp.float32), jnp.asarray(compensation, jnp.float32), None, None
    )
    for cos in (0.9, 0.3):
        weight = np.asarray(scattered(one, jnp.zeros(()), toward(cos))[1], float)[:, 0]
        error = 4 * weight.std() / np.sqrt(N) + 1e-4
        if compensation:
            assert 0.97 <= weight.mean() <= 1 + error
        else:
            assert abs(weight.mean() - Facets(roughness, toward(cos)).reflected()[1].mean()) < error


@pytest.mark.parametrize("metallic", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("roughness", [0.3, 0.8])
def test_principled_is_gltfs(metallic, roughness):
    """Without compensation, which glTF does not have: colours of the light that is sent, within 4σ."""
    wo, colour = np.asarray(toward(0.6), float), np.asarray(TINTS, float)
    one = principled(roughness, metallic, compensation=0)
    check_density(one, toward(0.6))
    straight, beneath = 0.04 + metallic * (colour - 0.04), (1 - metallic) * colour

    def schlick(cos):
        return straight + (1 - straight) * ((1 - np.maximum(cos, 0)) ** 5)[..., None]

    facets = Facets(roughness, wo)
    wanted = (schlick(facets.met) * facets.reflected()[1][..., None]).mean((0, 1))
    u, v = GRID
    wi = np.stack([np.sqrt(u) * np.cos(2 * np.pi * v), np.sqrt(u) * np.sin(2 * np.pi * v), np.sqrt(1 - u)], -1)
    wanted += ((1 - schlick(np.sqrt((1 + wi @ wo) / 2))) * beneath).mean((0, 1))
    weight = np.asarray(scattered(one, jnp.zeros(()), toward(0.6))[1], float)
    assert np.all(np.abs(weight.mean(0) - wanted) < 4 * weight.std(0) / np.sqrt(N) + 1e-4), (weight.mean(0), wanted)


def through(ior):
    """Return a scene that looks along a diameter, 2 long, of a tinted ball before a sky."""
    return {
        "camera": {"type": "orthographic", "position": [0, 0, 4], "tall": 1e-3, "width": 4, "height": 4},
        "materials": {"tinted": {"type": "glass", "ior": ior, "absorption": [0.2, 0.5, 2]}},
        "spheres": [{"center": [0, 0, 0], "radius": 1, "material": "tinted"}],
        "environment": {"radiance": [1, 1, 1]},
    }


def sharp(light):
    return np.asarray(light, float)[1, 1]


TINT = np.array([0.2, 0.5, 2])


def test_light_fades_in_tinted_glass(quick_compilation):
    """exp(−absorption · length), and all reflections inside; its derivative is that of the closed form."""
    scene = jaxrt.build(through(1.0))
    names = ["materials.absorption", "materials.ior"]

    def seen(*values):
        return jaxrt.render(jaxrt.with_parameters(scene, dict(zip(names, values, strict=True))), 0, spp=64, max_depth=8)

    at = jnp.asarray([TINT], jnp.float32), jnp.ones(1)
    light, slope = jax.jvp(seen, at, (jnp.ones((1, 3)), jnp.zeros(1)))
    left = np.exp(-2 * TINT)
    np.testing.assert_allclose(sharp(light), left, rtol=1e-4)
    np.testing.assert_allclose(sharp(slope), -2 * left, rtol=1e-4)
    light = np.asarray(seen(at[0], jnp.full(1, 1.5)), float).mean((0, 1))
    mirrored = 0.04
    wanted = mirrored + (1 - mirrored) ** 2 * left / (1 - mirrored * left)
    np.testing.assert_allclose(light, wanted, atol=0.03)


def test_light_fades_on_its_way_to_what_is_inside(quick_compilation):
    """A lamp in tinted glass is dimmed by the glass before it."""
    lamp = {"position": [0, 0, 0], "intensity": np.pi * 0.25, "radius": 0.5}
    dim = jaxrt.build(through(1.0) | {"lights": [lamp], "environment": {"radiance": [0, 0, 0]}})
    np.testing.assert_allclose(sharp(jaxrt.render(dim, 0, spp=4, max_depth=2)), np.exp(-0.5 * TINT), rtol=1e-3)
