"""Find the colours of a room's walls and ball from a picture, indirect light included.

    python examples/fit_albedo.py

Three solvers. Colours enter a path as a product of albedos: the residual is smooth, nearly linear, a few steps do.
But the least sum of squares on ONE set of samples is not at the true colours: noise is in the picture and in its
derivative alike, and dark walls make less of it. With a gradient_key of its own, the derivative's noise is another's;
Gauss-Newton then goes to where the mean gradient is 0, without that bias.
"""

from dataclasses import replace

import jax
import jax.numpy as jnp
import optimistix as optx
from figure import arguments, recorder, save_figure, solved

import jaxrt

options = arguments(__doc__)
size, spp, steps = (16, 4, 4) if options.quick else (48, 128, 60)
names = ["floor", "ceiling", "left", "right", "back", "white"]  # the front wall is behind the camera
rows = jnp.array([0, 1, 2, 3, 4, 6])  # which the light from it, alone, would not determine: it stays as it is

scene = jaxrt.load_scene("scenes/seed/soft_shadow_indirect.toml")
scene = replace(scene, camera=replace(scene.camera, width=size, height=size))
everything = jaxrt.parameters(scene)["materials.albedo"]
truth = everything[rows]
target = jaxrt.render(scene, 1, spp=16 * spp, max_depth=3)  # other random numbers, and more of them, than the fit's


def picture(u, gradient_key=None):
    """The sigmoid keeps an albedo between 0 and 1."""
    albedo = everything.at[rows].set(jax.nn.sigmoid(u))
    colored = jaxrt.with_parameters(scene, {"materials.albedo": albedo})
    return jaxrt.render(colored, 0, spp=spp, max_depth=3, gradient_key=gradient_key)


@jaxrt.jacobian_once
def residual(u, gradient_key):
    return (picture(u, gradient_key) - target).ravel()


u0 = jnp.zeros_like(truth)  # all grey, albedo 1/2
solvers = {"Gauss-Newton": optx.GaussNewton, "Levenberg-Marquardt": optx.LevenbergMarquardt, "BFGS": optx.BFGS}
if options.quick:
    del solvers["Levenberg-Marquardt"], solvers["BFGS"]
curves, answers = {}, {}
for name, solver in solvers.items():
    curves[name] = []
    method = solver(rtol=1e-3, atol=1e-4, verbose=recorder(curves[name]))

    def solve(u, gradient_key, method=method):
        solution = optx.least_squares(residual, method, u, gradient_key, max_steps=steps, throw=False)
        return jax.nn.sigmoid(solution.value), solution.stats["num_steps"]

    answers[name] = solved(name, solve, picture, u0, 2 if name == "Gauss-Newton" else 0)
    for row, found, true in zip(names, answers[name], truth, strict=True):
        print(f"  {row:8} {found} truth {true} greatest error {jnp.abs(found - true).max():.4f}")

best = answers["Gauss-Newton"]
fit = picture(jnp.log(best / (1 - best)))
save_figure(options.output / "fit_albedo.png", target, {"start": picture(u0), "fit": fit}, curves)
