"""Find where a spherical light is and how large, from a soft shadow.

    python examples/fit_sphere_light.py

The width of the penumbra tells the radius. Powell's dogleg method and Levenberg-Marquardt side by side.
"""

import jax.numpy as jnp
import optimistix as optx
from figure import arguments, recorder, save_figure, solved

import jaxrt

options = arguments(__doc__)
spp, steps = (4, 2) if options.quick else (256, 30)
scene = jaxrt.load_scene("scenes/ball_under_sphere_light.toml")
edges = 4 * scene.camera.width * scene.camera.height
p = jaxrt.parameters(scene)
truth = {"position": p["lights.position"], "radius": p["lights.radius"]}
target = jaxrt.render(scene, 1, spp=16 * spp)
u0 = {"position": jnp.array([[2.0, 7.0, 0.0]]), "log radius": jnp.log(jnp.array([0.5]))}


def picture(u, boundary_samples=0):
    """The exponential keeps the radius above 0."""
    changes = {"lights.position": u["position"], "lights.radius": jnp.exp(u["log radius"])}
    return jaxrt.render(jaxrt.with_parameters(scene, changes), 0, spp=spp, boundary_samples=boundary_samples)


@jaxrt.jacobian_once
def residual(u, args):
    return (picture(u, edges) - target).ravel()


solvers = {"Levenberg-Marquardt": optx.LevenbergMarquardt, "Dogleg": optx.Dogleg}
if options.quick:
    del solvers["Dogleg"]
curves, pictures = {}, {"start": picture(u0)}
for name, solver in solvers.items():
    curves[name] = []
    method = solver(rtol=1e-4, atol=1e-4, verbose=recorder(curves[name]))

    def solve(u, method=method):
        solution = optx.least_squares(residual, method, u, max_steps=steps, throw=False)
        return solution.value, solution.stats["num_steps"]

    found = solved(name, solve, picture, u0)
    print(f"  position {found['position'][0]}, truth {truth['position'][0]}")
    print(f"  radius {float(jnp.exp(found['log radius'][0])):.4f}, truth {float(truth['radius'][0]):.4f}")
    pictures[name] = picture(found)

save_figure(options.output / "fit_sphere_light.png", target, pictures, curves)
