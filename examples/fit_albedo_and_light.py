"""Find colours and light together, with the scale between them fixed.

    python examples/fit_albedo_and_light.py

A picture under one light shows products of albedo and intensity: twice the light on surfaces half as bright looks the
same. The Jacobian knows: without more information it is singular. One known colour, as of a grey card, settles it;
here it is one more residual.
"""

import jax
import jax.numpy as jnp
import optimistix as optx
from figure import arguments, recorder, save_figure, solved

import jaxrt

options = arguments(__doc__)
spp, steps = (4, 2) if options.quick else (16, 40)
scene = jaxrt.load_scene("scenes/ball_on_floor.toml")
edges = 4 * scene.camera.width * scene.camera.height
p = jaxrt.parameters(scene)
truth = {"albedo": p["materials.albedo"], "position": p["lights.position"], "intensity": p["lights.intensity"]}
target = jaxrt.render(scene, 1, spp=16 * spp)
u0 = {
    "albedo": jnp.zeros((2, 3)),  # floor and ball; sigmoid(0) = 1/2
    "position": jnp.array([[1.0, 7.0, 5.0]]),
    "intensity": jnp.log(jnp.full((1, 3), 150.0)),
}


def values(u):
    """Return the parameters within their bounds."""
    return {
        "materials.albedo": jax.nn.sigmoid(u["albedo"]),
        "lights.position": u["position"],
        "lights.intensity": jnp.exp(u["intensity"]),
    }


def picture(u, boundary_samples=0):
    return jaxrt.render(jaxrt.with_parameters(scene, values(u)), 0, spp=spp, boundary_samples=boundary_samples)


@jaxrt.jacobian_once
def residual(u, args):
    card = 10 * (values(u)["materials.albedo"][0] - truth["albedo"][0])  # the floor's colour is known
    return jnp.concatenate([(picture(u, edges) - target).ravel(), card])


@jax.jit
def conditions(u):
    """Return the condition of the Jacobian without and with the card."""
    tree = jax.jacfwd(residual)(u, None)
    matrix = jnp.concatenate([leaf.reshape(leaf.shape[0], -1) for leaf in jax.tree.leaves(tree)], axis=1)
    values = [jnp.linalg.svd(rows, compute_uv=False) for rows in (matrix[:-3], matrix)]
    return [s[0] / s[-1] for s in values]


losses = []
method = optx.LevenbergMarquardt(rtol=1e-4, atol=1e-4, verbose=recorder(losses))


def solve(u):
    solution = optx.least_squares(residual, method, u, max_steps=steps, throw=False)
    return solution.value, solution.stats["num_steps"]


answer = solved("Levenberg-Marquardt", solve, picture, u0)
without, with_card = conditions(answer)
print(f"condition of the Jacobian: {without:.1e} without the known colour, {with_card:.1e} with it")
found = values(answer)
for name, true in jaxrt.parameters(scene).items():
    if name in found:
        print(f"{name}: {found[name].tolist()}\n  truth {true.tolist()}")
pictures = {"start": picture(u0), "fit": picture(answer)}
save_figure(options.output / "fit_albedo_and_light.png", target, pictures, {"Levenberg-Marquardt": losses})
