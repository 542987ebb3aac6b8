"""Find place and size of a ball from a depth picture, such as a depth camera takes.

    python examples/fit_depth.py

The target is a dict of outputs, here of depth alone: no light is drawn, the camera's rays are traced to what they meet
first. Depth jumps at the ball's outline, and where the ball goes, the jump goes with it: an edge, in the derivative
like those of pictures, and what tells of a ball of which the start overlaps half. The sensor's noise is 0.05 a pixel,
the distance about 12; where it has seen nothing, the weight is 0.
"""

import numpy as np
from figure import arguments
from matplotlib.figure import Figure

import jaxrt

options = arguments(__doc__)
size, spp, steps = (16, 1, 1) if options.quick else (64, 64, 40)
scene = jaxrt.load_scene("scenes/ball_under_sphere_light.toml")
truth = {"spheres.center[0]": np.array([0.0, 1.5, 0.0]), "spheres.radius[0]": np.array(1.0)}
start = {"spheres.center[0]": np.array([1.0, 2.0, -0.5]), "spheres.radius[0]": np.array(0.8)}

rng = np.random.default_rng(0)
exact = np.asarray(jaxrt.render(scene, 1, spp=spp, width=size, height=size, outputs=("depth",))["depth"])
seen = rng.uniform(size=exact.shape) > 0.02
target = np.where(seen, exact + 0.05 * rng.standard_normal(exact.shape), np.nan)

guess = jaxrt.with_parameters(scene, start)
answer = jaxrt.fit(guess, {"depth": target}, list(truth), weight={"depth": seen}, spp=spp, max_steps=steps)
for name, right in truth.items():
    found, errors = np.ravel(answer.values[name]), np.ravel(answer.errors[name])
    for value, error, true in zip(found, errors, np.ravel(right), strict=True):
        print(
            f"{name} {value:8.4f} ± {error:.4f}, truth {true}: off by {abs(value - true) / error:.1f} standard errors"
        )
print(f"{answer.verdict.word}: {answer.verdict.message}")

before, after = (np.where(seen, found["depth"], np.nan) for found in (answer.before, answer.after))
pictures = {"target": target, "start": before, "fit": after, "fit - target": after - target}
figure = Figure(figsize=(13, 2.7), layout="constrained")
axes = figure.subplots(1, 5, width_ratios=[1, 1, 1, 1, 1.3])
for place, (title, picture) in zip(axes, pictures.items(), strict=False):
    signed = dict(cmap="RdBu_r", vmin=-0.2, vmax=0.2) if "-" in title else dict(cmap="magma_r", vmin=0, vmax=20)
    figure.colorbar(place.imshow(picture, **signed), ax=place, shrink=0.7)
    place.set_title(title, fontsize=9)
    place.set_axis_off()
axes[-1].semilogy(answer.history, ".-")
axes[-1].axhline(0.05**2 / np.var(exact[seen]), color="k", linewidth=0.8, linestyle=":")
axes[-1].set_title("loss, blurred to sharp, and the sensor's", fontsize=9)
axes[-1].set_xlabel("step")
figure.savefig(options.output / "fit_depth.png", dpi=75)
print(f"figure: {options.output / 'fit_depth.png'}")
