"""Light that is followed from lamps on, through glass that dims it or scatters it: its power, by closed forms."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np

import jaxrt
from jaxrt.boundary.shadows import Carrier, _power_kept, setting_out, vertex
from jaxrt.boundary.trail import vertices_along
from jaxrt.core.records import Ray, SurfacePoint
from jaxrt.core.samplers import Stream
from jaxrt.materials import Materials, scatter
from jaxrt.materials.rough_glass import RoughGlass
from jaxrt.transport.medium import around_lights
from jaxrt.transport.path import tables_of

TINT, RADIUS = np.array([0.2, 0.7, 1.5]), 0.6
N = 20_000


def tables(absorption, inner, height=5.0):
    """Return what lies below a lamp: a ball of glass that does not bend light, in it another thing, and a floor."""
    return tables_of(
        jaxrt.build(
            {
                "camera": {"position": [3, 2, 0], "target": [0, 0, 0], "fov": 20, "width": 4, "height": 4},
                "materials": {
                    "white": {"type": "diffuse", "albedo": [0.8] * 3},
                    "outer": {"type": "glass", "ior": 1, "absorption": absorption},
                    "clear": {"type": "glass", "ior": 1, "absorption": inner},
                },
                "spheres": [
                    {"center": [0, -1000, 0], "radius": 1000, "material": "white"},
                    {"center": [0, 1.2, 0], "radius": RADIUS, "material": "outer"},
                    {"center": [0, 1.2, 0], "radius": RADIUS / 2, "material": "clear"},
                ],
                "lights": [{"position": [0, height, 0], "intensity": [10] * 3, "radius": 0.1}],
            }
        )
    )


@jax.jit
def arriving(tables):
    """Return what the floor shows of the lamp's light that falls straight through the balls' middle."""
    down = Ray(tables.lights.lights.position[0] - jnp.asarray([0.0, 0.12, 0.0]), jnp.asarray([0.0, -1.0, 0.0]))
    zero, stream = jnp.zeros(3), Stream(*(jnp.uint32(i) for i in range(4)))
    carrier = setting_out(
        Carrier(down, down, jnp.zeros(()), jnp.ones(3), zero),
        around_lights(tables.geometry, tables.materials, tables.lights.lights),
        jnp.int32(0),
    )
    return vertices_along(partial(vertex, True), tables, stream, carrier, 5).weight


def test_light_fades_on_its_way_from_a_lamp(quick_compilation):
    """In a ball, and in one within it of another tint."""
    inner = np.array([0.9, 0.1, 0.4])
    pairs = ([0.0] * 3, [0.0] * 3), (TINT.tolist(), inner.tolist())
    clear, dim = (np.asarray(arriving(tables(*pair)), float) for pair in pairs)
    assert np.all(clear[:4] == 0) and np.all(clear[4] > 0)
    np.testing.assert_allclose(dim[4] / clear[4], np.exp(-RADIUS * (TINT + inner)), rtol=1e-4)


def test_light_fades_from_a_lamp_in_tinted_glass(quick_compilation):
    """From between the outer ball's middle and top: what is around the lamp counts from where it starts."""
    inner = np.array([0.9, 0.1, 0.4])
    pairs = ([0.0] * 3, [0.0] * 3), (TINT.tolist(), inner.tolist())
    clear, dim = (np.asarray(arriving(tables(*pair, height=1.65)), float) for pair in pairs)
    assert np.all(clear[:3] == 0) and np.all(clear[3] > 0)
    travelled = 1.65 - 0.12 - (1.2 - RADIUS) - RADIUS
    np.testing.assert_allclose(dim[3] / clear[3], np.exp(-travelled * TINT - RADIUS * inner), rtol=1e-4)


def test_a_lamp_in_the_open_is_in_no_glass():
    """A way up that meets nothing ends there, and not where the scene's first ball would be met."""
    there = tables(TINT.tolist(), [0.0] * 3)
    spheres = replace(there.geometry.spheres, tree=None)
    order = jnp.asarray([2, 1, 0, 3])
    turned = jax.tree.map(lambda leaf: leaf[order] if leaf.shape[:1] == (4,) else leaf, spheres)
    geometry = replace(there.geometry, spheres=turned)
    for height, expected in ((5.0, 0 * TINT), (1.65, TINT)):
        lights = replace(there.lights.lights, position=jnp.asarray([[0, height, 0]]))
        found = around_lights(geometry, there.materials, lights)
        np.testing.assert_allclose(found, [expected], rtol=1e-6)


def test_rough_glass_keeps_power(quick_compilation):
    """Of radiance 1/2.25 comes in, and 2.25 times as much goes out; power stays, but for a little between facets."""
    point = SurfacePoint(jnp.zeros(3), jnp.asarray([0.0, 0.0, 1.0]), jnp.zeros(()), jnp.int32(0))
    rows = Materials.of(rough_glass=RoughGlass(jnp.full(1, 1.5), jnp.full(1, 0.2), None))

    @jax.jit
    def kept(wo):
        def one(u):
            return _power_kept(SimpleNamespace(materials=rows), point, wo, scatter(rows, point, wo, (u[0], u[1])))

        return jax.vmap(one)(jax.random.uniform(jax.random.key(0), (N, 2)))[:, 0]

    for cos in (0.9, -0.9):
        power = np.asarray(kept(jnp.asarray([np.sqrt(1 - cos * cos), 0, cos], jnp.float32)), float)
        assert abs(power.mean() - 1) < 0.01 + 4 * power.std() / np.sqrt(N), (cos, power.mean())
