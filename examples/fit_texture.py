"""Find the painting on a vase, 128x128 texels, from four pictures of it in a room.

    python examples/fit_texture.py

49,152 numbers: a derivative of the picture in each is too much, but a gradient costs the same for any number. Light is
all but linear in the texels, so this is least squares: conjugate gradients, each step a gradient by the same few
samples, solve for what the residual asks for. That is drawn by many samples, cheap without derivatives; what few have
wrong, the next residual shows. Steps are divided by the gradient that all texels have if they change alike: those
in the dark, and those that few pixels see, move as far as others.
"""

import time
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from figure import arguments, save_figure

import jaxrt

options = arguments(__doc__)
full, quick = ((128, 176), ((64, 4), (256, 8), (256, 8)), 1024, 16), ((8, 12), ((4, 1), (4, 2)), 16, 1)
(width, height), rounds, fine, looks = quick if options.quick else full
NAME, FEW, SMOOTH = "textures.majolica", 4, 1e-4
views = jaxrt.load_views("scenes/vase.toml")
views = [replace(view, camera=replace(view.camera, width=width, height=height)) for view in views]
truth = jaxrt.parameters(views[0])[NAME]
targets = [jaxrt.render(view, 10**6 + i, spp=fine) for i, view in enumerate(views)]


def picture(texels, view, key, spp):
    return jaxrt.render(jaxrt.with_parameters(view, {NAME: texels}), key, spp=spp)


@jax.jit
@jax.grad
def slope(texels, view, key, target):
    uneven = sum(jnp.mean(jnp.diff(texels, axis=axis) ** 2) for axis in (0, 1))
    return (jnp.mean((picture(texels, view, key, FEW) - target) ** 2) + SMOOTH * uneven) / len(views)


def whole_slope(texels, keys, goals):
    return sum(map(slope, [texels] * len(views), views, keys, goals))


def pixels(view, key):
    """Return how many pixels show each texel, by the places on textures that a sample of each shows."""
    shown = jaxrt.render(view, key, spp=1, outputs=("uv", "mask[paint]"))
    u, v = np.asarray(shown["uv"])[np.asarray(shown["mask[paint]"]) == 1].T
    count = np.zeros(truth.shape[:2])
    np.add.at(count, ((len(truth) * (1 - v)).astype(int), (len(truth) * u).astype(int) % len(truth)), 1 / looks)
    return count


visible = sum(pixels(view, i) for view in views for i in range(looks)) >= (0 if options.quick else 1)
texels, gradients, curve, begin = jnp.full_like(truth, 0.5), 0, [], time.process_time()
for number, (spp, steps) in enumerate(rounds):
    keys = [np.uint32(100 * number + i) for i in range(len(views))]
    shown = [picture(texels, v, k, FEW) - picture(texels, v, k + 50, spp) for v, k in zip(views, keys, strict=True)]
    goals = [target + less for target, less in zip(targets, shown, strict=True)]  # for the few samples
    gradient = partial(whole_slope, keys=keys, goals=goals)
    here = gradient(texels)
    alike = gradient(texels + 1) - here
    alike = jnp.maximum(alike, 1e-3 * jnp.max(alike))
    left, change, way = -here, 0, -here / alike
    for _ in range(steps):
        pushed, size = gradient(texels + way) - here, jnp.vdot(left, left / alike)
        share = size / jnp.vdot(way, pushed)
        change, left = change + share * way, left - share * pushed
        way = left / alike + jnp.vdot(left, left / alike) / size * way
        curve.append(float(size))
    texels, gradients = jnp.clip(texels + change, 0, 1), gradients + len(views) * (steps + 2)
    off = np.asarray(texels - truth, float)[visible]
    psnr, seconds = -10 * np.log10(np.mean(off**2)), time.process_time() - begin
    print(f"{gradients} gradients, {seconds:.0f} s of CPU, compiling too: {psnr:.2f} dB")
save_figure(options.output / "fit_texture.png", truth, {"start": truth * 0 + 0.5, "fit": texels}, {"rest": curve})
