"""Find place and size of a ball from a depth picture, such as a depth camera takes.

    python examples/fit_depth.py

No light enters: `outputs=("depth",)` traces the camera's rays to what they meet first. Depth jumps at the ball's
outline, and where the ball goes, the jump goes with it: that is in the derivative by boundary_samples, and is what
tells of a ball of which the start overlaps half. The sensor's noise is 0.05 a pixel, the distance about 12.
"""

import jax
import jax.numpy as jnp
import numpy as np
from figure import arguments
from matplotlib.figure import Figure

import jaxrt
from jaxrt.fit import standard_errors

options = arguments(__doc__)
spp, steps = (4, 2) if options.quick else (64, 15)
scene = jaxrt.load_scene("scenes/ball_under_sphere_light.toml")
edges = 4 * scene.camera.width * scene.camera.height
truth = np.asarray([0.0, 1.5, 0.0, 1.0])
names = ("x", "y", "z", "radius")


@jax.jit
def depth(ball, key):
    moved = jaxrt.with_parameters(scene, {"spheres.center": ball[None, :3], "spheres.radius": ball[3:]})
    return jaxrt.render(moved, key, spp=spp, outputs=("depth",), boundary_samples=edges)["depth"]


@jax.jit
def look(ball):
    """Return the residual (height, width, 1) at a ball, and its Jacobian (height, width, 1, 4)."""

    def residual(ball):
        r = (depth(ball, 0) - target)[..., None]
        return r, r

    jacobian, r = jax.jacfwd(residual, has_aux=True)(ball)
    return r, jacobian


noise = 0.05 * np.random.default_rng(0).standard_normal((scene.camera.height, scene.camera.width))
target = depth(jnp.asarray(truth, jnp.float32), 1) + noise.astype(np.float32)
ball = np.asarray([1.0, 2.0, -0.5, 0.8], np.float32)
pictures = {"target": target, "start": depth(ball, 0)}
(r, jacobian), losses, damping = look(ball), [], 1e-2
for _ in range(steps):
    # A step of Levenberg and Marquardt, taken if it gains
    matrix, slope = (np.einsum("yxci,yxc...->i...", jacobian, x) for x in (jacobian, r))
    trial = (ball - np.linalg.solve(matrix + damping * np.diag(np.diag(matrix)), slope)).astype(np.float32)
    there = look(trial)
    gains = np.sum(there[0] ** 2) < np.sum(r**2)
    damping *= 0.3 if gains else 4
    if gains:
        ball, (r, jacobian) = trial, there
    losses.append(float(np.mean(r**2)))

errors = standard_errors(np.asarray(jacobian, float), np.asarray(r, float))
for name, found, error, right in zip(names, ball, errors, truth, strict=True):
    print(
        f"{name:6} {found:8.4f} ± {error:.4f}, truth {right}: off by {abs(found - right) / error:.1f} standard errors"
    )

pictures |= {"fit": depth(ball, 0), "fit - target": r[..., 0]}
figure = Figure(figsize=(13, 2.7), layout="constrained")
axes = figure.subplots(1, 5, width_ratios=[1, 1, 1, 1, 1.3])
for place, (title, picture) in zip(axes, pictures.items(), strict=False):
    signed = dict(cmap="RdBu_r", vmin=-0.2, vmax=0.2) if "-" in title else dict(cmap="magma_r", vmin=0, vmax=20)
    figure.colorbar(place.imshow(picture, **signed), ax=place, shrink=0.7)
    place.set_title(title, fontsize=9)
    place.set_axis_off()
axes[-1].semilogy(losses, ".-")
axes[-1].axhline(0.05**2, color="k", linewidth=0.8, linestyle=":")
axes[-1].set_title("mean square, and the sensor's", fontsize=9)
axes[-1].set_xlabel("step")
figure.savefig(options.output / "fit_depth.png", dpi=75)
print(f"figure: {options.output / 'fit_depth.png'}")
