"""Find a point light from the hard shadow that it casts.

    python examples/fit_light_position.py

The same fit twice: with the derivatives of moving shadow edges (boundary_samples, about 4 a pixel), and without. A
hard shadow has no derivative inside: what automatic differentiation of the samples alone returns is the slope of the
shading, and it leads astray where the shadow is the stronger cue.
"""

import jax.numpy as jnp
import optimistix as optx
from figure import arguments, recorder, save_figure, solved

import jaxrt

options = arguments(__doc__)
scene = jaxrt.load_scene("scenes/hanging_ball.toml")
spp, steps = (4, 2) if options.quick else (16, 30)
edges = 4 * scene.camera.width * scene.camera.height

truth = jaxrt.parameters(scene)["lights.position"]
diagonal = 20.0  # of what the picture shows
target = jaxrt.render(scene, 1, spp=16 * spp)
first = jnp.array([[0.0, 8.5, 2.0]])


def picture(position, boundary_samples=0):
    lit = jaxrt.with_parameters(scene, {"lights.position": position})
    return jaxrt.render(lit, 0, spp=spp, boundary_samples=boundary_samples)


curves, pictures = {}, {"start": picture(first)}
for name, boundary_samples in {"with edges": edges, "interior only": 0}.items():
    curves[name] = []

    @jaxrt.jacobian_once
    def residual(position, target, boundary_samples=boundary_samples):
        return (picture(position, boundary_samples) - target).ravel()

    method = optx.LevenbergMarquardt(rtol=1e-4, atol=1e-4, verbose=recorder(curves[name]))

    def solve(position, target, residual=residual, method=method):
        solution = optx.least_squares(residual, method, position, target, max_steps=steps, throw=False)
        return solution.value, solution.stats["num_steps"]

    found = solved(name, solve, picture, first, target)
    error = float(jnp.linalg.norm(found - truth))
    print(f"  {found[0]}, truth {truth[0]}: off by {error:.4f}, {error / diagonal:.2%} of the scene")
    pictures[name] = picture(found)

save_figure(options.output / "fit_light_position.png", target, pictures, curves)
