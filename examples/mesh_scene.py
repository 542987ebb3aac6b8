"""Put a mesh where a picture shows it.

    python examples/mesh_scene.py

Any function from numbers to vertices will do as a parameter: here a shift (3,) and a scale of the whole mesh. Its
outline and its shadow move with it, which only edge derivatives see; backwards or forwards, they reach every vertex.
"""

import jax.numpy as jnp
import optimistix as optx
import trimesh
from figure import arguments, recorder, save_figure, solved

import jaxrt

options = arguments(__doc__)
size, spp, steps = (16, 4, 2) if options.quick else (64, 16, 30)
ball = trimesh.creation.icosphere(0 if options.quick else 1)  # 42 vertices, 80 faces; a file works as well
floor = {"vertices": [[-8, 0, 8], [8, 0, 8], [8, 0, -8], [-8, 0, -8]], "faces": [[0, 1, 2], [0, 2, 3]]}
description = {
    "camera": {"position": [0, 7, 12], "target": [0, 0.5, 0], "fov": 40, "width": size, "height": size},
    "render": {"spp": spp, "max_depth": 1},
    "materials": {
        "floor": {"type": "diffuse", "albedo": [0.6, 0.6, 0.6]},
        "stone": {"type": "diffuse", "albedo": [0.8, 0.4, 0.2]},
    },
    "meshes": [
        {"vertices": ball.vertices, "faces": ball.faces, "material": "stone", "translate": [0, 1.5, 0]},
        {**floor, "material": "floor"},
    ],
    "lights": [{"position": [4, 9, 3], "intensity": 250}],
}
scene = jaxrt.build(description)
vertices = jaxrt.parameters(scene)["meshes.vertices"]
count = len(ball.vertices)
target = jaxrt.render(scene, 1, spp=16 * spp)


def picture(u, boundary_samples=0):
    """Return the picture with the mesh shifted and scaled about its middle."""
    middle = vertices[:count].mean(axis=0)[None, :]
    moved = middle + jnp.exp(u["log scale"]) * (vertices[:count] - middle) + u["shift"][None, :]
    changed = jaxrt.with_parameters(scene, {"meshes.vertices": jnp.concatenate([moved, vertices[count:]])})
    return jaxrt.render(changed, 0, spp=spp, boundary_samples=boundary_samples)


@jaxrt.jacobian_once
def residual(u, args):
    return (picture(u, 4 * size * size) - target).ravel()


u0 = {"shift": jnp.array([1.0, -0.3, -0.8]), "log scale": jnp.log(jnp.array(1.3))}
losses = []
method = optx.LevenbergMarquardt(rtol=1e-4, atol=1e-4, verbose=recorder(losses))


def solve(u):
    solution = optx.least_squares(residual, method, u, max_steps=steps, throw=False)
    return solution.value, solution.stats["num_steps"]


found = solved("Levenberg-Marquardt", solve, picture, u0)
print(f"shift {found['shift']}, truth 0; scale {jnp.exp(found['log scale']):.4f}, truth 1")
pictures = {"start": picture(u0), "fit": picture(found)}
save_figure(options.output / "mesh_scene.png", target, pictures, {"Levenberg-Marquardt": losses})
