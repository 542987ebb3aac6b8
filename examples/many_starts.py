"""Start a fit from 32 places at once, and see which of them lead to the light.

    python examples/many_starts.py

The solve is a function of its start, so `jax.vmap` makes one compiled call of many of them. The map shows, seen from
above, how far from the light each start ends.
"""

import time

import jax
import jax.numpy as jnp
import optimistix as optx
from figure import arguments
from matplotlib.figure import Figure

import jaxrt

options = arguments(__doc__)
spp, steps, grid = (4, 2, (2, 2)) if options.quick else (8, 30, (8, 4))
scene = jaxrt.load_scene("scenes/hanging_ball.toml")
edges = 2 * scene.camera.width * scene.camera.height
truth = jaxrt.parameters(scene)["lights.position"]
target = jaxrt.render(scene, 1, spp=16 * spp)


@jaxrt.jacobian_once
def residual(position, args):
    lit = jaxrt.with_parameters(scene, {"lights.position": position})
    return (jaxrt.render(lit, 0, spp=spp, boundary_samples=edges) - target).ravel()


def solve(position):
    method = optx.LevenbergMarquardt(rtol=1e-3, atol=1e-3)
    solution = optx.least_squares(residual, method, position, max_steps=steps, throw=False)
    return solution.value, jnp.sum(residual(solution.value, None) ** 2)


x, z = jnp.meshgrid(jnp.linspace(-2.5, 4.5, grid[0]), jnp.linspace(-1, 3, grid[1]))
starts = jnp.stack([x.ravel(), jnp.full(x.size, 8.0), z.ravel()], axis=1)[:, None, :]
start = time.perf_counter()
found, losses = jax.block_until_ready(jax.jit(jax.vmap(solve))(starts))
errors = jnp.linalg.norm(found - truth, axis=(1, 2))
print(f"{len(starts)} starts, {time.perf_counter() - start:.1f} s with compiling")
print(f"{int(jnp.sum(errors < 0.2))} of them end within 1 % of the scene's size")
best = int(jnp.argmin(losses))
print(f"least loss {losses[best]:.3g}: {found[best, 0]}, truth {truth[0]}")

figure = Figure(figsize=(6, 4.5), layout="constrained")
axes = figure.subplots()
dots = axes.scatter(starts[:, 0, 0], starts[:, 0, 2], c=jnp.maximum(errors, 1e-3), norm="log", s=160, cmap="viridis_r")
axes.plot(*zip(*[(s[0, 0], s[0, 2]) for s in starts], strict=True), "k.", markersize=2)
axes.plot(truth[0, 0], truth[0, 2], "r*", markersize=14, label="the light")
axes.set(xlabel="x of the start", ylabel="z of the start", title="how far from the light a start ends")
axes.legend()
figure.colorbar(dots, label="distance from the light")
figure.savefig(options.output / "many_starts.png", dpi=75)
print(f"figure: {options.output / 'many_starts.png'}")
