"""Calibrate a camera from five pictures of a rig of glowing balls: focal lengths, axis and one number of distortion.

    python examples/fit_camera.py

The pictures change by moving outlines alone. Places are known, as from a robot's arm; one program serves all views.
"""

import jax
import jax.numpy as jnp
import numpy as np
from figure import arguments, save_figure

import jaxrt

options = arguments(__doc__)
views, balls, spp, steps = (2, 12, 4, 2) if options.quick else (5, 60, 64, 8)
WIDTH, HEIGHT = (16, 12) if options.quick else (96, 72)
TRUTH = {"fx": 91.0, "fy": 88.0, "cx": 50.5, "cy": 34.0, "k1": -0.18}
START = {"fx": 94.0, "fy": 86.0, "cx": 48.0, "cy": 36.0, "k1": 0.0}

random = np.random.default_rng(1)
rig = random.uniform([-2.4, -1.8, -1.2], [2.4, 1.8, 1.2], (balls, 3))
colours = random.uniform(0.2, 1, (balls, 3))
R = 0.16
scene = jaxrt.build(
    {
        "camera": {
            "type": "calibrated",
            "position": [0, 0, 4],
            "width": WIDTH,
            "height": HEIGHT,
            "size": [96, 72],
            **TRUTH,
        },
        "render": {"max_depth": 1},
        "lights": [
            {"position": place.tolist(), "radius": R, "intensity": (np.pi * R * R * colour).tolist()}
            for place, colour in zip(rig, colours, strict=True)
        ],
    }
)
turns = np.linspace(-0.5, 0.5, views)
eyes = jnp.asarray(np.stack([4 * np.sin(turns), 1.2 * np.cos(5 * turns), 4 * np.cos(turns)], -1), jnp.float32)


def picture(lens, eye, key):
    """Return the view from an eye to the rig's middle, twice. lens: the numbers sought, in the order of TRUTH."""
    changes = {f"camera.{name}": value for name, value in zip(TRUTH, lens, strict=True)}
    changes |= {"camera.position": eye, "camera.target": jnp.zeros(3)}
    drawn = jaxrt.render(jaxrt.with_parameters(scene, changes), key, spp=spp, boundary_samples=16 * WIDTH * HEIGHT)
    return drawn, drawn


look = jax.jit(jax.jacfwd(picture, has_aux=True))  # Jacobian (height, width, 3, 5) and picture, from one program
truth, lens = (jnp.asarray(list(numbers.values())) for numbers in (TRUTH, START))
targets = [np.asarray(look(truth, eye, 100 + i)[1], float) for i, eye in enumerate(eyes)]
before = look(lens, eyes[0], 0)[1]

# Gauss-Newton over all views at once
losses = []
for step in range(steps):
    seen = [look(lens, eye, step) for eye in eyes]
    residual = np.concatenate([(view[1] - target).ravel() for view, target in zip(seen, targets, strict=True)])
    jacobian = np.concatenate([np.asarray(view[0], float).reshape(-1, len(TRUTH)) for view in seen])
    losses.append(float(residual @ residual))
    lens = lens - jnp.asarray(np.linalg.lstsq(jacobian, residual, rcond=None)[0], jnp.float32)
    print(f"step {step}: loss {losses[-1]:.4g}")

variance = losses[-1] / (len(residual) - len(TRUTH))
errors = np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)) * variance)
for name, found, error in zip(TRUTH, lens, errors, strict=True):
    print(f"{name} = {float(found):.4f} ± {error:.4f}, truth {TRUTH[name]}")

save_figure(
    options.output / "fit_camera.png",
    jnp.asarray(targets[0]),
    {"start": before, "found": look(lens, eyes[0], 0)[1]},
    {"loss": losses},
)
