"""Calibrate a camera: focal lengths, principal point and distortion from five pictures of many small balls.

    python examples/fit_camera.py

Where the camera stands is known, as of one on an arm. What tells of the lens is where the balls' outlines are seen:
edges. `jaxrt.fit` takes a list of scenes alike but for their cameras, each with its picture; what is sought of the
camera is the same for all. It begins as if the lens did not bend at all.
"""

import jax.numpy as jnp
import numpy as np
from figure import arguments, save_figure

import jaxrt

options = arguments(__doc__)
width, height, spp, steps, count = (12, 9, 1, 1, 2) if options.quick else (64, 48, 16, 30, 5)
rng = np.random.default_rng(0)
places = np.stack(np.meshgrid(np.linspace(-3.6, 3.6, 9), np.linspace(-2.7, 2.7, 7)), -1).reshape(-1, 2)
balls = [
    {"center": [x, y, rng.uniform(-1, 0.5)], "radius": rng.uniform(0.15, 0.3), "material": f"colour {i % 6}"}
    for i, (x, y) in enumerate((places + rng.uniform(-0.2, 0.2, places.shape)).tolist())
]
colours = {f"colour {i}": {"type": "diffuse", "albedo": rng.uniform(0.2, 0.9, 3).tolist()} for i in range(6)}
truth = {"fx": 60.0, "fy": 58.5, "cx": 33.0, "cy": 23.2, "k1": -0.2}
start = {"fx": 64.0, "fy": 55.0, "cx": 32.0, "cy": 24.0, "k1": 0.0}
NAMES = [f"camera.{name}" for name in truth]
lens = {"type": "calibrated", "width": width, "height": height, "size": [64, 48], **truth}
scene = jaxrt.build(
    {
        "camera": {"position": [0, 0, 6], "target": [0, 0, 0], **lens},
        "materials": {"wall": {"type": "diffuse", "albedo": [0.4, 0.4, 0.4]}, **colours},
        "spheres": [{"center": [0, 0, -1003], "radius": 1000, "material": "wall"}, *balls],
        "lights": [{"position": [3, 5, 9], "intensity": 200}],
    }
)
eyes = [[0, 0, 6], [2.5, 0, 5.5], [-2.5, 0, 5.5], [0, 2.5, 5.5], [0, -2.5, 5.5]][:count]
views = [jaxrt.with_parameters(scene, {"camera.position": jnp.asarray(eye, jnp.float32)}) for eye in eyes]
targets = [jaxrt.render(view, 100 + i, spp=8 * spp, max_depth=1) for i, view in enumerate(views)]
guesses = [jaxrt.with_parameters(view, {f"camera.{name}": x for name, x in start.items()}) for view in views]
answer = jaxrt.fit(guesses, targets, NAMES, spp=spp, max_depth=1, max_steps=steps)

for name, right in truth.items():
    found, error = (float(values[f"camera.{name}"]) for values in (answer.values, answer.errors))
    print(f"{name}: from {start[name]:5.1f} to {found:8.4f} ± {error:.4f}, truth {right}")
print(f"{answer.verdict.word}: {answer.verdict.message}")
side = [np.split(picture, len(views))[1] for picture in (np.concatenate(targets), answer.before, answer.after)]
losses = [float(np.mean((picture - np.concatenate(targets)) ** 2)) for picture in (answer.before, answer.after)]
save_figure(options.output / "fit_camera.png", side[0], {"start": side[1], "fit": side[2]}, {"start, fit": losses})
