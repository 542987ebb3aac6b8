"""Where is the mug, and how is it turned? Its pose from one picture.

    python examples/fit_pose.py

A pose is two parameters of a mesh, a place and a rotation vector, asked for by name. The mug's outline and its shadow
tell most of them, its handle how it is turned about itself; both are edges. `jaxrt.fit` compares blurred pictures
first, in which a mug that is half beside its place still overlaps it, moves it there, then turns it in other ways, and
goes some steps down from those that look best.
"""

import numpy as np
from figure import arguments, save_figure

import jaxrt
from jaxrt.description.pose import rotation_matrix, rotation_vector

options = arguments(__doc__)
size, spp, steps, starts = (8, 1, 1, 1) if options.quick else (32, 32, 40, 16)
NAMES = ("meshes.translate[mug]", "meshes.rotate[mug]")
scene = jaxrt.load_scene("scenes/mug.toml")
truth = {name: np.asarray(jaxrt.parameters(scene, name), float) for name in NAMES}
target = jaxrt.render(scene, 1, spp=8 * spp, width=size, height=size)

# A sixth of what the camera sees aside, and 35° off
turn = rotation_matrix(tuple(35 * np.array([0.6, 0.64, -0.48]))) @ rotation_matrix(tuple(truth[NAMES[1]]))
start = {NAMES[0]: truth[NAMES[0]] + [-0.6, 0.4, 0.5], NAMES[1]: np.array(rotation_vector(turn))}
guess = jaxrt.with_parameters(scene, start)
answer = jaxrt.fit(guess, target, NAMES, spp=spp, starts=starts, max_steps=steps)


def told(values):
    return " ".join(f"{value:8.3f}" for value in values)


for name in NAMES:
    print(f"{name}\n  truth {told(truth[name])}\n  start {told(start[name])}")
    print(f"  found {told(answer.values[name])}\n     ±  {told(answer.errors[name])}")
off = rotation_matrix(tuple(answer.values[NAMES[1]])) @ rotation_matrix(tuple(truth[NAMES[1]])).T
degrees = np.linalg.norm(rotation_vector(off))
print(
    f"off by {degrees:.2f} degrees and {np.linalg.norm(answer.values[NAMES[0]] - truth[NAMES[0]]) / 2:.2%} of its size"
)
print(f"{answer.verdict.word}: {answer.verdict.message}")
pictures = {"start": answer.before, "fit": answer.after}
errors = [float(np.mean((picture - target) ** 2)) for picture in pictures.values()]
save_figure(options.output / "fit_pose.png", target, pictures, {"start, fit": errors})
