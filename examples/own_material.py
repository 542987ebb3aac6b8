"""A material of one's own: a sheet that sends light back to where it came from, as on road signs.

python examples/own_material.py
"""

import jax
import jax.numpy as jnp
from figure import arguments

import jaxrt
from jaxrt.kinds import Albedo, Positive, around, dot, safe_sqrt


@jaxrt.material
class RetroReflector:
    """A lobe about the direction to the eye, f = albedo (n + 2)/2π cosⁿα."""

    albedo: Albedo
    exponent: Positive = 100.0

    def sample(self, surface, wo, u):
        cos = u[1] ** (1 / (self.exponent + 1))
        wi = around(wo, safe_sqrt(1 - cos * cos), cos, u[0])
        above = jnp.maximum(dot(surface.facing(wo), wi), 0)
        return wi, self.albedo * ((self.exponent + 2) / (self.exponent + 1) * above)

    def evaluate(self, surface, wo, wi):
        cos = jnp.maximum(dot(surface.facing(wo), wi), 0)
        lobe = jnp.maximum(dot(wo, wi), 0) ** self.exponent / (2 * jnp.pi)
        return self.albedo * ((self.exponent + 2) * lobe * cos), (self.exponent + 1) * lobe


options = arguments(__doc__)
side = 24 if options.quick else 200
scene = jaxrt.build(
    {
        "camera": {"position": [0, 1, 6], "target": [0, 1, 0], "fov": 40, "width": side, "height": side},
        "render": {"spp": 4 if options.quick else 128, "max_depth": 2},
        "materials": {
            "sheet": {"type": "retro_reflector", "albedo": [0.9, 0.8, 0.2], "exponent": 60},
            "chalk": {"type": "diffuse", "albedo": [0.5, 0.5, 0.5]},
        },
        "spheres": [
            {"center": [-1, 1, 0], "radius": 0.9, "material": "sheet"},
            {"center": [1, 1, 0], "radius": 0.9, "material": "chalk"},
        ],
        "triangles": [{"vertices": [[-50, 0, 50], [50, 0, 50], [0, 0, -50]], "material": "chalk"}],
        "lights": [{"position": [0.3, 1.6, 6], "intensity": 40, "radius": 0.2}],
    }
)
image = jaxrt.render(scene, 0)
print("mean radiance of the retro-reflector:", image[:, : side // 2].mean(), "of chalk:", image[:, side // 2 :].mean())

# Its parameters are parameters like any other
exponent = jaxrt.parameters(scene)["materials.exponent"]
tangent = jax.jvp(
    lambda n: jaxrt.render(jaxrt.with_parameters(scene, {"materials.exponent": n}), 0).mean(), [exponent], [exponent]
)[1]
print("a lobe narrower by 1 % changes the picture's mean by", tangent / 100)
jaxrt.save_image(options.output / "own_material.png", image)
